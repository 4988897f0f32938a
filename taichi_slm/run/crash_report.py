"""How a command ends that raised what nobody foresaw: a sentence for the user, the traceback in a file."""

import os
import platform
import sys
import tempfile
import traceback

from taichi_slm.errors import SlmError, StorageError


def ending(error: Exception) -> tuple[str, int]:
    """(what to tell the user, exit code) of an error that is not one of the package's own."""
    if isinstance(error, MemoryError):
        return "not enough memory: use a larger spacing or a smaller scene", StorageError.exit_code
    if isinstance(error, OSError):
        from taichi_slm.output.atomic import REASONS

        if error.errno in REASONS:
            return f"{error.filename or 'output'}: {REASONS[error.errno]}", StorageError.exit_code
    return report(error), SlmError.exit_code


def report(error: Exception) -> str:
    """Write the traceback of ``error`` to a file in the temp folder; returns what to tell the user."""
    text = "".join(traceback.format_exception(error))
    head = f"{' '.join(sys.argv)}\npython {platform.python_version()}, {platform.platform()}\n\n"
    kind = f"{type(error).__name__}: {error}".partition("\n")[0]
    try:
        handle, path = tempfile.mkstemp(prefix="taichi-slm-", suffix=".txt", text=True)
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(head + text)
    except OSError:
        return f"{text}\nThis is a fault of taichi-slm, not yours; please report it with the lines above."
    return f"This is a fault of taichi-slm, not yours ({kind}); please report it with the file {path}"
