"""The subjects of `taichi-slm stress`: the edges of four scenes, energy below them, all scenes' margins, a long run."""

import functools
import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from taichi_slm.benchmark import subjects
from taichi_slm.benchmark.report import Findings
from taichi_slm.stress import edges

SUBJECTS = {
    "drop": "The largest stable step of each limit: the drop",
    "column": "The largest stable step of each limit: the column",
    "weld": "The largest stable step of each limit: the weld",
    "track": "The largest stable step of each limit: the track",
    "drift": "Energy below the edge",
    "margins": "Margin of every shipped scene",
    "endurance": "A million steps",
}


def stress(names: Sequence[str], out: Path, quick: bool, jobs: int, console: Console) -> dict[str, Any]:
    """Map the subjects of those names, or all, into ``out``, ``jobs`` searches at a time; returns stress.json."""
    chosen = subjects.chosen(names, SUBJECTS)
    return subjects.collect(
        chosen, out / "stress.json", SUBJECTS, lambda name: map_subject(name, quick, jobs, console), console
    )


def map_subject(name: str, quick: bool, jobs: int, console: Console) -> dict[str, Any]:
    """What the subject's module finds, with where, when and how."""
    mapped = name in edges.SUBJECTS
    module = edges if mapped else importlib.import_module(f"taichi_slm.stress.{name}")
    compute = functools.partial(edges.compute, name) if mapped else module.compute

    def tell(line: str) -> None:
        console.print(line, highlight=False, markup=False)

    def measured(findings: Findings) -> None:
        compute(findings, quick, jobs, tell)

    about = (module.__doc__ or "").split("\n\n", 1)[-1].strip()
    return subjects.timed(measured, quick) | {"about": about}
