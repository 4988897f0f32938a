"""Runs side by side: the keys in which their scenes differ, their chief numbers, one plot of pools and profiles."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_slm.analysis.analyse import EDITION, write
from taichi_slm.analysis.recording import open_run
from taichi_slm.config.schema import Config
from taichi_slm.errors import ConfigError, StorageError
from taichi_slm.output.atomic import make_folder, read_json
from taichi_slm.output.history import read_history
from taichi_slm.output.table import flat, write_table

if TYPE_CHECKING:
    from rich.console import Console

SHOWN = (
    "pool.pools", "pool.max_length_m", "pool.max_width_m", "pool.max_depth_m", "pool.max_area_m2", "pool.max_volume_m3",
    "track.length_m", "track.mean_height_m", "track.mean_depth_m", "track.mean_width_m", "track.Ra_m", "track.Rz_m",
    "track.dilution", "track.fused_share", "track.unmelted_powder_share", "track.pores", "track.unfused_voids",
    "solidification.cooling_rate_K_s.median", "solidification.gradient_K_m.median",
    "solidification.front_speed_m_s.median", "solidification.time_above_melting_s.median",
    "spatter.ejected_particles", "spatter.ejected_mass_kg", "spatter.ejected_mass_kg_m", "energy.in_J",
)  # fmt: skip
"""What the terminal shows; the CSV file has all."""

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
    if not _current(run):
        write(run)
    return Compared(
        name=name,
        config=recording.config,
        numbers=flat(read_json(analysis / "analysis.json")),
        tables={table: read_history(analysis / f"{table}.csv") for table in TABLES},
    )


def _current(run: Path) -> bool:
    """Whether the folder's analysis is of this program and of the last snapshot."""
    files = [run / "analysis" / name for name in ("analysis.json", *(f"{table}.csv" for table in TABLES))]
    if not all(file.is_file() for file in files):
        return False
    sources = [path for name in ("snapshots.pvd", "history.csv") if (path := run / name).is_file()]
    newest = max(os.stat(path).st_mtime_ns for path in sources)
    try:
        edition = read_json(files[0]).get("edition")
    except StorageError:
        return False
    return edition == EDITION and min(os.stat(file).st_mtime_ns for file in files) >= newest


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
        table.add_row(key, *(_text(value) for value in values), style="bold")
    table.add_section()
    for key in SHOWN:
        values = [run.numbers.get(key) for run in found]
        if any(value is not None for value in values):
            table.add_row(key, *(_text(value) for value in values))
    console.print(table, markup=False)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
