"""The page docs/stability.md, from the content of stress.json."""

from pathlib import Path
from typing import Any

from taichi_slm.benchmark.report import draw_plots, number
from taichi_slm.output.atomic import write_text


def write_page(report: dict[str, Any], page: Path) -> None:
    """Write ``page`` (Markdown), its plots into images/stability/ beside it."""
    lines = [
        "# Stability", "",
        "This page is written by `taichi-slm stress --page docs/stability.md`; do not edit it.", "",
        "How long a step may be, in the scenes of the map and in every scene that ships. The limits and their "
        "factors stand in [theory.md](theory.md), under Time.", "",
    ]  # fmt: skip
    before = ""
    images = page.parent / "images" / "stability"
    for name, subject in report["subjects"].items():
        lines += [f"## {subject['title']}", "", f"`taichi-slm stress {name}`. {_where(subject)}", ""]
        lines += [subject["about"], ""] if subject["about"] != before else []
        before = subject["about"]
        draw_plots(subject, images)
        for table in subject["tables"]:
            lines += [f"### {table['title']}", "", *([table["note"], ""] if table["note"] else [])]
            lines += [*_markdown(table), ""]
        for plot in subject["plots"]:
            lines += [f"![{plot['title']}](images/stability/{plot['name']}.png)", ""]
    write_text(page, "\n".join(lines).rstrip() + "\n")


def _where(subject: dict[str, Any]) -> str:
    at = subject["machine"]
    quick = " **A quick look: few settings, wide brackets.**" if subject["quick"] else ""
    return f"Version {at['version']}, commit {at['git']}, Python {at['python']}, Taichi {at['taichi']}, CPU.{quick}"


def _markdown(table: dict[str, Any]) -> list[str]:
    lines = ["| " + " | ".join(table["columns"]) + " |", "|" + "---|" * len(table["columns"])]
    for row in table["rows"]:
        lines.append("| " + " | ".join(number(cell).replace("|", "\\|") for cell in row) + " |")
    return lines
