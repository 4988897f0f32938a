"""One writer to a place at a time: a lock on a file, which the system lets go when its holder ends, however it ends."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import storage_error

NAME = ".lock"


def take(file: BinaryIO) -> bool:
    """Lock the open ``file`` until it is closed; False if another process holds it."""
    try:
        import fcntl
    except ImportError:  # Windows: one writer at a time is up to the user
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def claim(folder: Path) -> bool:
    """Make the lock file of a new ``folder``; False if there is one already: somebody was a moment faster."""
    try:
        open(folder / NAME, "xb").close()
    except FileExistsError:
        return False
    except OSError as error:
        raise storage_error("write", folder / NAME, error) from error
    return True


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Hold ``folder``; a StorageError if another process holds it."""
    path = folder / NAME
    try:
        file = open(path, "ab")  # noqa: SIM115
    except OSError as error:
        raise storage_error("write", path, error) from error
    with file:
        if not take(file):
            raise StorageError(
                f"another process is at work in {folder}: let it end, or stop it with a file {folder / 'STOP'}"
            )
        yield
