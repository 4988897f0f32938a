"""``python -m taichi_slm.render FOLDER [SHARE SHARES]``: draw a run, or a share of it, in a process of its own."""

import sys
from pathlib import Path

from taichi_slm.errors import SlmError
from taichi_slm.render.views import render_run


def main(arguments: list[str]) -> int:
    """Draw the run in the folder that is named first; the numbers after it are those of ``render_run``."""
    if len(arguments) not in (1, 3):
        print(__doc__)
        return 2
    try:
        files = render_run(Path(arguments[0]), None, *map(int, arguments[1:]))
    except SlmError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"{len(files)} pictures in {Path(arguments[0]) / 'renders'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
