"""What the cases with a melt pool share: the pool over time, and the track that is left."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_slm.analysis.melt_pool import MeltPool, Track, measure, solid_track
from taichi_slm.config.schema import Config
from taichi_slm.errors import BlowUpError
from taichi_slm.run.recorder import melting_points
from taichi_slm.run.simulation import Simulation

_NO_SULPHUR = {
    "316L": {"extends": "316L", "surface_tension": {"line": {"value": 1.593, "slope": -4e-4, "at": 1708}}}
}
VARIANTS: dict[str, dict[str, Any]] = {
    "conduction only": {"physics": {"flow": False, "evaporation": False, "recoil": False}},
    "no Marangoni flow": {"physics": {"marangoni": False}},
    "slope of sigma negative": {"materials": _NO_SULPHUR},
    "no evaporation": {"physics": {"evaporation": False, "recoil": False}},
}
"""What the runs of measured pools of 316L leave out or turn around, one at a time, to tell what a gap is due to."""


@dataclass
class PoolHistory:
    """Sizes of the pool [m] and what goes with them, shape [n] each; shorter than asked for if the run ended itself."""

    time: np.ndarray  # [s]
    length: np.ndarray  # along x
    width: np.ndarray  # along y; NaN in 2-D
    depth: np.ndarray
    hottest: np.ndarray  # [K]
    fastest: np.ndarray  # [m/s]
    track: Track = field(default_factory=Track)
    removed_kg: float = 0.0
    energy_error: float = 0.0
    failure: str = ""

    def largest(self, name: str) -> float:
        """Largest value at any time; NaN if the run ended before the first."""
        return float(np.max(getattr(self, name))) if len(self.time) else float("nan")

    def mean(self, name: str, after: float, until: float = np.inf) -> float:
        """Mean of a size over the times in (after, until] [s]: equal runs scatter by some 5 % at one instant."""
        chosen = (self.time > after) & (self.time <= until)
        return float(np.mean(getattr(self, name)[chosen])) if chosen.any() else float("nan")


def pool_now(sim: Simulation) -> MeltPool:
    """The pool at this moment."""
    names = ("position", "temperature", "liquid_fraction", "material", "wall")
    x, temperature, fraction, material, wall = sim.arrays(names).values()
    melting = melting_points(sim.scene.materials)[material]
    melting[wall.astype(bool)] = np.inf
    return measure(x, temperature, fraction, melting, sim.config.spacing)


def watch_pool(
    config: Config, times: Iterable[float], threads: int | None = None
) -> tuple[PoolHistory, Simulation]:
    """Run ``config`` through ``times`` [s], measuring the pool at each; stops where the scene ends or blows up."""
    sim = Simulation(config, threads=threads)
    rows, failure = [], ""
    for t in times:
        try:
            sim.advance(t)
        except BlowUpError as error:
            failure = str(error)
            break
        pool = pool_now(sim)
        width = np.nan if pool.width is None else pool.width
        speed = (
            float(np.linalg.norm(sim.arrays(("velocity",))["velocity"], axis=1).max())
            if config.physics.flow
            else 0.0
        )
        rows.append([sim.time, pool.length, width, pool.depth, sim.hottest, speed])
        if sim.finished:
            break
    found = PoolHistory(*np.array(rows).reshape(-1, 6).T)
    found.failure = failure
    row = sim.diagnostics()
    found.removed_kg, found.energy_error = float(row.get("removed_kg") or 0.0), float(row["energy_error"])
    arrays = sim.arrays()
    if not failure:
        names = ("position", "liquid_fraction", "ever_liquid", "wall")
        position, fraction, ever, wall = (arrays[name] for name in names)
        found.track = solid_track(position, fraction, ever, config.spacing, wall)
    return found, sim
