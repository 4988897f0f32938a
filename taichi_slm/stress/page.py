"""The page docs/stability.md, from the content of stress.json."""

from pathlib import Path
from typing import Any

from taichi_slm.benchmark.report import write_subjects


def write_page(report: dict[str, Any], page: Path) -> None:
    """Write ``page`` (Markdown), its plots into images/stability/ beside it."""
    head = [
        "# Stability", "",
        "This page is written by `taichi-slm stress --page docs/stability.md`; do not edit it.", "",
        "How long a step may be, in the scenes of the map and in every scene that ships. The limits and their "
        "factors stand in [theory.md](theory.md), under Time.", "",
    ]  # fmt: skip
    told: set[str] = set()  # the four scenes of the map have one text

    def opening(name: str, subject: dict[str, Any]) -> list[str]:
        lines = [f"`taichi-slm stress {name}`. {_where(subject)}", ""]
        if subject["about"] not in told:
            told.add(subject["about"])
            lines += [subject["about"], ""]
        return lines

    write_subjects(report, page, "stability", head, opening)


def _where(subject: dict[str, Any]) -> str:
    at = subject["machine"]
    quick = " **A quick look: few settings, wide brackets.**" if subject["quick"] else ""
    return f"Version {at['version']}, commit {at['git']}, Python {at['python']}, Taichi {at['taichi']}, CPU.{quick}"
