"""What a verification case is, and what comes out of one."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

Tier = Literal["quick", "full", "long"]


@dataclass(frozen=True)
class Row:
    """One number of a case. Without a limit it is shown, not judged; ``at_least``: it is the number that is judged."""

    quantity: str
    computed: float
    exact: float | None = None
    error: float | None = None
    limit: float | None = None
    unit: str = ""
    why: str = ""  # of the limit; of a number that is only shown: what it shows
    at_least: bool = False
    asked: float | None = (
        None  # the limit that was asked for, where the scheme cannot keep it and a wider one is set
    )

    @property
    def bound(self) -> str:
        """The limit as it stands in tables; empty without one."""
        if self.limit is None:
            return ""
        wider = "" if self.asked is None else f" (asked {self.asked:.4g})"
        return ("≥ " if self.at_least else "") + f"{self.limit:.4g}{wider}"

    @property
    def holds(self) -> bool:
        """Whether the limit is kept; a NaN keeps none."""
        if self.limit is None:
            return True
        if self.at_least:
            return self.computed >= self.limit
        return self.error is not None and self.error <= self.limit


@dataclass(frozen=True)
class Curve:
    """One line or one set of points of a plot."""

    label: str
    x: Any  # numbers, shape [n]
    y: Any  # numbers, or names that stand on the axis from above in their order
    style: Literal["line", "dashed", "points"] = "line"


@dataclass(frozen=True)
class Plot:
    """A picture of a case, as numbers: drawn later, by who has matplotlib loaded."""

    name: str  # of its file
    title: str
    x: str  # axis label, with its unit
    y: str
    curves: Sequence[Curve]
    log: Literal["", "x", "y", "xy"] = ""


@dataclass
class Outcome:
    """The rows and plots of a case, filled while it runs."""

    rows: list[Row] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)

    def judge(self, quantity: str, computed: float, exact: float | None = None, *, limit: float, why: str,
              error: float | None = None, unit: str = "", asked: float | None = None) -> None:  # fmt: skip
        """A number with a limit on its error, which is relative to ``exact`` unless given.

        ``asked`` is the limit that was asked for, where ``limit`` had to be wider; ``why`` then says the cause.
        """
        if error is None:
            assert exact, "an error relative to nothing must be given"
            error = abs(computed / exact - 1.0)
        self.rows.append(Row(quantity, float(computed), exact, float(error), limit, unit, why, asked=asked))

    def show(self, quantity: str, computed: float, exact: float | None = None, *, unit: str = "",
             note: str = "") -> None:  # fmt: skip
        """A number without a limit."""
        error = abs(computed / exact - 1.0) if exact else None
        self.rows.append(Row(quantity, float(computed), exact, error, None, unit, note))

    def order(self, quantity: str, spacings: Sequence[float], errors: Sequence[float], *,
              at_least: float | None = None, why: str = "") -> None:  # fmt: skip
        """The observed order of convergence: the slope of log error against log spacing, three spacings or more."""
        assert len(spacings) >= 3, "an order needs three spacings"
        slope = float(np.polyfit(np.log(spacings), np.log(errors), 1)[0])
        self.rows.append(Row(quantity, slope, None, None, at_least, "", why, at_least=True))

    def at_least(self, quantity: str, computed: float, *, limit: float, why: str, unit: str = "") -> None:
        """A number that must not be below its limit."""
        self.rows.append(Row(quantity, float(computed), None, None, limit, unit, why, at_least=True))

    def plot(self, name: str, title: str, x: str, y: str, curves: Sequence[Curve],
             log: Literal["", "x", "y", "xy"] = "") -> None:  # fmt: skip
        """Add a picture."""
        self.plots.append(Plot(name, title, x, y, curves, log))

    def to_json(self) -> dict[str, Any]:
        """Plain lists, numbers and strings."""
        rows = [{**asdict(row), "holds": row.holds} for row in self.rows]
        return {"rows": rows, "plots": [_plain(asdict(plot)) for plot in self.plots]}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> "Outcome":
        """What :meth:`to_json` wrote; a number that is not finite is null in a file."""
        rows = [Row(**{k: v for k, v in row.items() if k != "holds"}) for row in data["rows"]]
        rows = [replace(row, computed=math.nan) if row.computed is None else row for row in rows]
        plots = [
            Plot(**{**plot, "curves": [Curve(**curve) for curve in plot["curves"]]}) for plot in data["plots"]
        ]
        return cls(rows, plots)


@dataclass(frozen=True)
class Case:
    """A case: its group (a heading), its tier and the function that fills an :class:`Outcome`.

    ``quick`` cases take seconds and run in every test, ``full`` ones up to a few minutes, ``long`` ones more.
    """

    name: str
    title: str
    group: Literal["paper", "exact", "measured"]
    tier: Tier
    compute: Callable[[Outcome], None]

    def run(self) -> Outcome:
        """Compute it, here and now; Taichi is restarted by every simulation in it."""
        outcome = Outcome()
        self.compute(outcome)
        return outcome


def _plain(value: Any) -> Any:
    """The same with arrays as lists and numpy's numbers as Python's."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value
