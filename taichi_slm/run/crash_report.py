"""An error that nobody foresaw: one sentence for the user, the traceback in a file for whoever mends it."""

import os
import platform
import sys
import tempfile
import traceback


def report(error: BaseException) -> str:
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
