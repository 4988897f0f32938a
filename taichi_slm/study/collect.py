"""The runs of a study as one table: CSV, and Parquet where pyarrow is."""

import csv
import difflib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichi_slm.analysis.analyse import CHIEF, numbers_of
from taichi_slm.config.document import printable
from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import write_bytes, write_text
from taichi_slm.output.table import flat
from taichi_slm.run.run_folder import read_json
from taichi_slm.study.execute import End, standing
from taichi_slm.study.folder import StudyFolder
from taichi_slm.study.plan import Plan, PlannedRun

Row = dict[str, Any]


def collect(plan: Plan, folder: StudyFolder, ends: Mapping[str, End]) -> list[str]:
    """Write table, plot and contact sheet of ``plan`` from what its runs left; the lines to print."""
    rows = rows_of(plan, folder, ends)
    lines = [f"table      {folder.table}", _parquet(folder, rows)]
    write_text(folder.table, as_csv(rows))
    from taichi_slm.study.pictures import contact_sheet, overview  # matplotlib, which --help does without

    drawn = overview(plan, rows, folder.overview)
    lines.append(f"overview   {folder.overview}" if drawn else "overview   none: no run has results to plot")
    lines += _unknown(plan, rows)
    pasted = contact_sheet(plan, folder)
    lines.append(f"tracks     {folder.contact_sheet}" if pasted else "tracks     none: no run made pictures")
    versions = {row["git"] for row in rows if row.get("git")}
    if len(versions) > 1:
        lines.append(f"note: the runs were made by {len(versions)} versions of the program; see column git")
    return lines


def _unknown(plan: Plan, rows: list[Row]) -> list[str]:
    """A line for each column that the study's own ``overview.show`` names and the table lacks."""
    if "show" not in plan.overview.model_fields_set or all(row["state"] != "done" for row in rows):
        return []  # which columns there are is known once a run is done
    lines = []
    for name in plan.overview.show:
        if name not in rows[0]:
            near = difflib.get_close_matches(name, list(rows[0]), n=1)
            meant = f". Did you mean '{near[0]}'?" if near else ""
            lines.append(f"note: overview.show: the table has no column '{printable(name)}'{meant}")
    return lines


def rows_of(plan: Plan, folder: StudyFolder, ends: Mapping[str, End]) -> list[Row]:
    """One row per run of ``plan``: what it changed, how it ended, what it came to (SI)."""
    rows = [_row(run, folder, ends.get(run.name), plan.analyse) for run in plan.runs]
    names = list(dict.fromkeys(name for row in rows for name in row))
    return [{name: row.get(name) for name in names} for row in rows]


def _row(run: PlannedRun, folder: StudyFolder, end: End | None, analyse: bool) -> Row:
    place = folder.run(run.name)
    summary = _object(place.summary)
    provenance = _object(place.provenance)
    state = standing(place)
    return {
        "number": run.number,
        "run": run.name,
        "state": {"resumable": "stopped", "hopeless": "stopped"}.get(state, state)
        if end is None or end.state != "failed"
        else "failed",
        **run.changes,
        "seed": run.seed,
        **flat({key: value for key, value in summary.items() if key != "status"}),
        **(_analysis(place.path) if analyse and state == "done" else {}),
        "failure": end.sentence if end and end.state == "failed" else None,
        "git": provenance.get("git"),
        "folder": str(place.path),
    }


def _analysis(run: Path) -> Row:
    """The chief numbers of the analysis of ``run``; where it cannot be read, the sentence that says why."""
    try:
        numbers = numbers_of(run)
    except StorageError as error:
        return {"analysis.failure": str(error)}
    return {f"analysis.{key}": numbers[key] for key in CHIEF if key in numbers}


def _object(path: Any) -> dict[str, Any]:
    try:
        return read_json(path) if path.is_file() else {}
    except StorageError:
        return {}


def as_csv(rows: list[Row]) -> str:
    """``rows``, of equal keys, as CSV; a list or a mapping is JSON in its cell."""
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: json.dumps(v) if isinstance(v, list | dict) else v for name, v in row.items()})
    return stream.getvalue()


def _parquet(folder: StudyFolder, rows: list[Row]) -> str:
    """Write table.parquet; the line to print."""
    path = folder.table.with_suffix(".parquet")
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return "           without Parquet: pip install 'taichi-slm[parquet]'"
    columns = {name: _alike([row[name] for row in rows]) for name in rows[0]}
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(columns), sink)
    write_bytes(path, sink.getvalue().to_pybytes())
    return f"           {path}"


def _alike(column: list[Any]) -> list[Any]:
    """Values of one type: numbers if all are, else text."""
    given = [value for value in column if value is not None]
    if all(isinstance(value, bool) for value in given) or all(isinstance(value, str) for value in given):
        return column
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in given):
        whole = all(isinstance(value, int) and abs(value) < 2**63 for value in given)
        return column if whole else [None if value is None else float(value) for value in column]
    return [v if v is None or isinstance(v, str) else json.dumps(v) for v in column]
