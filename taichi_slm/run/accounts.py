"""What a run reports of itself: accounts, extremes and clamps, one row at a time."""

from typing import TYPE_CHECKING

import numpy as np

from taichi_slm.state import MOBILE, REMOVED

if TYPE_CHECKING:
    from taichi_slm.run.simulation import Simulation


class Accounts:
    """Reads a simulation's state and ledger. Energies are in J, in 2-D in J/m."""

    def __init__(self, simulation: "Simulation"):
        self._sim = simulation
        self.incident = 0.0  # laser energy that reached the scene, times the absorptivity [J]

    def row(self) -> dict[str, float | int | str]:
        """Column -> value, the names of the history file."""
        sim, state = self._sim, self._sim.state
        energy = sim.ledger.energies()
        mobility = state.array("mobility")
        mobile = mobility == MOBILE
        mass = state.array("mass").astype(np.float64)
        stored = 0.0
        if state.needs.heat:
            stored = float(np.dot(mass, state.array("enthalpy") - state.array("enthalpy_initial")))
        brought = energy["absorbed"] + energy["viscous"]
        left = energy["radiated"] + energy["evaporated"] + energy["conducted_out"] + energy["removed"]
        scale = max(abs(brought), abs(stored), left)
        present = float(mass.sum())
        removed_mass = float(sim.ledger.removed_mass[None])
        there = mobility != REMOVED
        speed = np.linalg.norm(state.array("velocity")[mobile], axis=1) if mobile.any() else np.zeros(1)
        low, mean, high = self._packing(mobile)
        return {
            "step": sim.steps, "time_s": sim.time, "dt_s": sim.dt, "dt_limiter": sim.dt_limiter,
            "mobile": int(mobile.sum()), "hot": sim.rows.total,
            "max_temperature_K": float(state.array("temperature")[there].max()),
            "max_speed_m_s": float(speed.max()),
            "absorbed_J": energy["absorbed"], "stored_J": stored, "radiated_J": energy["radiated"],
            "conducted_out_J": energy["conducted_out"],
            "energy_error": abs(brought - stored - left) / scale if scale > 0 else 0.0,
            "mass_error": abs(present + removed_mass - sim.initial_mass) / sim.initial_mass,
            "removed": int(sim.ledger.removed[None]),
            "evaporated_J": energy["evaporated"], "removed_J": energy["removed"], "viscous_J": energy["viscous"],
            "passed_through_J": self.incident - energy["absorbed"],
            "removed_kg": removed_mass, "momentum_error": self._momentum_error(mass, mobile),
            "packing_low": low, "packing_mean": mean, "packing_high": high,
            "list_builds": sim.activity.builds,
            **sim.ledger.clamp_counts(),
        }  # fmt: skip

    def _momentum_error(self, mass: np.ndarray, mobile: np.ndarray) -> float:
        """Momentum that no account explains, over the sum of the impulses' magnitudes."""
        sim = self._sim
        impulses = sim.ledger.impulses()
        velocity = sim.state.array("velocity").astype(np.float64)
        present = np.sum(mass[mobile, None] * velocity[mobile], axis=0)
        explained = (
            sim.initial_momentum + impulses["gravity"] + impulses["walls"] + impulses["surface"]
            - impulses["frozen"] - impulses["removed"]
        )  # fmt: skip
        scale = sum(float(np.linalg.norm(part)) for part in impulses.values())
        scale += float(np.sum(mass[mobile] * np.linalg.norm(velocity[mobile], axis=1)))
        return float(np.linalg.norm(present - explained)) / scale if scale > 0 else 0.0

    def _packing(self, mobile: np.ndarray) -> tuple[float, float, float]:
        """5th percentile, mean and 95th percentile of Gamma / Gamma_flat(depth) over the mobile particles."""
        sim = self._sim
        if not sim.state.needs.flow or not mobile.any() or sim.flow_step is None or sim.flow_step.count == 0:
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
