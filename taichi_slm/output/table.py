"""A finished table as CSV; :func:`taichi_slm.output.history.read_history` reads it back."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_slm.output.atomic import write_text


def write_table(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write ``columns`` of equal length, the names first; a NaN or None is an empty cell."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow([_cell(value) for value in row])
    write_text(path, stream.getvalue())


def flat(value: Mapping[str, Any], lists: bool = False, prefix: str = "") -> dict[str, Any]:
    """Nested keys joined by dots; with ``lists`` the entries of a list, counted from 0, are keys as well."""
    found: dict[str, Any] = {}
    for key, item in value.items():
        if lists and isinstance(item, list):
            item = {str(number): each for number, each in enumerate(item)}
        found |= flat(item, lists, f"{prefix}{key}.") if isinstance(item, dict) else {f"{prefix}{key}": item}
    return found


def _cell(value: Any) -> str:
    if hasattr(value, "item"):
        value = value.item()
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    return f"{value:.7g}" if isinstance(value, float) else str(value)
