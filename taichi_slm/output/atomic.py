"""The only way a file gets its final name: whole, or not at all.

The bytes go to a temporary file beside the target, are synced to the disk, and only then renamed. A kill, a
full disk or a power cut leaves the previous file, never half of the new one.
"""

import contextlib
import errno
import json
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from taichi_slm.errors import StorageError

REASONS = {
    errno.ENOSPC: "the disk is full; free some space",
    errno.EFBIG: "the file would be larger than allowed here (ulimit -f, or the file system)",
    errno.EIO: "the disk reports an error; check it, and resume elsewhere from a copy",
    errno.ESTALE: "the folder is gone from the file server",
    errno.EDQUOT: "the disk quota is used up; free some space",
    errno.EROFS: "the file system is read-only; write elsewhere with --out",
    errno.EACCES: "no permission to write there; choose another place with --out",
    errno.EPERM: "no permission to write there; choose another place with --out",
    errno.ENOENT: "the folder does not exist (was it moved or deleted?)",
    errno.ENOTDIR: "a part of the path is a file, not a folder",
    errno.EEXIST: "there is a file of that name",
    errno.ENAMETOOLONG: "the name is too long",
}


def storage_error(action: str, path: Path, error: OSError) -> StorageError:
    """The sentence for ``error``, met when trying to ``action`` (e.g. "write") ``path``."""
    reason = REASONS.get(error.errno or 0, error.strerror or str(error))
    return StorageError(f"cannot {action} {path}: {reason}")


def write_bytes(path: Path, data: bytes) -> None:
    """Give ``path`` the content ``data``; raises StorageError and leaves any older file as it was."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise storage_error("write", path, error) from error


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` for a library that opens files itself; it gets its name at the end.

    Raises StorageError, and leaves any older file as it was.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        with open(temporary, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    except OSError as error:
        raise storage_error("write", path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Remove the temporary files that a killed writer left in ``folder`` and below; nobody may be writing there."""
    for left in folder.rglob(".*.tmp"):
        with contextlib.suppress(OSError):
            left.unlink()


def write_text(path: Path, text: str) -> None:
    """Give ``path`` the content ``text``, as UTF-8."""
    write_bytes(path, text.encode("utf-8"))


def write_json(path: Path, value: Any) -> None:
    """Give ``path`` the JSON of ``value``; a number that is not finite becomes null."""
    write_text(path, json.dumps(_plain(value), indent=2, ensure_ascii=False) + "\n")


def refuse_existing(paths: Iterable[Path]) -> None:
    """Raise StorageError if there is anything at one of ``paths``: look at all before the first is written."""
    for path in paths:
        try:
            taken = path.exists()
        except OSError as error:
            raise storage_error("write", path, error) from error
        if taken:
            raise StorageError(
                f"{path} exists already and is never written over: name another file, or move it away"
            )


def read_json(path: Path) -> dict[str, Any]:
    """The object in ``path``; a StorageError if it is missing or damaged."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise storage_error("read", path, error) from error
    except ValueError as error:
        raise StorageError(f"{path} is damaged: {error}") from error
    if not isinstance(value, dict):
        raise StorageError(f"{path} is damaged: it holds no object")
    return value


def make_folder(path: Path, parents: bool = True) -> None:
    """Make ``path``, and its parents unless they have to be there; no complaint if it is there already."""
    try:
        path.mkdir(parents=parents, exist_ok=True)
    except OSError as error:
        raise storage_error("make the folder", path, error) from error


def _sync_folder(folder: Path) -> None:
    """Make the rename itself durable; systems that cannot open a folder do without."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value
