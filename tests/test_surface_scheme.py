"""What the surface scheme, the walls and the shifting must leave alone, on particles out of order and on lattices."""

import numpy as np
import pytest

from taichi_slm import backend
from taichi_slm.backend import ti
from taichi_slm.physics.shifting import shear_rate_of
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.scenes import FLOW_ONLY

UM = 1e-6
DX, N, MU, RHO = 1e-5, 24, 0.02, 7000.0
SLOPE = -3e-4  # of the surface tension [N/(m K)]


@pytest.fixture
def square(configure, liquid):
    """A free square of liquid, N x N; with walls below it, three particles deep and as wide, if asked for."""

    def build(walls=False, **keys):
        law = {"line": {"value": 1.6, "slope": SLOPE, "at": 2000}}
        metal = liquid(density=RHO, viscosity=MU, surface_tension=law)
        bodies = [{"shape": "box", "corner": [0, 0], "size": [N * DX, N * DX], "material": "metal"}]
        if walls:
            bodies.append(
                {
                    "shape": "box",
                    "corner": [0, -3 * DX],
                    "size": [N * DX, 3 * DX],
                    "material": "metal",
                    "wall": True,
                }
            )
        config = configure(spacing=DX, materials={"metal": metal}, ambient_temperature=2000, bodies=bodies,
                           **{"physics": FLOW_ONLY, **keys})  # fmt: skip
        sim = Simulation(config)
        sim.compile()
        return sim

    return build


def disorder(sim, seed=4):
    """Every particle up to a quarter of a spacing off its place; the lists follow."""
    x = sim.position
    sim.state.load(position=x + np.random.default_rng(seed).uniform(-0.25, 0.25, x.shape) * DX)
    sim.activity.build()
    return sim.position


def columns(x):
    """Of how many columns of the lattice these are."""
    return np.unique(np.round(x / DX, 3)).size


# --------------------------------------------------------------------------- tension


@pytest.mark.parametrize("form", ["balanced", "body_force"])
def test_a_pressure_equal_to_the_capillary_one_does_nothing(square, form):
    """However the particles lie; with (25) as a body force the same pressure pushes them about."""
    sim = square(physics={**FLOW_ONLY, "surface_tension": True}, numerics={"tension": form})
    pressure = 5e4
    disorder(sim)
    sim.state.load(pressure=np.full(N * N, pressure), velocity=np.zeros((N * N, 2)))
    if form == "balanced":
        sim.state.load(background=np.full(N * N, pressure), tangential_force=np.zeros((N * N, 2)))
    else:
        sim.state.load(surface_force=np.zeros((N * N, 2)))
    sim.flow_step.flow.momentum(1e-9)
    share = np.abs(sim.state.array("acceleration")).max() * RHO * DX / pressure  # p over one spacing
    if form == "balanced":
        assert share < 1e-12
    else:
        assert share > 0.1


def test_the_traction_is_what_the_viscous_sum_lacks(square):
    """Linear shear below a flat top whose Marangoni stress is mu du/dy: no force in either direction, to round-off."""
    sim = square(physics={**FLOW_ONLY, "surface_tension": True, "marangoni": True})
    x, y = sim.position.T
    shear = 50.0  # [1/s]
    sim.impose(2000 + MU * shear / SLOPE * (x - x.mean()))
    velocity = np.stack([shear * y, np.zeros_like(y)], axis=1)
    sim.state.load(velocity=velocity)
    sim.surface.step()
    zero = np.zeros(N * N)
    sim.state.load(background=zero, pressure=zero)
    sim.flow_step.flow.momentum(0.0)
    middle = (np.abs(x - x.mean()) < 6 * DX) & (y > y.mean())
    top = middle & (y > y.max() - 1.5 * DX)  # two layers lack neighbours
    traction = sim.state.array("tangential_force") / RHO
    assert (traction[top, 0] > 0).all()
    assert np.abs(sim.state.array("acceleration")[middle]).max() < 1e-9 * traction[top, 0].max()
    # per length of the surface it is the stress itself
    assert traction[middle, 0].sum() * RHO * DX / columns(x[middle]) == pytest.approx(MU * shear, rel=1e-9)


# --------------------------------------------------------------------------- shifting


@pytest.mark.parametrize("dimension", [2, 3])
def test_only_shear_counts_as_shear(dimension):
    """sqrt(2 D : D) of the deviatoric strain rate: none of a rotation or an expansion, the rate of a plane shear."""
    backend.start(threads=1)
    rate = shear_rate_of(dimension)
    given = ti.Matrix.field(dimension, dimension, ti.f64, shape=4)
    found = ti.field(ti.f64, shape=4)
    spin, shear = np.zeros((dimension, dimension)), np.zeros((dimension, dimension))
    spin[0, 1], spin[1, 0], shear[0, 1] = 3.0, -3.0, 3.0
    given.from_numpy(np.array([spin, 3.0 * np.eye(dimension), shear, shear + spin + np.eye(dimension)]))

    @ti.kernel
    def evaluate():
        for i in given:
            found[i] = rate(given[i])

    evaluate()
    assert found.to_numpy() == pytest.approx([0.0, 0.0, 3.0, 3.0], abs=1e-7)


