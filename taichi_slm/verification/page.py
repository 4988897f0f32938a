"""docs/verification.md from verify.json: the table, the limits and their reasons, the plots, the commit."""

import importlib
import inspect
import pkgutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taichi_slm.output.atomic import make_folder, write_text
from taichi_slm.run.run_folder import read_json
from taichi_slm.verification import cases
from taichi_slm.verification.case import Outcome, Row
from taichi_slm.verification.catalogue import GROUPS
from taichi_slm.verification.plots import draw
from taichi_slm.verification.verify import broken_limits, number


def write_page(report_file: Path, page: Path) -> None:
    """Write ``page`` (Markdown) from ``report_file`` (verify.json), its plots into images/verification/ beside it."""
    report = read_json(report_file)
    results = report["cases"]
    images = page.parent / "images" / "verification"
    make_folder(images)
    lines = [
        "# Verification",
        "",
        "Every claim has a measured error. This page is written by `taichi-slm verify --page docs/verification.md`; "
        "do not edit it.",
        "",
        f"Version {report['version']}, Python {report['python']}, {report['cores']} cores, f64. Each case names the "
        "commit that it was run at. Seconds are of one case beside other work, so they are upper bounds.",
        "",
        *_in_short(results),
    ]
    for group, heading in GROUPS.items():
        own = [result for result in results if result["group"] == group]
        if own:
            lines += [f"## {heading}", ""]
        for result in own:
            lines += _section(result, images)
    write_text(page, "\n".join(lines).rstrip() + "\n")


def _in_short(results: Sequence[dict[str, Any]]) -> list[str]:
    limits = sum(row["limit"] is not None for result in results for row in result["rows"])
    broken = [line for result in results for line in broken_limits(result)]
    lines = [f"{len(results)} cases, {limits} limits, {len(broken)} broken.", ""]
    lines += [f"- {line.strip()}" for line in broken] + ([""] if broken else [])
    wider = [
        f"1. {result['name']}, {row.quantity}: {number(row.error)}, limit {row.bound}: {row.why}"
        for result in results
        for row in Outcome.from_json(result).rows
        if row.asked is not None
    ]
    return lines + (
        [f"{len(wider)} limits are wider than what was asked for:", "", *wider, ""] if wider else []
    )


def _section(result: dict[str, Any], images: Path) -> list[str]:
    outcome = Outcome.from_json(result)
    lines = [
        f"### {result['title']}",
        "",
        f"`taichi-slm verify {result['name']}`, {result['seconds']:.0f} s, commit {result['git'][:12]}",
        "",
    ]
    lines += [*_docstring(result["name"]), ""]
    if result["failure"]:
        return [*lines, f"**Did not end: {result['failure']}**", ""]
    lines += [
        "| quantity | exact | computed | error | limit | why, or what it shows |",
        "|---|---|---|---|---|---|",
    ]
    lines += [_table_row(row) for row in outcome.rows] + [""]
    for plot in outcome.plots:
        draw(plot, images / f"{plot.name}.png")
        lines += [f"![{plot.title}](images/verification/{plot.name}.png)", ""]
    return lines


def _table_row(row: Row) -> str:
    limit = row.bound + ("" if row.holds else " **broken**")
    error = "" if row.at_least else number(row.error)
    cells = (
        row.quantity,
        number(row.exact),
        f"{number(row.computed)} {row.unit}".strip(),
        error,
        limit,
        row.why,
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _docstring(name: str) -> list[str]:
    """What the file of the case says about it, as a block."""
    for module in pkgutil.iter_modules(cases.__path__):
        loaded = importlib.import_module(f"{cases.__name__}.{module.name}")
        if any(case.name == name for case in getattr(loaded, "CASES", ())):
            return ["```text", *inspect.cleandoc(loaded.__doc__ or "").splitlines(), "```"]
    return []
