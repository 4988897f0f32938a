"""Searches in processes of their own, side by side; a line for every run as it ends.

``python -m taichi_slm.stress.processes MODULE:FUNCTION ARGUMENTS FILE`` calls a function of this package.
"""

import importlib
import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from taichi_slm.output.atomic import write_json
from taichi_slm.run.run_folder import read_json

ENDS_WITHIN = 3600.0  # [s] of a process, or it is stopped and its failure is reported
MARK = "run: "


def say(line: str) -> None:
    """Tell the person who waits of a run that has ended; called in a process of a search."""
    print(MARK + line, flush=True)


def in_its_own_process(
    function: str, arguments: Mapping[str, Any], tell: Callable[[str], None]
) -> dict[str, Any]:
    """What ``function`` ("module:name") returns in a new process; a crash gives {"failure": a sentence}."""
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch) / "result.json"
        command = [sys.executable, "-m", __name__, function, json.dumps(arguments), str(target)]
        said = "it said nothing"
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as process:
            stop = threading.Timer(ENDS_WITHIN, process.kill)
            stop.start()
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith(MARK):
                    tell(line[len(MARK) :].rstrip())
                elif line.strip():
                    said = line.strip()
            process.wait()
            stop.cancel()
        if process.returncode or not target.is_file():
            return {"failure": f"ended with {process.returncode}: {said}"}
        return read_json(target)


def side_by_side(
    function: str, plan: Mapping[str, Mapping[str, Any]], jobs: int, tell: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """The results of ``function`` for every set of arguments in ``plan``, in its order; ``jobs`` at a time."""

    def one(name: str) -> dict[str, Any]:
        return in_its_own_process(function, plan[name], lambda line: tell(f"{name}: {line}"))

    with ThreadPoolExecutor(jobs) as pool:
        return dict(zip(plan, pool.map(one, plan), strict=True))


def main() -> None:
    """Call the function with the arguments (JSON), and write what it returns."""
    function, arguments, target = sys.argv[1:]
    module, name = function.split(":")
    found = getattr(importlib.import_module(f"taichi_slm.stress.{module}"), name)
    write_json(Path(target), found(**json.loads(arguments)))


if __name__ == "__main__":
    main()