def shift_of(sim, velocity):
    sim.state.load(velocity=velocity)
    sim.flow_step.flow.momentum(1e-9)
    return sim.state.array("shift")


def test_particles_are_shifted_by_shear_alone(square):
    """Not by a translation, whatever their order; a moving frame and a rotation of the velocities do not matter."""
    sim = square(numerics={"shifting": 200.0})
    x, y = disorder(sim).T
    inside = np.maximum(np.abs(x - x.mean()), np.abs(y - y.mean())) < (N / 2 - 4) * DX
    rest = np.zeros((N * N, 2))
    assert (shift_of(sim, rest) == 0.0).all()
    frame = rest + np.array([7.0, -3.0])
    assert (shift_of(sim, frame) == 0.0).all()
    shear = np.stack([1e4 * y, 0 * y], axis=1)
    sheared = shift_of(sim, shear)
    assert np.abs(sheared[inside]).max() > 1e-5 * DX
    assert shift_of(sim, shear + frame) == pytest.approx(sheared, abs=1e-9 * np.abs(sheared).max())
    assert np.abs(sheared).max() < DX  # bounded, whatever the shear
    assert shift_of(sim, 1e6 * shear) == pytest.approx(shift_of(sim, 1e8 * shear), abs=1e-12 * DX)


# --------------------------------------------------------------------------- walls


@pytest.mark.parametrize("walls", ["no_slip", "no_slip_centres"])
def test_a_linear_profile_ends_at_the_face_of_a_wall(square, walls):
    """It is kept, and its drag is mu du/dy, to 0.4 %; wall particles that show no speed take half of the drag."""
    sim = square(walls=True, numerics={"walls": walls, "packing_correction": 0})
    liquid_ones = ~sim.scene.wall
    x, y = sim.position.T
    shear = 50.0
    sim.state.load(velocity=np.where(liquid_ones, shear * y, 0.0)[:, None] * [1.0, 0.0])
    sim.flow_step.flow.advance(0.0, 0.0)
    sim.flow_step.flow.walls()
    sim.state.load(pressure=np.zeros(len(x)))
    sim.flow_step.flow.momentum(0.0)
    middle = liquid_ones & (np.abs(x - x.mean()) < 6 * DX) & (y < 8 * DX)
    drag = -sim.state.array("wall_force")[middle, 0].sum() / (columns(x[middle]) * DX * MU * shear)
    force = np.abs(sim.state.array("acceleration")[middle, 0]).max() * RHO * DX / (MU * shear)
    if walls == "no_slip":
        assert drag == pytest.approx(1.0, abs=0.004)
        assert force < 0.004
    else:
        assert drag == pytest.approx(0.5, abs=0.004)
        assert force == pytest.approx(0.5, abs=0.004)


@pytest.mark.parametrize("walls", ["no_slip", "free_slip"])
def test_what_a_wall_shows_to_a_uniform_flow(square, walls):
    """No slip: the opposite; free slip: its mirror image, so that only the normal part is opposed."""
    sim = square(walls=True, numerics={"walls": walls, "packing_correction": 0})
    liquid_ones = ~sim.scene.wall
    x, y = sim.position.T
    sim.state.load(velocity=np.where(liquid_ones[:, None], [2.0, 3.0], 0.0))
    sim.flow_step.flow.walls()
    beside = ~liquid_ones & (y > -2 * DX) & (np.abs(x - x.mean()) < 6 * DX)
    expected = np.array([-2.0 if walls == "no_slip" else 2.0, -3.0])
    shown = sim.state.array("shown_velocity")[beside]
    assert shown == pytest.approx(np.broadcast_to(expected, shown.shape), abs=1e-12)
    deep = ~liquid_ones & (y < -2.4 * DX)  # beyond the support
    assert (sim.state.array("shown_velocity")[deep] == 0.0).all()


def test_a_small_ball_has_the_curvature_of_a_ball(configure, liquid):
    """R/dx 6: 2/R is more than the printed bound 1/(2 h_s), at which the pressure would not depend on the shape."""
    radius, sigma = 50 * UM, 1.8
    ball = {"shape": "droplet", "centre": [0.0] * 3, "radius": radius, "material": "steel"}
    metal = liquid(density=RHO, viscosity=0.006, surface_tension=sigma)
    config = configure(dimension=3, spacing=radius / 6, materials={"steel": metal}, bodies=[ball],
                       physics={**FLOW_ONLY, "surface_tension": True})  # fmt: skip
    sim = Simulation(config)
    sim.compile()
    sim.surface.step()
    outermost = sim.state.array("at_surface") > 0.99
    curvature = sim.state.array("capillary")[outermost] / sigma
    assert curvature.mean() == pytest.approx(
        2 / radius, rel=0.05
    )  # a lattice's steps; the bound would be 17 % off
    assert sim.ledger.clamp_counts()["curvature_clips"] == 0
