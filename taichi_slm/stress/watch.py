"""A run that is watched: what it shows of an instability, and the criterion by which it is called stable.

A run is watched at ``INSTANTS`` equal parts of its time. It is unstable if, at any of them,

- it ended early (a BlowUpError: a particle lost, a value not finite, hotter than the tables go);
- the kinetic energy of the moving particles is above ``ENERGY`` times the largest of the reference in the same quarter
  of the run (and above 1 % of the reference's largest, and above what the scene calls still);
- somebody is faster than ``SPEED`` times the fastest of the reference at any time (and than 0.1 % of c0);
- the temperature is outside of that of the reference by more than ``HEAT`` of the reference's range;
- more particles were removed than in the reference and ``REMOVED_SHARE`` of the moving ones and two;
- the account of mass is off by more than ``MASS``, that of energy by more than ``ACCOUNT``;
- it took ``STEPS`` times as many steps as the multiple asks for: speeds are such that steps collapse.

The reference is the same scene with the default forms, in f64, at the default step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from taichi_slm.config.schema import Config
from taichi_slm.errors import BlowUpError
from taichi_slm.run.simulation import Simulation
from taichi_slm.state import MOBILE, REMOVED

INSTANTS, QUARTERS = 40, 4
ENERGY, SPEED, HEAT, REMOVED_SHARE, MASS, ACCOUNT, STEPS = 3.0, 3.0, 0.25, 0.01, 1e-6, 1e-2, 10.0
STEPS_AT_MOST = 400_000  # of any run


@dataclass
class Seen:
    """What was seen of a run; SI units, extremes over all instants."""

    kinetic: list[float] = field(default_factory=list)  # [J, in 2-D J/m] at each instant
    fastest: float = 0.0  # [m/s]
    hottest: float = 0.0  # [K]
    coldest: float = math.inf  # [K]
    mobile: int = 0
    removed: int = 0
    mass_error: float = 0.0
    energy_error: float = 0.0
    stored: float = 0.0  # heat [J, in 2-D J/m] at the end
    steps: int = 0
    share: float = 0.0  # of the run's time that was reached
    failure: str = ""
    ratios: dict[str, float] = field(
        default_factory=dict
    )  # longest flow step over each default limit at that moment

    def quarter(self, number: int) -> float:
        """Largest kinetic energy in a quarter of the run, 0 to 3."""
        length = INSTANTS // QUARTERS
        return float(np.max(self.kinetic[number * length : (number + 1) * length], initial=0.0))


def watch(config: Config, start: Callable[[Simulation], None], precision: str = "f64", reference: Seen | None = None,
          still: float = 0.0, steps_at_most: int = STEPS_AT_MOST) -> Seen:  # fmt: skip
    """Run ``config`` on one thread; given a ``reference``, stop at the first instant at which it is unstable."""
    sim, seen = Simulation(config, threads=1, precision=precision), Seen()
    start(sim)
    moves = ~sim.scene.wall
    try:
        for instant in range(1, INSTANTS + 1):
            _advance(sim, config.time.end * instant / INSTANTS, seen, steps_at_most)
            _look(sim, moves, seen)
            if reference is not None:
                seen.failure = fault(seen, reference, config.numerics.sound_speed, still)
            if seen.failure or sim.finished:
                break
    except BlowUpError as error:
        seen.failure = f"blew up: {error}"
    seen.steps, seen.share = sim.steps, sim.time / config.time.end
    return seen


def _advance(sim: Simulation, until: float, seen: Seen, steps_at_most: int) -> None:
    """Step to ``until`` or beyond, never shortening a step for it."""
    while sim.time < until * (1.0 - 1e-9) and not sim.finished:
        sim.step()
        if sim.flow_step is not None and sim.moving:
            limits = sim.limits.flow(sim.hottest, math.sqrt(sim.flow_step.flow.fastest))
            for name, limit in limits.items():
                seen.ratios[name] = max(seen.ratios.get(name, 0.0), sim.dt / limit)
        if sim.steps > steps_at_most:
            raise BlowUpError(f"steps collapsed to {sim.dt:.3g} s")


def _look(sim: Simulation, moves: np.ndarray, seen: Seen) -> None:
    """Take down the extremes of this moment."""
    mobility = sim.state.array("mobility")
    there = mobility != REMOVED
    temperature = sim.temperature[there].astype(np.float64)
    if sim.flow_step is not None:
        mobile = (mobility == MOBILE) & moves
        squares = np.sum(sim.velocity[mobile].astype(np.float64) ** 2, axis=1)
        seen.kinetic.append(float(0.5 * np.sum(sim.state.array("mass")[mobile] * squares)))
        fastest = float(np.sqrt(squares.max(initial=0.0)))
        seen.fastest = max(seen.fastest, fastest) if math.isfinite(fastest) else math.inf
        seen.mobile = max(seen.mobile, int(mobile.sum()))
    else:
        seen.kinetic.append(0.0)
    seen.hottest = max(seen.hottest, float(temperature.max()))
    seen.coldest = min(seen.coldest, float(temperature.min()))
    row = sim.diagnostics()
    seen.removed, seen.stored = int(row["removed"]), float(row["stored_J"])
    seen.mass_error = max(seen.mass_error, float(row["mass_error"]))
    seen.energy_error = max(seen.energy_error, float(row["energy_error"]))


def fault(seen: Seen, reference: Seen, c0: float, still: float = 0.0) -> str:
    """Why a run is unstable by the criterion above, as far as it was seen; empty if it is not."""
    largest = max(reference.kinetic, default=0.0)
    for number in range(QUARTERS):
        allowed = max(ENERGY * reference.quarter(number), 0.01 * largest, still)
        if not seen.quarter(number) <= allowed:
            return f"kinetic energy {_times(seen.quarter(number), reference.quarter(number))} that of the reference"
    if not seen.fastest <= max(SPEED * reference.fastest, 1e-3 * c0):
        return f"speed {_times(seen.fastest, reference.fastest)} that of the reference"
    span = HEAT * (reference.hottest - reference.coldest) + 1e-6 * reference.hottest
    if not (seen.hottest <= reference.hottest + span and seen.coldest >= reference.coldest - span):
        return f"temperatures from {seen.coldest:.0f} to {seen.hottest:.0f} K"
    if seen.removed > reference.removed + 2 + REMOVED_SHARE * reference.mobile:
        return f"{seen.removed} particles removed"
    if not seen.mass_error <= MASS:
        return f"mass error {seen.mass_error:.2g}"
    if not seen.energy_error <= ACCOUNT:
        return f"energy error {seen.energy_error:.2g}"
    return ""


def _times(value: float, reference: float) -> str:
    return f"{value / reference:.3g} times" if reference > 0 else f"{value:.3g}, far above"
