"""Map the stable steps, subject after subject; stress.json, a CSV file for every table, plots."""

import difflib
import functools
import importlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table as Shown

from taichi_slm.benchmark.measure import machine
from taichi_slm.benchmark.report import Findings, draw_plots, number, write_tables
from taichi_slm.errors import ConfigError
from taichi_slm.output.atomic import make_folder, write_json
from taichi_slm.run.run_folder import read_json
from taichi_slm.stress import edges

SUBJECTS = {
    "drop": "The largest stable step of each limit: the drop",
    "column": "The largest stable step of each limit: the column",
    "weld": "The largest stable step of each limit: the weld",
    "track": "The largest stable step of each limit: the track",
    "drift": "Energy below the edge",
    "margins": "Margin of every shipped scene",
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


def stress(names: Sequence[str], out: Path, quick: bool, jobs: int, console: Console) -> dict[str, Any]:
    """Map the subjects into the folder ``out``, ``jobs`` searches at a time; returns the content of stress.json.

    Subjects that stand in an earlier stress.json there and are not mapped now stay in it; each names its commit.
    """
    make_folder(out)
    file = out / "stress.json"
    found: dict[str, Any] = read_json(file)["subjects"] if file.is_file() else {}
    for name in names:
        console.print(f"mapping {name}: {SUBJECTS[name]}", highlight=False)
        found[name] = map_subject(name, quick, jobs, console)
        write_json(file, {"subjects": {each: found[each] for each in SUBJECTS if each in found}})
        write_tables(found[name], out)
        draw_plots(found[name], out / "plots")
        _show(found[name], console)
    console.print(f"{file}; a CSV file for every table; plots in {out / 'plots'}", highlight=False)
    return read_json(file)


def map_subject(name: str, quick: bool, jobs: int, console: Console) -> dict[str, Any]:
    """What the subject's module finds, with where, when and how."""
    mapped = name in edges.SUBJECTS
    module = edges if mapped else importlib.import_module(f"taichi_slm.stress.{name}")
    compute = functools.partial(edges.compute, name) if mapped else module.compute
    findings = Findings()
    began, started = time.perf_counter(), time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    compute(findings, quick, jobs, lambda line: console.print(line, highlight=False, markup=False))
    about = (module.__doc__ or "").split("\n\n", 1)[-1].strip()
    return {
        "title": SUBJECTS[name], "about": about, "quick": quick, "started": started,
        "seconds": time.perf_counter() - began, "machine": machine(), **findings.to_json(),
    }  # fmt: skip


def _show(subject: dict[str, Any], console: Console) -> None:
    for table in subject["tables"]:
        shown = Shown(title=table["title"])
        for column in table["columns"]:
            shown.add_column(column, overflow="fold")
        for row in table["rows"]:
            shown.add_row(*(number(cell) for cell in row))
        console.print(shown)
