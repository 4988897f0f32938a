"""One measurement in a new process: ``python -m taichi_slm.benchmark PACKAGE.MODULE:FUNCTION ARGUMENTS FILE``."""

import importlib
import json
import sys
from pathlib import Path

from taichi_slm.output.atomic import write_json


def main() -> None:
    """Call the function with the arguments (JSON), and write what it returns."""
    function, arguments, target = sys.argv[1:]
    module, name = function.split(":")
    found = getattr(importlib.import_module(f"taichi_slm.{module}"), name)
    write_json(Path(target), found(**json.loads(arguments)))


if __name__ == "__main__":
    main()
