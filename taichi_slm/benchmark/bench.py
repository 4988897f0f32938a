"""Measure subjects one after the other; bench.json, a CSV file for every table, plots."""

import difflib
import importlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table as Shown

from taichi_slm.benchmark.measure import Yardstick, machine, scatter
from taichi_slm.benchmark.report import Findings, draw_plots, number, write_tables
from taichi_slm.errors import ConfigError
from taichi_slm.output.atomic import make_folder, write_json
from taichi_slm.run.run_folder import read_json

SUBJECTS = {
    "accuracy": "Run time against error",
    "speed": "Time of every pass, and of the same pass in C++",
    "skips": "What each skip saves, and what it changes",
    "scaling": "Cost against size, threads and start",
}


def chosen(names: Sequence[str]) -> list[str]:
    """The subjects of those names, or all; a ConfigError for a name that is none."""
    for name in names:
        if name not in SUBJECTS:
            near = difflib.get_close_matches(name, SUBJECTS, n=1)
            raise ConfigError(
                f"there is no subject '{name}'; "
                + (f"did you mean '{near[0]}'?" if near else "there are " + ", ".join(SUBJECTS))
            )
    return [name for name in SUBJECTS if name in names or not names]


def bench(names: Sequence[str], out: Path, quick: bool, console: Console) -> dict[str, Any]:
    """Measure the subjects into the folder ``out``; returns the content of bench.json.

    Subjects that stand in an earlier bench.json there and are not measured now stay in it; each names its commit.
    """
    make_folder(out)
    file = out / "bench.json"
    found: dict[str, Any] = read_json(file)["subjects"] if file.is_file() else {}
    for name in names:
        console.print(f"measuring {name}: {SUBJECTS[name]}", highlight=False)
        found[name] = measure_subject(name, quick)
        ordered = {each: found[each] for each in SUBJECTS if each in found}
        write_json(file, {"subjects": ordered})
        write_tables(found[name], out)
        draw_plots(found[name], out / "plots")
        _show(found[name], console)
    console.print(f"{file}; a CSV file for every table; plots in {out / 'plots'}", highlight=False)
    return read_json(file)


def measure_subject(name: str, quick: bool) -> dict[str, Any]:
    """What the subject's module finds, with where, when and how it was measured."""
    module = importlib.import_module(f"taichi_slm.benchmark.{name}")
    findings, yardstick = Findings(), Yardstick()
    began, started = time.perf_counter(), time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    yardstick.measure()
    yardstick.measure()
    yardstick.seconds.pop(0)  # the first one warms up
    module.compute(findings, quick, yardstick)
    yardstick.measure()
    about = " ".join((module.__doc__ or "").split("\n\n", 1)[-1].split())
    return {
        "title": SUBJECTS[name], "about": about, "quick": quick, "started": started,
        "seconds": time.perf_counter() - began, "drift": scatter(yardstick.seconds), "machine": machine(),
        **findings.to_json(),
    }  # fmt: skip


def _show(subject: dict[str, Any], console: Console) -> None:
    for table in subject["tables"]:
        shown = Shown(title=table["title"])
        for column in table["columns"]:
            shown.add_column(column, overflow="fold")
        for row in table["rows"]:
            shown.add_row(*(number(cell) for cell in row))
        console.print(shown)
