"""Run cases, each in a process of its own; one table, one file, one plot after another."""

import math
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from taichi_slm.errors import LimitBrokenError
from taichi_slm.output.atomic import make_folder, write_json
from taichi_slm.run.run_folder import package_version, read_json, source_hash
from taichi_slm.verification.case import Case, Outcome, Row
from taichi_slm.verification.catalogue import GROUPS, all_cases


def verify(cases: Sequence[Case], out: Path, jobs: int, console: Console) -> None:
    """Run ``cases``, ``jobs`` at a time, into the folder ``out``: verify.json and plots/*.png.

    Cases that stand in an earlier verify.json there and are not run now stay in it; each names its commit.
    Raises LimitBrokenError if a limit is broken or a case did not come to its end.
    """
    make_folder(out)
    cores = os.cpu_count() or 1
    results: list[dict[str, Any]] = []
    report = out / "verify.json"
    earlier = read_json(report)["cases"] if report.is_file() else []
    with ThreadPoolExecutor(jobs) as pool, tempfile.TemporaryDirectory() as scratch:
        threads = max(1, cores // jobs)
        running = [pool.submit(_in_its_own_process, case, Path(scratch), threads) for case in cases]
        try:
            for future in running:
                results.append(future.result())
                console.print(_line(results[-1]), highlight=False)
                write_json(report, _report(results, earlier))
        except KeyboardInterrupt:  # what is done stands in verify.json; those that run got the signal, too
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    plots = out / "plots"
    make_folder(plots)
    from taichi_slm.verification.plots import draw

    for result in results:
        for plot in Outcome.from_json(result).plots:
            draw(plot, plots / f"{plot.name}.png")
    console.print(table(results))
    console.print(f"{report}; plots in {plots}", highlight=False)
    broken = [name for result in results for name in broken_limits(result)]
    if broken:
        raise LimitBrokenError("\n".join([f"{len(broken)} limit(s) broken:", *broken]))


def broken_limits(result: dict[str, Any]) -> list[str]:
    """A line for every limit of ``result`` that is not kept, and for a case that did not end."""
    if result["failure"]:
        return [f"  {result['name']}: {result['failure']}"]
    rows = Outcome.from_json(result).rows
    return [f"  {result['name']}, {row.quantity}: {judged(row)}" for row in rows if not row.holds]


def judged(row: Row) -> str:
    """The error and its limit in words."""
    if row.limit is None:
        return "" if row.error is None else number(row.error)
    if row.at_least:
        return f"{number(row.computed)}, at least {number(row.limit)}"
    return f"{number(row.error)}, limit {number(row.limit)}"


def number(value: float | None) -> str:
    """Four significant digits, or nothing."""
    if value is None:
        return ""
    return f"{value:.4g}" if math.isfinite(value) else "not finite"


def table(results: Sequence[dict[str, Any]]) -> Table:
    """Case, quantity, exact or measured, computed, error, limit, seconds."""
    shown = Table(title="taichi-slm verify")
    for name in ("case", "quantity"):
        shown.add_column(name, overflow="fold")
    for name in ("exact", "computed", "error", "limit", "s"):
        shown.add_column(name, justify="right", no_wrap=True)
    for group, heading in GROUPS.items():
        own = [result for result in results if result["group"] == group]
        if own:
            shown.add_section()
            shown.add_row(f"[bold]{heading}[/]")
        for result in own:
            first = (result["name"], f"{result['seconds']:.0f}")
            if result["failure"]:
                shown.add_row(first[0], f"[red]{result['failure']}[/]", "", "", "", "", first[1])
            for row in Outcome.from_json(result).rows:
                colour = "" if row.limit is None else "[green]" if row.holds else "[red]"
                error = number(row.computed if row.at_least else row.error)
                shown.add_row(
                    first[0], row.quantity, number(row.exact), f"{number(row.computed)} {row.unit}".strip(),
                    f"{colour}{error}", row.bound, first[1],
                )  # fmt: skip
                first = ("", "")
    return shown


def _line(result: dict[str, Any]) -> str:
    judged_rows = [row for row in Outcome.from_json(result).rows if row.limit is not None]
    kept = sum(row.holds for row in judged_rows)
    verdict = result["failure"] or f"{kept} of {len(judged_rows)} limits kept"
    return f"{result['name']:28s} {verdict} ({result['seconds']:.1f} s)"


def _in_its_own_process(case: Case, scratch: Path, threads: int) -> dict[str, Any]:
    """The outcome of ``case`` as JSON: Taichi is started anew, and a crash is its own."""
    target = scratch / f"{case.name}.json"
    about = {"name": case.name, "title": case.title, "group": case.group, "tier": case.tier,
             "git": source_hash()}  # fmt: skip
    environment = os.environ | {"TI_CPU_MAX_NUM_THREADS": str(threads)}
    done = subprocess.run(
        [sys.executable, "-m", "taichi_slm.verification", case.name, str(target)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode or not target.is_file():
        said = (done.stderr.strip() or done.stdout.strip() or "it said nothing").splitlines()[-1]
        return about | {
            "failure": f"ended with {done.returncode}: {said}",
            "seconds": 0.0,
            "rows": [],
            "plots": [],
        }
    return about | {"failure": "", **read_json(target)}


def _report(results: Sequence[dict[str, Any]], earlier: Sequence[dict[str, Any]]) -> dict[str, Any]:
    known = {result["name"]: result for result in (*earlier, *results)}
    return {
        "version": package_version(),
        "git": source_hash(),
        "python": platform.python_version(),
        "system": platform.platform(),
        "cores": os.cpu_count(),
        "cases": [known[case.name] for case in all_cases() if case.name in known],
    }
