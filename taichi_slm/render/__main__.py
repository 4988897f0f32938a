"""``python -m taichi_slm.render FOLDER [IMAGE ...]``: draw a run in a process of its own."""

import sys
from pathlib import Path

from taichi_slm.errors import SlmError
from taichi_slm.render.views import render_run


def main(arguments: list[str]) -> int:
    """Draw the run in the folder that is named first; the names after it replace output.images."""
    if not arguments:
        print(__doc__)
        return 2
    try:
        files = render_run(Path(arguments[0]), arguments[1:] or None)
    except SlmError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"{len(files)} pictures in {Path(arguments[0]) / 'renders'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
