"""What a run reports of itself: accounts, extremes and clamps, one row at a time."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taichi_slm.solver.ledger import ENERGY
from taichi_slm.solver.survey import (
    FASTEST,
    MOBILE_COUNT,
    MOMENTUM,
    MOMENTUM_SCALE,
    PRESENT_MASS,
    STORED,
    Survey,
)
from taichi_slm.state import MOBILE, REMOVED

if TYPE_CHECKING:
    from taichi_slm.run.simulation import Simulation


class Books(NamedTuple):
    """What no account explains, and the size of all momenta [N s, in 2-D N s/m]."""

    energy_error: float  # over the turnover
    unexplained: float  # energy [J, in 2-D J/m]
    mass_error: float  # over the mass at the beginning
    momentum: float


class Accounts:
    """Reads a simulation's state and ledger. Energies are in J, in 2-D in J/m; momenta in N s, in 2-D in N s/m."""

    def __init__(self, simulation: "Simulation"):
        self._sim = simulation
        self.survey = Survey(simulation.state, simulation.disc, simulation.ledger, simulation.activity)
        self._d = simulation.disc.dimension
        self.incident = 0.0  # laser energy that reached the scene, times the absorptivity [J]

    def row(self) -> dict[str, float | int | str]:
        """Column -> value, the names of the history file."""
        sim = self._sim
        found = self.survey()
        energy, removed_mass = self._accounts(found)
        books = self.books(found)
        mobility = sim.state.array("mobility")
        hottest = np.fmax.reduce(sim.temperature, where=mobility != REMOVED, initial=0.0)
        low, mean, high = self._packing(mobility == MOBILE)
        return {
            "step": sim.steps,
            "time_s": sim.time,
            "dt_s": sim.dt,
            "dt_limiter": sim.dt_limiter,
            "mobile": int(found[MOBILE_COUNT]),
            "hot": sim.rows.hot,
            "max_temperature_K": float(hottest),
            "max_speed_m_s": math.sqrt(found[FASTEST]),
            "absorbed_J": energy["absorbed"],
            "stored_J": float(found[STORED]),
            "radiated_J": energy["radiated"],
            "conducted_out_J": energy["conducted_out"],
            "energy_error": books.energy_error,
            "mass_error": books.mass_error,
            "removed": int(sim.ledger.removed[None]),
            "evaporated_J": energy["evaporated"],
            "removed_J": energy["removed"],
            "viscous_J": energy["viscous"],
            "passed_through_J": self.incident - energy["absorbed"],
            "removed_kg": removed_mass,
            "momentum_error": self._momentum_error(found),
            **{
                f"momentum_{axis}": float(part)
                for axis, part in zip("xyz", self._momentum(found), strict=False)
            },
            "packing_low": low,
            "packing_mean": mean,
            "packing_high": high,
            "list_builds": sim.activity.builds,
            "surface_evaluations": sim.surface.evaluations if sim.surface is not None else 0,
            **sim.ledger.clamp_counts(),
        }

    def books(self, found: np.ndarray | None = None) -> Books:
        """The errors of the accounts, from a survey: ``found``, or a new one."""
        sim = self._sim
        found = self.survey() if found is None else found
        (energy, removed_mass), stored = self._accounts(found), float(found[STORED])
        brought = energy["absorbed"] + energy["viscous"]
        left = energy["radiated"] + energy["evaporated"] + energy["conducted_out"] + energy["removed"]
        unexplained, scale = abs(brought - stored - left), max(abs(brought), abs(stored), left)
        lost = float(found[PRESENT_MASS]) + removed_mass - sim.initial_mass
        return Books(
            unexplained / scale if scale != 0.0 else 0.0,  # NaN stays NaN
            unexplained,
            abs(lost) / sim.initial_mass,
            float(found[MOMENTUM_SCALE]),
        )

    def _momentum(self, found: np.ndarray) -> np.ndarray:
        return found[MOMENTUM : MOMENTUM + self._d]

    def _accounts(self, found: np.ndarray) -> tuple[dict[str, float], float]:
        """Energy accounts by name [J], and the removed mass [kg], from a survey."""
        removed, *energies = found[MOMENTUM + self._d :].tolist()
        return dict(zip(ENERGY, energies, strict=True)), removed

    def present_mass(self) -> float:
        """Mass of all particles that are not removed [kg], summed in the order of every later sum."""
        return float(self.survey()[PRESENT_MASS])

    def momentum(self) -> dict[str, list[float]]:
        """The momentum account by name [N s]: present = initial + gravity + walls + surface - frozen - removed."""
        sim = self._sim
        parts = {name: part.tolist() for name, part in sim.ledger.impulses().items()}
        return {
            "initial": sim.initial_momentum.tolist(),
            **parts,
            "present": self._momentum(self.survey()).tolist(),
        }

    def _momentum_error(self, found: np.ndarray) -> float:
        """Momentum that no account explains, over the sum of the accounts' magnitudes."""
        impulses = self._sim.ledger.impulses()
        came = impulses["gravity"] + impulses["walls"] + impulses["surface"]
        went = impulses["frozen"] + impulses["removed"]
        unexplained = self._momentum(found) - self._sim.initial_momentum - came + went
        scale = sum(float(np.linalg.norm(part)) for part in impulses.values()) + float(found[MOMENTUM_SCALE])
        return float(np.linalg.norm(unexplained)) / scale if scale > 0 else 0.0

    def _packing(self, mobile: np.ndarray) -> tuple[float, float, float]:
        """5th percentile, mean and 95th percentile of Gamma / Gamma_flat(depth) over the ``mobile`` particles."""
        sim = self._sim
        if not mobile.any() or sim.flow_step is None or sim.flow_step.count == 0:
            return 1.0, 1.0, 1.0
        gamma = sim.state.array("shepard")[mobile].astype(np.float64)
        flat = sim.disc.flat
        share = np.zeros_like(gamma)
        if sim.state.needs.surface:
            share = sim.state.array("colour_strength")[mobile] * sim.disc.h_surface / flat.largest
        ideal = np.interp(share, np.linspace(0.0, 1.0, len(flat.shepard)), flat.shepard)
        ratio = gamma / ideal
        low, high = np.percentile(ratio, [5.0, 95.0])
        return float(low), float(ratio.mean()), float(high)
