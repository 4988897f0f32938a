"""history.csv: one row of numbers per interval, appended whole and flushed at once."""

import contextlib
import csv
import errno
import io
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

import numpy as np

from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import storage_error, write_bytes

COLUMNS = (
    "step",
    "time_s",
    "dt_s",
    "dt_limiter",
    "mobile",
    "hot",
    "max_temperature_K",
    "max_speed_m_s",
    "melt_length_m",
    "melt_width_m",
    "melt_depth_m",
    "absorbed_J",
    "stored_J",
    "radiated_J",
    "conducted_out_J",
    "energy_error",
    "mass_error",
    "removed",
)
"""The columns that every history has, first and in this order; what else a row brings follows them."""

TEXT_COLUMNS = frozenset({"dt_limiter"})

Value = float | int | str | None


class History:
    """An open history.csv: the first row decides the columns; a row reaches the disk whole or not at all."""

    def __init__(self, path: Path) -> None:
        """Open ``path`` for appending; the rows already there stay."""
        self.path = path
        self.columns = _header(path)
        try:
            self._file = open(path, "ab", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise storage_error("write", path, error) from error

    def append(self, row: Mapping[str, Value]) -> None:
        """Add ``row``; a missing column or None is left empty, an unknown one is an error of the caller."""
        if not self.columns:
            self.columns = [*COLUMNS, *(name for name in row if name not in COLUMNS)]
            self._write(_line(self.columns))
        unknown = [name for name in row if name not in self.columns]
        if unknown:
            raise ValueError(f"history has no column {', '.join(unknown)}")
        self._write(_line([_text(row.get(name)) for name in self.columns]))

    def _write(self, line: bytes) -> None:
        before = self._file.seek(0, os.SEEK_END)
        try:
            if self._file.write(line) != len(line):
                raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            with contextlib.suppress(OSError):  # the reader drops a line without an end
                self._file.truncate(before)
            raise storage_error("write", self.path, error) from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> "History":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_history(path: Path) -> dict[str, np.ndarray]:
    """The columns of history.csv by name, shape [rows]: float64 (NaN where empty), ``dt_limiter`` as text."""
    rows = _rows(path)
    if not rows:
        raise StorageError(f"{path} is empty: the run wrote no history")
    names, body = rows[0], rows[1:]
    columns: dict[str, np.ndarray] = {}
    for k, name in enumerate(names):
        texts = [row[k] for row in body]
        try:
            columns[name] = (
                np.array(texts) if name in TEXT_COLUMNS else np.array([float(t or "nan") for t in texts])
            )
        except ValueError as error:
            raise StorageError(f"{path} is damaged in column {name}: {error}") from error
    return columns


def keep_until(path: Path, step: int) -> bool:
    """Drop the rows after ``step``, for a resumed run; returns whether there is one of that very step."""
    rows = _rows(path)
    if not rows:
        return False
    kept = [row for row in rows[1:] if int(row[0]) <= step]
    write_bytes(path, b"".join(_line(row) for row in [rows[0], *kept]))
    return bool(kept) and int(kept[-1][0]) == step


def _rows(path: Path) -> list[list[str]]:
    """Whole lines of the file as lists of cells; a last line without an end (a kill) is left out."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise storage_error("read", path, error) from error
    except UnicodeDecodeError as error:
        raise StorageError(f"{path} is damaged: {error}") from error
    rows = list(csv.reader(io.StringIO(text[: text.rfind("\n") + 1])))
    if any(len(row) != len(rows[0]) for row in rows):
        raise StorageError(f"{path} is damaged: its rows differ in length")
    return rows


def _header(path: Path) -> list[str]:
    if not path.is_file():
        return []
    rows = _rows(path)
    return rows[0] if rows else []


def _line(cells: list[str]) -> bytes:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerow(cells)
    return buffer.getvalue().encode("utf-8")


def _text(value: Value) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    number = value.item() if hasattr(value, "item") else value
    return repr(int(number) if isinstance(number, bool) else number)
