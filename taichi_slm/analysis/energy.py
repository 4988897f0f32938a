"""The energy account of a run, from its history: what came in, and what became of it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

SOURCES = (("absorbed_J", "laser, absorbed"), ("viscous_J", "viscous heating"))
ENDS = (
    ("stored_J", "stored in the metal"),
    ("conducted_out_J", "conducted out"),
    ("radiated_J", "radiated"),
    ("evaporated_J", "evaporation"),
    ("removed_J", "with removed particles"),
)


@dataclass(frozen=True)
class EnergyAccount:
    """Energies over time, shape [rows] each; in J, in 2-D in J/m."""

    time: np.ndarray  # [s]
    sources: dict[str, np.ndarray]
    ends: dict[str, np.ndarray]

    def closing(self) -> dict[str, float]:
        """The last row: every account, both sums, and what is missing between them."""
        row = {name: float(values[-1]) for name, values in (self.sources | self.ends).items()}
        incoming = sum(float(values[-1]) for values in self.sources.values())
        outgoing = sum(float(values[-1]) for values in self.ends.values())
        return {**row, "in_J": incoming, "out_J": outgoing, "unaccounted_J": incoming - outgoing}


def energy_account(history: Mapping[str, np.ndarray]) -> EnergyAccount | None:
    """The account in ``history``; None where it has no row. A column that is missing counts as 0."""
    time = history.get("time_s", np.zeros(0))
    if len(time) == 0:
        return None
    return EnergyAccount(
        time=time,
        sources={name: _column(history, name, len(time)) for name, _ in SOURCES},
        ends={name: _column(history, name, len(time)) for name, _ in ENDS},
    )


def _column(history: Mapping[str, np.ndarray], name: str, rows: int) -> np.ndarray:
    # an empty cell is that of physics which the scene has not: no energy
    return np.nan_to_num(history.get(name, np.zeros(rows)), nan=0.0)
