"""Subjects that are measured one after the other into one report: what `bench` and `stress` have in common."""

import difflib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table as Shown

from taichi_slm.benchmark.measure import machine
from taichi_slm.benchmark.report import Findings, draw_plots, number, write_tables
from taichi_slm.errors import ConfigError
from taichi_slm.output.atomic import make_folder, write_json
from taichi_slm.run.run_folder import read_json


def chosen(names: Sequence[str], subjects: Mapping[str, str]) -> list[str]:
    """Those of ``subjects`` with these names, or all; a ConfigError for a name that is none."""
    for name in names:
        if name not in subjects:
            near = difflib.get_close_matches(name, subjects, n=1)
            raise ConfigError(
                f"there is no subject '{name}'; "
                + (f"did you mean '{near[0]}'?" if near else "there are " + ", ".join(subjects))
            )
    return [name for name in subjects if name in names or not names]


def collect(names: Sequence[str], file: Path, subjects: Mapping[str, str], measure: Callable[[str], dict[str, Any]],
            console: Console) -> dict[str, Any]:  # fmt: skip
    """Measure the subjects ``names`` into ``file``, a CSV file for every table and plots; returns the file's content.

    Subjects that stand in an earlier ``file`` and are not measured now stay in it; each names its commit.
    """
    out = file.parent
    make_folder(out)
    found: dict[str, Any] = read_json(file)["subjects"] if file.is_file() else {}
    for name in names:
        console.print(f"measuring {name}: {subjects[name]}", highlight=False)
        found[name] = {"title": subjects[name]} | measure(name)
        write_json(file, {"subjects": {each: found[each] for each in subjects if each in found}})
        write_tables(found[name], out)
        draw_plots(found[name], out / "plots")
        _show(found[name], console)
    console.print(f"{file}; a CSV file for every table; plots in {out / 'plots'}", highlight=False)
    return read_json(file)


def timed(compute: Callable[[Findings], None], quick: bool) -> dict[str, Any]:
    """What ``compute`` finds, with when, for how long and on which machine."""
    findings = Findings()
    began, started = time.perf_counter(), time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    compute(findings)
    return {"quick": quick, "started": started, "seconds": time.perf_counter() - began, "machine": machine(),
            **findings.to_json()}  # fmt: skip


def _show(subject: dict[str, Any], console: Console) -> None:
    for table in subject["tables"]:
        shown = Shown(title=table["title"])
        for column in table["columns"]:
            shown.add_column(column, overflow="fold")
        for row in table["rows"]:
            shown.add_row(*(number(cell) for cell in row))
        console.print(shown)
