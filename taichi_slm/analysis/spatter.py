"""Metal that has left the pool: in flight, come back, or gone; terms in docs/analysis.md."""

from typing import Any

import numpy as np

from taichi_slm.analysis.pools import Melt
from taichi_slm.analysis.recording import Moment


class SpatterBook:
    """Collects a row per moment, and follows by id who ever flew and who is gone."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float | int]] = []
        self._mass = np.zeros(0)  # of each id [kg]; NaN for an id that the first snapshot lacks
        self._speed = np.zeros(0)  # when last seen [m/s], by id
        self._fastest = 0.0
        self._flew = self._flies = self._here = np.zeros(0, dtype=bool)

    def see(self, moment: Moment, melt: Melt) -> None:
        """Add ``moment``, its liquid sorted as ``melt``."""
        ids, deep = moment.id, moment.dimension == 3
        if not self.rows:
            count = int(ids.max()) + 1
            self._mass = np.full(count, np.nan)
            self._mass[ids] = moment.mass
            self._speed = np.zeros(count)
            self._flew = np.zeros(count, dtype=bool)
        self._flies, self._here = np.zeros_like(self._flew), np.zeros_like(self._flew)
        flying = melt.flying
        speed = np.linalg.norm(moment.velocity, axis=1)
        self._speed[ids] = speed
        self._here[ids] = True
        self._flies[ids[flying]] = True
        self._flew |= self._flies
        flight, mass = speed[flying], moment.mass[flying]
        if len(flying):
            self._fastest = max(self._fastest, float(flight.max()))
        drops = np.bincount(melt.group, moment.mass[melt.rows], len(melt.size))[~melt.resting]
        gone = self._gone
        unit = "kg" if deep else "kg_m"
        self.rows.append(
            {
                "time_s": moment.time,
                "drops": len(drops),
                "particles_in_flight": len(flying),
                f"mass_in_flight_{unit}": float(mass.sum()),
                f"largest_drop_{unit}": float(drops.max()) if len(drops) else 0.0,
                "mean_speed_m_s": float(np.average(flight, weights=mass)) if len(flying) else float("nan"),
                "max_speed_m_s": float(flight.max()) if len(flying) else float("nan"),
                "removed_particles": int(gone.sum()),
                f"removed_mass_{unit}": float(self._mass[gone].sum()),
            }
        )

    @property
    def _gone(self) -> np.ndarray:
        gone: np.ndarray = np.isfinite(self._mass) & ~self._here
        return gone

    def table(self) -> dict[str, list[float | int]]:
        """The columns of spatter.csv."""
        return {name: [row[name] for row in self.rows] for name in self.rows[0]} if self.rows else {}

    def chief(self) -> dict[str, Any]:
        """Who left in the whole run, and who came back."""
        gone = self._gone
        left = self._flew | gone
        back = self._flew & ~gone & ~self._flies
        unit = next((name[15:] for name in self.table() if name.startswith("mass_in_flight_")), "kg")
        return {
            "ejected_particles": int(left.sum()),
            f"ejected_mass_{unit}": float(self._mass[left].sum()),
            "returned_particles": int(back.sum()),
            f"returned_mass_{unit}": float(self._mass[back].sum()),
            "removed_particles": int(gone.sum()),
            f"removed_mass_{unit}": float(self._mass[gone].sum()),
            "most_drops_at_once": max((int(row["drops"]) for row in self.rows), default=0),
            "max_speed_in_flight_m_s": self._fastest,
            "median_last_speed_of_removed_m_s": float(np.median(self._speed[gone])) if gone.any() else None,
        }
