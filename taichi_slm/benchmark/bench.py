"""The subjects of `taichi-slm bench`, each a module of this package."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from taichi_slm.benchmark import subjects
from taichi_slm.benchmark.measure import Yardstick, scatter
from taichi_slm.benchmark.report import Findings

SUBJECTS = {
    "accuracy": "Run time against error",
    "speed": "Time of every pass, and of the same pass in C++",
    "skips": "What each skip saves, and what it changes",
    "scaling": "Cost against size, threads and start",
    "reach": "Whole scenes, and the limit of this machine",
    "peers": "Another program on the same drops",
}


def bench(names: Sequence[str], out: Path, quick: bool, console: Console) -> dict[str, Any]:
    """Measure the subjects of those names, or all, into the folder ``out``; returns the content of bench.json."""
    chosen = subjects.chosen(names, SUBJECTS)
    return subjects.collect(
        chosen, out / "bench.json", SUBJECTS, lambda name: measure_subject(name, quick), console
    )


def measure_subject(name: str, quick: bool) -> dict[str, Any]:
    """What the subject's module finds, with where, when and how it was measured."""
    module = importlib.import_module(f"taichi_slm.benchmark.{name}")
    yardstick = Yardstick()
    yardstick.measure()
    yardstick.measure()
    yardstick.seconds.pop(0)  # the first one warms up

    def compute(findings: Findings) -> None:
        module.compute(findings, quick, yardstick)
        yardstick.measure()

    about = " ".join((module.__doc__ or "").split("\n\n", 1)[-1].split())
    return subjects.timed(compute, quick) | {"about": about, "drift": scatter(yardstick.seconds)}
