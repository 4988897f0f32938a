"""What was asked of this program's speed, beside what a report says of it.

A goal reads its number from the tables of a report, so that nothing is written twice; of several numbers it takes the
worst. One whose table was not measured has none. Beside it stands the limit of the machine where one was found.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from taichi_slm.benchmark.paper import PAPER_RUN

AT_MOST, AT_LEAST = "at most", "at least"
# rows of the table of passes that are no single pass
TOGETHER, UNFUSED = "all of them, once each", "all of them, beside C++ unfused"
TOLD_APART = 1.05  # factor from which two times of one machine can be told apart


@dataclass(frozen=True)
class Cells:
    """The cells ``column`` of the rows of a report's ``table`` that are like ``rows``."""

    table: str
    column: str
    rows: dict[str, str | int]
    but: tuple[str, ...] = ()  # values of a row's cells that leave it out

    def read(self, report: dict[str, Any]) -> list[float]:
        """Their numbers."""
        return [
            float(row[self.column]) for row in _rows(report, self.table)
            if all(row.get(name) == value for name, value in self.rows.items())
            and row.get(self.column) is not None and not set(self.but) & set(row.values())
        ]  # fmt: skip


@dataclass(frozen=True)
class Goal:
    """A number that was asked for, and the cells that hold it."""

    what: str
    bound: str  # AT_MOST or AT_LEAST
    asked: float
    cells: Cells
    see: str = ""  # title of the table that says where the time or the memory is
    limit: Cells | None = None  # what this machine could do

    def worst(self, cells: Cells, report: dict[str, Any]) -> float | None:
        """The worst of ``cells``; None where the report has none."""
        numbers = cells.read(report)
        if not numbers:
            return None
        return max(numbers) if self.bound == AT_MOST else min(numbers)

    def met(self, value: float) -> bool:
        """Whether ``value`` keeps the bound."""
        return value <= self.asked if self.bound == AT_MOST else value >= self.asked


def asked_and_reached(report: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for every goal that the content of bench.json has a number for."""
    rows = []
    for goal in (*_fronts(report), *_scenes(report), *GOALS):
        value = goal.worst(goal.cells, report)
        if value is not None:
            limit = goal.worst(goal.limit, report) if goal.limit is not None else None
            rows.append({"what": goal.what, "asked": f"{goal.bound} {goal.asked:g}", "reached": value,
                         "limit of this machine": limit,
                         "kept": "yes" if goal.met(value) else f'no: see "{goal.see}"'})  # fmt: skip
    return rows


def _rows(report: dict[str, Any], name: str) -> Iterator[dict[str, Any]]:
    for subject in report["subjects"].values():
        for table in subject["tables"]:
            if table["name"] == name:
                for cells in table["rows"]:
                    yield dict(zip(table["columns"], cells, strict=True))


def _fronts(report: dict[str, Any]) -> list[Goal]:
    """Default settings sit on the front of time and error in every case."""
    tables = report["subjects"].get("accuracy", {}).get("tables", ())
    return [
        Goal(f"default settings, {table['title'].partition(':')[0].lower()}: dominated by other settings by",
             AT_MOST, TOLD_APART, Cells(table["name"], "dominated by", {"settings": "f64"}), table["title"])
        for table in tables
    ]  # fmt: skip


def _scenes(report: dict[str, Any]) -> list[Goal]:
    """Whole scenes: what was asked stands beside what was reached."""
    see = "What would be left of the steps"
    return [
        Goal(f"{row['scene']}, to the last picture, s", AT_MOST, row["asked, s"],
             Cells("reach_runs", "wall, s", {"scene": row["scene"]}), see,
             Cells("reach_limits", "the run then, s", {"scene": row["scene"]}))
        for row in _rows(report, "reach_runs") if row.get("asked, s")
    ]  # fmt: skip


def _cpp(compiler: str, a_pass: float, together: float) -> list[Goal]:
    see = "The passes and plain C++ on the same lists, one thread"
    rows: dict[str, str | int] = {"compiler": compiler, "precision": "f64"}

    def cells(column: str) -> tuple[Cells, Cells]:
        return (Cells("speed_cpp", column, rows, (TOGETHER, UNFUSED)),
                Cells("speed_cpp", column, rows | {"pass": UNFUSED}))  # fmt: skip

    (each, all_), (limit_of_each, limit_of_all) = cells("over c++"), cells("limit over c++")
    return [
        Goal(f"each neighbour pass over plain C++, {compiler}", AT_MOST, a_pass, each, see, limit_of_each),
        Goal(
            f"the fused step over plain C++ unfused, {compiler}", AT_MOST, together, all_, see, limit_of_all
        ),
    ]


def _pysph(drop: str) -> list[Goal]:
    rows: dict[str, str | int] = {"drop": drop}
    see = "Where a step of the smallest drop goes"
    return [
        Goal(f"PySPH, {drop} drop, a step: times as long", AT_LEAST, 10.0,
             Cells("peers_steps", "time of a step", rows), see, Cells("peers_steps", "limit of a step", rows)),
        Goal(f"PySPH, {drop} drop, to an equal or smaller error: times as long", AT_LEAST, 20.0,
             Cells("peers_error", "time to an equal or smaller error", rows), see),
    ]  # fmt: skip


def _start(what: str, seconds: float, row: str) -> Goal:
    return Goal(f"{what}, s", AT_MOST, seconds, Cells("scaling_start", "seconds", {"what": row}),
                "Start: wall time of a process")  # fmt: skip


_PLATE: dict[str, str | int] = {"scene": "plate x 30"}
_MOBILE: dict[str, str | int] = {"drop": "3-D", "precision": "f64"}
GOALS = (
    Goal("a track without skips at the paper's steps: times as long", AT_LEAST, 20.0,
         Cells("skips", "time over all on", {"scene": "with flow", "skips": PAPER_RUN}), "One skip off at a time"),
    *_cpp("taichi", 2.0, 1.4),
    *_cpp("quadrants", 1.1, 0.8),
    *_pysph("square"),
    *_pysph("elliptic"),
    Goal("ten times as much cold plate: times as long", AT_MOST, 1.1,
         Cells("scaling_cold", "time over the first", _PLATE), "Where more cold metal costs time",
         Cells("scaling_cold", "limit", _PLATE)),
    _start("--help", 0.3, "taichi-slm --help"),
    _start("validate", 1.0, "taichi-slm validate"),
    _start("process to first step, warm", 3.0, "process to first step, kernels in the cache"),
    _start("process to first step, cold", 15.0, "process to first step, no kernels in the cache"),
    Goal("a cold particle in 3-D, bytes", AT_MOST, 500.0,
         Cells("scaling_memory_cold", "process, bytes per further cold particle", {"precision": "f64"}),
         "Memory of cold metal in 3-D"),
    Goal("a mobile particle in 3-D, bytes", AT_MOST, 2000.0,
         Cells("scaling_memory", "process, bytes per further particle", _MOBILE),
         "Memory of a drop with heat, flow and surface tension: all of it moves",
         Cells("scaling_memory", "with no room but for those", _MOBILE)),
)  # fmt: skip
