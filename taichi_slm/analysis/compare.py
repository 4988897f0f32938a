"""Runs side by side: the keys in which their scenes differ, their chief numbers, one plot of pools and profiles."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_slm.analysis.analyse import CHIEF, numbers_of
from taichi_slm.analysis.recording import open_run
from taichi_slm.config.schema import Config
from taichi_slm.config.units import unit_at
from taichi_slm.errors import ConfigError
from taichi_slm.output.atomic import make_folder
from taichi_slm.output.history import read_history
from taichi_slm.output.table import flat, write_table

if TYPE_CHECKING:
    from rich.console import Console

TABLES = ("pools", "track")  # what the plot needs


@dataclass(frozen=True)
class Compared:
    """One run of a comparison."""

    name: str
    config: Config
    numbers: dict[str, Any]  # analysis.json, keys joined by dots
    tables: dict[str, dict[str, np.ndarray]]  # of TABLES


def compare(runs: Sequence[Path], out: Path, console: "Console") -> None:
    """Analyse those of ``runs`` that are not yet; write ``out``/compare.csv and .png, and print a table.

    Raises ConfigError for less than two runs, StorageError for what is no run.
    """
    if len(runs) < 2:
        raise ConfigError("compare needs two run folders or more")
    names = _names(runs)
    found = [_look(run, name) for run, name in zip(runs, names, strict=True)]
    changes = differing([run.config for run in found])
    make_folder(out)
    write_table(out / "compare.csv", _columns(found, changes))
    from taichi_slm.analysis.figures import save
    from taichi_slm.analysis.overlay import overlay  # matplotlib, which --help does without

    save(overlay(found), out / "compare.png")
    _print(found, changes, console)
    console.print(
        f"written    {out}: compare.csv, compare.png", markup=False, highlight=False, soft_wrap=True
    )


def differing(configs: Sequence[Config]) -> dict[str, list[Any]]:
    """Keys in which ``configs`` differ, with the value of each (None where it has no such key); no titles."""
    flattened = [flat(config.model_dump(mode="json"), lists=True) for config in configs]
    keys = dict.fromkeys(key for each in flattened for key in each if key != "title")
    values = {key: [each.get(key) for each in flattened] for key in keys}
    return {key: each for key, each in values.items() if any(value != each[0] for value in each)}


def _names(runs: Sequence[Path]) -> list[str]:
    """The folders' own names, or, if two are alike, their paths."""
    names = [run.resolve().name for run in runs]
    return names if len(set(names)) == len(names) else [str(run) for run in runs]


def _look(run: Path, name: str) -> Compared:
    """What is known of ``run``, which is analysed first where that was not done since its last snapshot."""
    recording = open_run(run)
    analysis = run / "analysis"
    return Compared(
        name=name,
        config=recording.config,
        numbers=numbers_of(run),
        tables={table: read_history(analysis / f"{table}.csv") for table in TABLES},
    )


def _columns(found: list[Compared], changes: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """The columns of compare.csv: a row per run."""
    numbers = dict.fromkeys(
        key for run in found for key, value in run.numbers.items() if not isinstance(value, list)
    )
    return {
        "run": [run.name for run in found],
        **changes,
        **{key: [run.numbers.get(key) for run in found] for key in numbers if key != "edition"},
    }


def _print(found: list[Compared], changes: dict[str, list[Any]], console: "Console") -> None:
    """A column per run; keys that differ above, numbers below."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for run in found:
        table.add_column(run.name, justify="right", overflow="fold")
    for key, values in changes.items():
        unit = next((unit for run in found if (unit := unit_at(run.config, key))), "")
        table.add_row(f"{key} [{unit}]" if unit else key, *(_text(value) for value in values), style="bold")
    table.add_section()
    for key in CHIEF:
        values = [run.numbers.get(key) for run in found]
        if any(value is not None for value in values):
            table.add_row(key, *(_text(value) for value in values))
    console.print(table, markup=False)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
