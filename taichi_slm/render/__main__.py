"""``python -m taichi_slm.render FOLDER [SHARE SHARES [wait]]``: draw a run, or a share of it, in a process of its own.

With ``wait`` it draws when it is told a line, and ends without when there is none.
"""

import importlib
import signal
import sys
from pathlib import Path

from taichi_slm.errors import SlmError
from taichi_slm.render.views import open_plotter, render_run

LOADED_FIRST = ("pyvista.plotting", "scipy.spatial", "contourpy", "PIL.PngImagePlugin")


def main(arguments: list[str]) -> int:
    """Draw the run in the folder that is named first; the numbers after it are those of ``render_run``."""
    if len(arguments) not in (1, 3) and arguments[3:] != ["wait"]:
        print(__doc__)
        return 2
    if len(arguments) == 4 and not _told():
        return 0
    try:
        files = render_run(Path(arguments[0]), None, *map(int, arguments[1:3]))
    except SlmError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"{len(files)} pictures in {Path(arguments[0]) / 'renders'}")
    return 0


def _told() -> bool:
    """Load what draws, and wait for a line; whether there was one before the end of the input."""
    ended_by = signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is meant for the run, which knows what to do
    for module in LOADED_FIRST:
        importlib.import_module(module)
    _open_a_window()
    told = bool(sys.stdin.readline())
    signal.signal(signal.SIGINT, ended_by)
    return told


def _open_a_window() -> None:
    """A first window loads OpenGL, and asks whether there is any."""
    plotter = open_plotter((8, 8))
    plotter.screenshot(return_img=True)
    plotter.close()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
