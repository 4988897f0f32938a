"""Checkpoints in two alternating slots: while one is written, the other stays whole.

A slot is an npz file that carries the SHA-256 of its own arrays: a file damaged later is never resumed from.
"""

import hashlib
import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import make_folder, write_bytes

SLOTS = ("a.npz", "b.npz")
META, DIGEST = "checkpoint.meta", "checkpoint.sha256"


@dataclass(frozen=True)
class Checkpoint:
    """The arrays of ``Simulation.checkpoint()``, and ``step``, ``time_s`` and costs so far in ``meta``."""

    path: Path
    arrays: dict[str, np.ndarray]
    meta: dict[str, Any]

    @property
    def step(self) -> int:
        """Steps done when it was taken."""
        return int(self.meta["step"])


class Slots:
    """The folder ``checkpoints/`` of a run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        good = find_latest(folder)
        self._next = 0 if good is None or good.path.name == SLOTS[1] else 1

    def write(self, arrays: dict[str, np.ndarray], meta: dict[str, Any]) -> Path:
        """Write to the slot that does not hold the last good checkpoint; returns its path."""
        make_folder(self.folder, parents=False)  # a run folder that was taken away does not come back
        path = self.folder / SLOTS[self._next]
        packed = {**arrays, META: np.frombuffer(json.dumps(meta).encode("utf-8"), dtype=np.uint8)}
        packed[DIGEST] = _digest(packed)
        buffer = io.BytesIO()
        np.savez(buffer, **packed)  # type: ignore[arg-type]
        write_bytes(path, buffer.getvalue())
        self._next = 1 - self._next
        return path


def find_latest(folder: Path) -> Checkpoint | None:
    """The checkpoint of the highest step among the whole ones in ``folder``, or None."""
    return examine(folder)[0]


def examine(folder: Path) -> tuple[Checkpoint | None, list[Path]]:
    """(the checkpoint of the highest step, or None; the slots that are there and damaged)."""
    slots = [folder / name for name in SLOTS]
    read = {path: _read(path) for path in slots}
    whole = [checkpoint for checkpoint in read.values() if checkpoint is not None]
    damaged = [path for path, checkpoint in read.items() if checkpoint is None and path.exists()]
    return max(whole, key=lambda checkpoint: checkpoint.step, default=None), damaged


def latest_good(folder: Path) -> Checkpoint:
    """As :func:`find_latest`; where there is none, a StorageError says so."""
    checkpoint, damaged = examine(folder)
    if checkpoint is None:
        there = " and ".join(path.name for path in damaged)
        reason = f"{there} there are damaged" if damaged else "there is none"
        raise StorageError(
            f"no good checkpoint in {folder}: {reason}; start the run anew from its config.yaml"
        )
    return checkpoint


def _read(path: Path) -> Checkpoint | None:
    try:
        with np.load(path, allow_pickle=False) as file:
            packed = {name: file[name] for name in file.files}
        digest = packed.pop(DIGEST)
        if not np.array_equal(digest, _digest(packed)):
            return None
        meta = json.loads(packed.pop(META).tobytes())
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
        return None  # missing or damaged: the other slot counts
    return Checkpoint(path, packed, meta)


def _digest(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """SHA-256 over names, types, shapes and bytes, in the order of the names, shape [32]."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {arrays[name].shape};".encode())
        total.update(array.tobytes())
    return np.frombuffer(total.digest(), dtype=np.uint8)
