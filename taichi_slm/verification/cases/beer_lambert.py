"""Light on a slab, on powder, across the edge of the bed: what is absorbed and what passes make up A P.

Scene    a plate with a row of powder grains, 2-D and 3-D, a beam of A P 40 W, w 15 um, Gaussian and top hat, over the
         plate, over the powder, half over the edge and beside everything; the slab is the bare plate under the top hat
Exact    absorbed = A P - passed, with what passes computed on the host from the particles by Beer-Lambert and the
         beam's integral over every column of bins; slab: A I0 (1 - exp(-alpha L)), and the same for every layer
Measured the sum of the powers of all particles, and of every layer of the slab
Remarks  a bin of the lattice holds one layer, so a layer absorbs just what Beer-Lambert gives it. Weights are integers,
         rounded to 2^-40 of a full bin: some hundred of them leave 1e-13.
"""

import math

import numpy as np

from taichi_slm.physics.laser import line_power, shares
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import HEAT_ONLY, configure

UM = 1e-6
DX, DEPTH = 5 * UM, 12 * UM
POWER, ABSORPTIVITY = 100.0, 0.4
PLACES = {"plate": 22, "powder": 75, "last grain": 97.3, "edge": 120, "beside": 131}  # x of the beam [um]
ROUND_OFF = "sums of rounded integers and of doubles, some hundred each"


def scene(dimension: int) -> Simulation:
    """The plate with a row of grains under a beam, heat alone, nothing skipped."""
    plate = {"shape": "plate", "length": 120 * UM, "depth": 40 * UM}
    if dimension == 3:
        plate["width"] = 60 * UM
    row = {"shape": "powder_row", "start": 60 * UM, "length": 60 * UM, "radius": 15 * UM}
    beam = {"power": POWER, "beam_radius": 15 * UM, "absorptivity": ABSORPTIVITY, "absorption_depth": DEPTH,
            "path": [{"kind": "dwell", "at": [0.7 * UM, 0.9 * UM][: dimension - 1], "duration": 1}]}  # fmt: skip
    config = configure(dimension=dimension, spacing=DX, bodies=[plate, row], laser=beam,
                       physics=HEAT_ONLY, performance={"skip_dark": False, "skip_cold": False})  # fmt: skip
    return Simulation(config, threads=1)


def incident(sim: Simulation) -> float:
    """A P [W], in 2-D A times the power of the middle line [W/m]."""
    assert sim.bins is not None
    return ABSORPTIVITY * POWER * line_power(sim.bins.laser, sim.scene.dimension)


def absorbed(sim: Simulation, centre: tuple[float, ...]) -> np.ndarray:
    """Power of every particle [W] under a beam at ``centre`` [m]."""
    assert sim.bins is not None
    if sim.activity.builds == 0:
        sim.compile()
    sim.activity.beam_at(centre)
    sim.activity.neighbours()
    sim.bins.absorb(centre, incident(sim))
    return sim.state.array("laser")


def passed(sim: Simulation, centre: tuple[float, ...]) -> float:
    """What misses the particles or goes through them [W], from their places and volumes."""
    assert sim.bins is not None
    bins, d = sim.bins, sim.scene.dimension
    place = (sim.position - bins.lower) / bins.size
    base = np.floor(place).astype(int)
    filling = np.zeros(bins.nodes)
    for corner in np.stack(np.meshgrid(*[[0, 1]] * d, indexing="ij"), axis=-1).reshape(-1, d):
        weight = sim.state.array("volume") * np.prod(1.0 - np.abs(place - (base + corner)), axis=1)
        np.add.at(filling, tuple((base + corner).T), weight / bins.size**d)
    edges = [o + bins.size * (np.arange(n + 1) - 0.5) - x
             for o, n, x in zip(bins.lower, bins.nodes, centre, strict=False)]  # fmt: skip
    share = shares(bins.laser, edges)
    through = np.exp(-np.minimum(filling, 1.0).sum(axis=-1) * bins.size / DEPTH)
    return float(incident(sim) * (1.0 - np.sum(share * (1.0 - through))))


def conserved(outcome: Outcome, sim: Simulation) -> None:
    """Plate, powder, edge; Gaussian and top hat: the worst of each."""
    assert sim.bins is not None
    dimension, laser = sim.scene.dimension, sim.bins.laser
    for name, x in PLACES.items():
        worst = 0.0
        for profile in ("gaussian", "top_hat"):
            sim.bins.laser = laser.model_copy(update={"profile": profile})
            centre = (x * UM, 0.9 * UM)[: dimension - 1]
            total = absorbed(sim, centre).sum() + passed(sim, centre)
            worst = max(worst, abs(total / incident(sim) - 1.0))
        outcome.judge(f"absorbed + passed over A P, {dimension}-D, {name}", 1.0 + worst, 1.0, error=worst, limit=1e-12,
                      why=ROUND_OFF)  # fmt: skip


def slab(outcome: Outcome, sim: Simulation) -> Curve:
    """Layer by layer, under a top hat that falls on the bare plate whole."""
    assert sim.bins is not None
    dimension = sim.scene.dimension
    sim.bins.laser = sim.bins.laser.model_copy(update={"profile": "top_hat"})
    power = absorbed(sim, (PLACES["plate"] * UM, 0.9 * UM)[: dimension - 1]) / incident(sim)
    layer = np.round(-sim.position[:, -1] / DX - 0.5).astype(int)
    plate = layer >= 0
    found = np.cumsum(np.bincount(layer[plate], power[plate]))
    z = DX * np.arange(1, len(found) + 1)
    exact = -np.expm1(-z / DEPTH)
    outcome.judge(
        f"slab, {dimension}-D: absorbed over A P", found[-1], float(exact[-1]), limit=1e-12, why=ROUND_OFF
    )
    worst = float(np.abs(found / exact - 1).max())
    outcome.judge(f"slab, {dimension}-D: down to each layer, worst", worst, error=worst, limit=1e-11,
                  why="integer weights of one column, 2^-40 each")  # fmt: skip
    return Curve(f"{dimension}-D", z, found, "points")


def compute(outcome: Outcome) -> None:
    """2-D and 3-D."""
    curves = []
    for dimension in (2, 3):
        sim = scene(dimension)
        conserved(outcome, sim)
        curves.append(slab(outcome, sim))
    z = np.linspace(0, 8 * DX, 100)
    curves.append(Curve("1 - exp(-z/depth)", z, -np.expm1(-z / DEPTH)))
    assert math.isclose(z[-1], 40 * UM)
    outcome.plot("beer_lambert", "Light absorbed down to a depth", "depth [m]", "absorbed / A P", curves)


CASES = [Case("beer_lambert", "Beer-Lambert: slab, powder, edge of the bed", "exact", "quick", compute)]
