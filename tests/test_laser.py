"""The beam's bins: conservation of power, Beer-Lambert, shares of the columns, pulses, the same bits."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from taichi_slm.config.schema import Laser
from taichi_slm.physics.laser import DARK, beam_reach, line_power, shares
from taichi_slm.run.simulation import Simulation

UM = 1e-6
DX = 5 * UM
POWER, ABSORPTIVITY = 100.0, 0.4
BEAM = {"power": POWER, "beam_radius": 15 * UM, "absorptivity": ABSORPTIVITY}


def beam(**keys):
    return Laser.model_validate({**BEAM, "path": [{"kind": "dwell", "at": [0], "duration": 1}], **keys})


# --------------------------------------------------------------------------- shares of the columns

EDGES = np.linspace(-70.0, 65.0, 28) * UM + 1.3 * UM  # off the axis by a fraction of a bin


@pytest.mark.parametrize("profile", ["gaussian", "top_hat"])
@pytest.mark.parametrize("exponent", [2.0, 3.0])
@pytest.mark.parametrize("dimension", [2, 3])
def test_shares_add_up_to_one(profile, exponent, dimension):
    laser = beam(profile=profile, exponent=exponent)
    parts = shares(laser, [EDGES] * (dimension - 1))
    assert parts.shape == (27,) * (dimension - 1)
    assert parts.sum() == pytest.approx(1.0, abs=1e-13)  # the tails outside the window are 1e-15 at 4.2 w
    assert parts.min() > -1e-15  # differences of areas: round-off of the last bit on either side of zero


def test_shares_of_a_gaussian_are_its_integrals():
    laser = beam()
    w = laser.beam_radius
    parts = shares(laser, [EDGES, EDGES + 7 * UM])
    along = shares(laser, [EDGES])
    rng = np.random.default_rng(1)
    for i, j in rng.integers(8, 19, (6, 2)):
        limits = EDGES[i], EDGES[i + 1], EDGES[j] + 7 * UM, EDGES[j + 1] + 7 * UM
        exact = dblquad(
            lambda y, x: 2 / (np.pi * w**2) * np.exp(-2 * (x**2 + y**2) / w**2), *limits, epsrel=1e-10
        )[0]
        assert parts[i, j] == pytest.approx(exact, rel=1e-9)
        # in 2-D the line y = 0 is lit: the share is that of I(x, 0)
        line = quad(lambda x: math.sqrt(2 / np.pi) / w * np.exp(-2 * x**2 / w**2), *limits[:2])[0]
        assert along[i] == pytest.approx(line, rel=1e-9)


def test_shares_of_a_top_hat_are_areas_of_a_disc():
    laser = beam(profile="top_hat")
    x = np.linspace(-1.3, 1.4, 10)  # in radii, so that the quadrature's absolute tolerance means something
    y = np.linspace(-1.25, 1.3, 9)
    parts = shares(laser, [x * laser.beam_radius, y * laser.beam_radius])

    def chord(at, low, high):
        half = math.sqrt(max(1.0 - at**2, 0.0))
        return max(min(high, half) - max(low, -half), 0.0)

    for i in range(len(x) - 1):
        for j in range(len(y) - 1):
            kinks = [s * math.sqrt(max(1.0 - e**2, 0.0)) for e in (y[j], y[j + 1], 0.0) for s in (-1, 1)]
            kinks = [k for k in kinks if x[i] < k < x[i + 1]] or None
            area, _ = quad(chord, x[i], x[i + 1], args=(y[j], y[j + 1]), points=kinks, limit=200)
            assert parts[i, j] == pytest.approx(area / np.pi, abs=1e-8)  # what `quad` promises
    assert parts.sum() == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("profile", ["gaussian", "top_hat"])
def test_line_power_is_the_integral_of_the_middle_line(profile):
    laser = beam(profile=profile, exponent=3.0)
    w = laser.beam_radius
    intensity = {
        "gaussian": lambda x: 3 / (np.pi * w**2) * np.exp(-3 * x**2 / w**2),
        "top_hat": lambda x: 1 / (np.pi * w**2) if abs(x) < w else 0.0,
    }[profile]
    total = 2 * quad(intensity, 0, w)[0] + 2 * quad(intensity, w, 5 * w)[0]
    assert line_power(laser, 2) == pytest.approx(total, rel=1e-9)
    assert line_power(laser, 3) == 1.0


def test_nothing_to_speak_of_lies_beyond_the_reach():
    for exponent in (1.0, 2.0, 3.0):
        laser = beam(exponent=exponent)
        outside = math.erfc(math.sqrt(exponent) * beam_reach(laser) / laser.beam_radius)
        assert outside < 1e-12  # docstring: 3e-13 at f = 2


# --------------------------------------------------------------------------- bins against the host


def lit_scene(configure, dimension, whole, bin_size=None, depth=10 * UM):
    """A plate with a row of powder on it under a standing beam; heat alone."""
    plate = {"shape": "plate", "length": 120 * UM, "depth": 40 * UM, "temperature": 293}
    row = {"shape": "powder_row", "start": 60 * UM, "length": 60 * UM, "radius": 15 * UM}
    if dimension == 3:
        plate |= {"width": 60 * UM}
    at = [61.2 * UM, 2.1 * UM][: dimension - 1]
    return configure(
        dimension=dimension,
        spacing=DX,
        bodies=[plate, row],
        laser={**BEAM, "bin_size": bin_size, "absorption_depth": depth,
               "path": [{"kind": "dwell", "at": at, "duration": 1e-3}]},
        physics={"flow": False, "radiation": False},
        performance={"skip_dark": not whole},
        time={"end": 1e-4},
    )  # fmt: skip


def on_host(sim, laser, centre, incident):
    """Absorbed power of every particle and what passes through, by the equations of Appendix A, in numpy."""
    d, size = sim.scene.dimension, sim.bins.size
    lower = sim.bins.lower
    shape = sim.bins.nodes
    place = (sim.position - lower) / size
    base = np.floor(place).astype(int)
    volume = sim.state.array("volume")
    corners = np.stack(np.meshgrid(*[[0, 1]] * d, indexing="ij"), axis=-1).reshape(-1, d)
    weights = np.stack(
        [volume * np.prod(1.0 - np.abs(place - (base + corner)), axis=1) for corner in corners]
    )
    filling = np.zeros(shape)
    for corner, weight in zip(corners, weights, strict=True):
        np.add.at(filling, tuple((base + corner).T), weight)
    filling /= size**d
    edges = [o + size * (np.arange(n + 1) - 0.5) - x for o, n, x in zip(lower, shape, centre, strict=False)]
    arriving = incident * shares(laser, edges)
    depth = laser.absorption_depth or size / 3.0
    through = np.exp(-np.cumsum(np.minimum(filling[..., ::-1], 1.0), axis=-1) * size / depth)
    above = np.concatenate([np.ones((*shape[:-1], 1)), through[..., :-1]], axis=-1)
    absorbed = (arriving[..., None] * (above - through))[..., ::-1]
    per_weight = np.where(filling > 0, absorbed / np.maximum(filling, 1e-300) / size**d, 0.0)
    power = sum(w * per_weight[tuple((base + c).T)] for c, w in zip(corners, weights, strict=True))
    return power, float((arriving * through[..., -1]).sum() + incident - arriving.sum())


def look(sim, centre, incident):
    """Absorbed power of every particle for a beam at ``centre``; who is in no row has none."""
    if sim.activity.builds == 0:
        sim.bins.absorb(centre, 1e-300)  # as `compile` does: over no rows, so that nothing counts as dark yet
    sim.activity.beam_at(centre)
    sim.activity.neighbours()
    sim.bins.absorb(centre, incident)
    rows = sim.rows.hot_rows.to_numpy()[: sim.rows.hot]
    power = np.zeros(sim.scene.count)
    power[rows] = sim.state.array("laser")[rows]
    return power


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_what_is_skipped_as_dark_is_dark(configure, dimension):
    """The beam comes over the row of powder in half bins, as in a run; light that goes deep is cut off."""
    sim = Simulation(lit_scene(configure, dimension, False, depth=None))  # 1/alpha is a third of a bin
    incident = ABSORPTIVITY * POWER * line_power(sim.bins.laser, dimension)
    across = [0.9 * UM][: dimension - 2]
    for profile, reach in (("gaussian", 131), ("top_hat", 90)):
        laser = sim.bins.laser = sim.bins.laser.model_copy(update={"profile": profile})
        for x in np.arange(22, reach, 0.5 * DX / UM):
            centre = (x * UM, *across)
            power = look(sim, centre, incident)
            host, passed = on_host(sim, laser, centre, incident)
            # DARK is a share of the brightest column's light; some ten columns may be cut off at it
            assert power.sum() + passed == pytest.approx(incident, rel=20 * DARK)
            assert power.sum() <= incident - passed + 1e-12 * incident  # never more than there is
            assert power == pytest.approx(host, abs=20 * DARK * host.max())
        assert np.count_nonzero(power) < 0.9 * sim.scene.count  # and something was cut off


@pytest.mark.parametrize("bin_size", [7.5 * UM, pytest.param(4.1 * UM, marks=pytest.mark.slow)])
def test_particles_at_random_places_keep_the_power(configure, bin_size):
    """Crowded and empty bins, of a size that does not fit the lattice: fillings beyond one do not absorb more."""
    sim = Simulation(lit_scene(configure, 2, True, bin_size, depth=6 * UM))
    rng = np.random.default_rng(5)
    sim.state.load(position=sim.position + rng.uniform(-0.45, 0.45, (sim.scene.count, 2)) * DX)
    volume = sim.state.array("volume")
    volume[7] = 0.0  # a removed particle
    sim.state.load(volume=volume)
    incident = 1e6
    power = look(sim, (63.3 * UM,), incident)
    host, passed = on_host(sim, sim.bins.laser, (63.3 * UM,), incident)
    assert power.sum() + passed == pytest.approx(incident, rel=1e-12)
    assert power == pytest.approx(host, abs=1e-10 * host.max())
    assert power[7] == 0.0
    assert (power >= 0).all()
    # the same bits each time: the sums of weights are integers, so the order of threads does not matter
    for _ in range(5):
        assert np.array_equal(look(sim, (63.3 * UM,), incident), power)


def test_what_rises_and_sinks_leaves_no_light_behind(configure):
    """Only the bins up to the highest particle are emptied: what spatter leaves above must not shade those below."""
    sim = Simulation(lit_scene(configure, 2, True))
    place, incident, centre = sim.position, 1e6, (80 * UM,)
    powder = place[:, 1] > 0
    for lift in (0.0, 12.3, 0.0, 20.0, 31.0, 5.0, -9.0, 0.0):
        sim.state.load(position=place + np.stack([0 * powder, lift * UM * powder], axis=1))
        power = look(sim, centre, incident)
        host, passed = on_host(sim, sim.bins.laser, centre, incident)
        assert power.sum() + passed == pytest.approx(incident, rel=1e-12)
        assert power == pytest.approx(host, abs=1e-10 * host.max())  # weights are integers of 2^-40 of a bin


# --------------------------------------------------------------------------- energy over time


@pytest.mark.parametrize(
    "pulse",
    [
        {"on": 1e-9, "off": 1.7e-6},
        pytest.param({"on": 0.6e-6, "off": 0.25e-6}, marks=pytest.mark.slow),
        pytest.param(None, marks=pytest.mark.slow),
    ],
)
def test_energy_of_pulses_is_exact(configure, pulse):
    """A pulse of 1 ns in steps of a tenth of a microsecond is neither missed nor lengthened."""
    config = configure(
        spacing=10 * UM,
        bodies=[{"shape": "plate", "start": -80 * UM, "length": 160 * UM, "depth": 40 * UM, "temperature": 293}],
        laser={**BEAM, "power": 20, "start": 0.3e-6, "pulse": pulse,
               "path": [{"kind": "line", "start": [-20 * UM], "end": [0.0], "speed": 10.0},
                        {"kind": "line", "start": [0.0], "end": [20 * UM], "speed": 5.0, "power_fraction": 0.5}]},
        physics={"flow": False, "radiation": False},
        performance={"skip_cold": False},  # which keeps energy to 1e-3 K times a rim, and this is about round-off
        time={"end": 8e-6},
    )  # fmt: skip
    sim = Simulation(config)
    sim.run()
    # the path by hand: 2 us at full, 4 us at half power, from 0.3 us on, times the train of pulses
    on, period = (pulse["on"], pulse["on"] + pulse["off"]) if pulse else (1.0, 1.0)
    lit = 0.0
    for k in range(int(6e-6 / period) + 1):
        begin, end = k * period, min(k * period + on, 6e-6)
        lit += max(min(end, 2e-6) - begin, 0.0) + 0.5 * max(end - max(begin, 2e-6), 0.0)
    incident = ABSORPTIVITY * 20 * line_power(config.laser, 2) * lit
    row = sim.diagnostics()
    # times are sums of some hundred steps: an ulp of 8e-6 s each, against 1e-9 s of light in the shortest pulse
    assert sim.accounts.incident == pytest.approx(incident, rel=1e-9)
    assert row["absorbed_J"] + row["passed_through_J"] == pytest.approx(incident, rel=1e-9)
    assert row["stored_J"] + row["conducted_out_J"] == pytest.approx(row["absorbed_J"], rel=1e-9)
    # bins of 10 um, 1/alpha a third of one, four layers: exp(-12) passes through
    assert row["passed_through_J"] == pytest.approx(incident * math.exp(-12.0), rel=1e-3)
