"""What a subject found, and how it is written: JSON, CSV, plots, and a page made of them."""

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from taichi_slm.benchmark.goals import asked_and_reached
from taichi_slm.output.atomic import make_folder, write_text
from taichi_slm.verification.case import Curve, Plot

Cell = str | int | float | None


@dataclass(frozen=True)
class Table:
    """Rows under named columns; a column's unit stands in its name."""

    name: str  # of its file
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    note: str = ""


@dataclass
class Findings:
    """The tables and plots of a subject, filled while it is measured."""

    tables: list[Table] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)

    def table(self, name: str, title: str, rows: Sequence[Mapping[str, Any]], note: str = "") -> None:
        """Add a table; its columns are the keys of all rows, in the order in which they come."""
        columns = list(dict.fromkeys(key for row in rows for key in row))
        self.tables.append(Table(name, title, columns, [[row.get(c) for c in columns] for row in rows], note))

    def plot(self, name: str, title: str, x: str, y: str, curves: Sequence[Curve],
             log: Literal["", "x", "y", "xy"] = "xy") -> None:  # fmt: skip
        """Add a picture; nothing if there is no curve with a point."""
        drawn = [curve for curve in curves if len(curve.x)]
        if drawn:
            self.plots.append(Plot(name, title, x, y, drawn, log))

    def to_json(self) -> dict[str, Any]:
        """Plain lists, numbers and strings."""
        return {
            "tables": [asdict(table) for table in self.tables],
            "plots": [asdict(plot) for plot in self.plots],
        }


def write_tables(subject: dict[str, Any], folder: Path) -> None:
    """A CSV file for every table."""
    for table in subject["tables"]:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(table["columns"])
        writer.writerows(table["rows"])
        write_text(folder / f"{table['name']}.csv", text.getvalue())


def draw_plots(subject: dict[str, Any], folder: Path) -> None:
    """A PNG for every plot."""
    if not subject["plots"]:
        return
    from taichi_slm.verification.plots import draw

    make_folder(folder)
    for plot in subject["plots"]:
        curves = [Curve(**curve) for curve in plot["curves"]]
        draw(Plot(**{**plot, "curves": curves}), folder / f"{plot['name']}.png")


def number(value: Cell) -> str:
    """Four significant digits of a float; text as it is."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else "not finite"
    return str(value)


def write_page(report: dict[str, Any], page: Path) -> None:
    """Write ``page`` (Markdown) from the content of bench.json, its plots into images/performance/ beside it."""
    head = [
        "# Performance", "",
        "This page is written by `taichi-slm bench --out docs/bench --page docs/performance.md`; do not edit it. "
        "With the name of a subject that one is measured anew; what the others found stands in docs/bench/bench.json, "
        "and each says its commit and its machine.", "",
        "Every number was measured. Those of one table come from one run on one machine; what is compared was measured "
        "in turn, and ratios are medians over the turns. Seconds drift with the machine, ratios do not.", "",
    ]  # fmt: skip
    goals = Findings()
    goals.table("goals", "Asked and reached", asked_and_reached(report),
                "On two cores and in f64; each number is from a table below, of several the worst, and so is the limit "
                "of this machine, where one was found. What a limit leaves out is said there. Where one is not kept, "
                "the table named beside it says what is in the way.")  # fmt: skip
    if goals.tables[0].rows:
        head += _lines(goals.to_json()["tables"][0], "##")

    def opening(name: str, subject: dict[str, Any]) -> list[str]:
        said = [f"`taichi-slm bench {name}`, {subject['seconds']:.0f} s. ", _where(subject)]
        return [*said, "", subject["about"], ""]

    write_subjects(report, page, "performance", head, opening)


def write_subjects(report: dict[str, Any], page: Path, images: str, head: Sequence[str],
                   opening: Callable[[str, dict[str, Any]], list[str]]) -> None:  # fmt: skip
    """Write ``page``: ``head``, then every subject with its ``opening`` lines, tables and plots.

    The plots go into images/``images``/ beside it.
    """
    lines = list(head)
    for name, subject in report["subjects"].items():
        lines += [f"## {subject['title']}", "", *opening(name, subject)]
        for table in subject["tables"]:
            lines += _lines(table, "###")
        draw_plots(subject, page.parent / "images" / images)
        for plot in subject["plots"]:
            lines += [f"![{plot['title']}](images/{images}/{plot['name']}.png)", ""]
    write_text(page, "\n".join(lines).rstrip() + "\n")


def _where(subject: dict[str, Any]) -> str:
    at = subject["machine"]
    quick = " **A quick look, with small scenes.**" if subject["quick"] else ""
    return (
        f"Version {at['version']}, commit {at['git']}, Python {at['python']}, Taichi {at['taichi']}, "
        f"{at['processor']}, {at['cores']} cores. A fixed piece of work took between 1 and {number(subject['drift'])} "
        f"times its shortest time while this was measured.{quick}"
    )


def _lines(table: dict[str, Any], heading: str) -> list[str]:
    """``table`` in Markdown under a ``heading`` of that depth."""
    lines = [f"{heading} {table['title']}", "", *([table["note"], ""] if table["note"] else [])]
    lines += ["| " + " | ".join(table["columns"]) + " |", "|" + "---|" * len(table["columns"])]
    for row in table["rows"]:
        lines.append("| " + " | ".join(number(cell).replace("|", "\\|") for cell in row) + " |")
    return [*lines, ""]
