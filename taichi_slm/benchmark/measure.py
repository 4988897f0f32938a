"""How time is measured: after a warm-up, things to be compared in turn, medians of ratios within one turn.

Machines are shared and drift; a ratio of two numbers of one turn does not. Beside every subject stands a yardstick, the
same work timed again and again while the subject was measured: how far it scattered is how quiet the machine was.
"""

import json
import os
import platform
import queue
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from taichi_slm.compiler import compiler
from taichi_slm.run.run_folder import package_version, processor, read_json, source_hash

ENDS_WITHIN = 3600.0  # [s] of a process, unless told otherwise, or it is stopped and its failure is reported
_SAYS = "says: "  # begins what such a process tells
T = TypeVar("T")


def in_turn(
    actions: Mapping[str, Callable[[], Any]], rounds: int, repeats: int = 1
) -> dict[str, list[float]]:
    """Seconds of one call of each action, shape [rounds] each: one after the other, ``rounds`` times, after a warm-up.

    Each is called ``repeats`` times in a row, and the mean of those is one number.
    """
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(-1, rounds):
        for name, action in actions.items():
            began = time.perf_counter()
            for _ in range(repeats):
                action()
            if turn >= 0:
                seconds[name].append((time.perf_counter() - began) / repeats)
    return seconds


def ratio(of: Sequence[float], to: Sequence[float]) -> float:
    """Median of the ratios within each turn."""
    return statistics.median(a / b for a, b in zip(of, to, strict=True))


def scatter(values: Sequence[float]) -> float:
    """Largest over smallest."""
    return max(values) / min(values)


class Yardstick:
    """A fixed piece of work of this process, some milliseconds of one core."""

    def __init__(self) -> None:
        self._numbers = np.random.default_rng(0).random(200_000)
        self.seconds: list[float] = []

    def measure(self) -> None:
        """Do it once more."""
        began = time.perf_counter()
        for _ in range(4):
            np.sort(self._numbers)
        self.seconds.append(time.perf_counter() - began)


def machine() -> dict[str, Any]:
    """Where and with what the numbers were measured."""
    from importlib.metadata import version

    return {
        "version": package_version(), "git": source_hash(), "python": platform.python_version(),
        "taichi": version("taichi"), "compiler": compiler(), "numpy": np.__version__, "system": platform.platform(),
        "processor": processor(), "cores": os.cpu_count(),
    }  # fmt: skip


def say(line: str) -> None:
    """Tell the person who waits how far it is; called in a process of :func:`in_its_own_process`."""
    print(_SAYS + line, flush=True)


def in_its_own_process(
    function: str,
    environment: Mapping[str, str] | None = None,
    tell: Callable[[str], None] = lambda _: None,
    ends_within: float = ENDS_WITHIN,
    **arguments: Any,
) -> dict[str, Any]:
    """What ``function`` ("package.module:name" of taichi_slm) returns, called with ``arguments`` in a new process.

    Taichi is started anew, and a crash is its own, as is taking more than ``ends_within`` [s]: then the result is
    {"failure": a sentence}. ``tell`` gets what the function has to :func:`say` meanwhile.
    """
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch) / "result.json"
        command = [sys.executable, "-m", "taichi_slm.benchmark", function, json.dumps(arguments), str(target)]
        stopped, said = threading.Event(), "it said nothing"
        with subprocess.Popen(command, env=os.environ | dict(environment or {}), stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True) as process:  # fmt: skip

            def end() -> None:
                stopped.set()
                process.kill()

            stop = threading.Timer(ends_within, end)
            stop.start()
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith(_SAYS):
                    tell(line[len(_SAYS) :].rstrip())
                elif line.strip():
                    said = line.strip()
            process.wait()
            stop.cancel()
        if stopped.is_set():
            return {"failure": f"stopped after {ends_within:.0f} s"}
        if process.returncode or not target.is_file():
            return {"failure": f"ended with {process.returncode}: {said}"}
        return read_json(target)


def a_core_each(tasks: Mapping[str, Callable[[], T]]) -> dict[str, T]:
    """The results of all ``tasks``, as many at a time as there are cores, begun in their order.

    Each is called by a thread that keeps to a core of its own, and so do the processes that it starts (where the
    system lets us choose, which is Linux). What is to be compared belongs into one task.
    """
    bound = hasattr(os, "sched_setaffinity")
    cores = sorted(os.sched_getaffinity(0)) if bound else list(range(os.cpu_count() or 1))
    free = queue.SimpleQueue[int]()
    for core in cores:
        free.put(core)

    def keep_to_a_core() -> None:
        core = free.get()
        if bound:
            os.sched_setaffinity(0, {core})  # of the calling thread

    with ThreadPoolExecutor(len(cores), initializer=keep_to_a_core) as pool:
        running = {name: pool.submit(task) for name, task in tasks.items()}
        return {name: task.result() for name, task in running.items()}


def processes_in_turn(
    jobs: Mapping[str, dict[str, Any]],
    function: str,
    rounds: int,
    yardstick: Yardstick,
    once: Sequence[str] = (),
) -> dict[str, list[dict[str, Any]]]:
    """The results of ``function`` for every set of arguments in ``jobs``, one after the other, ``rounds`` times.

    Jobs named in ``once`` run in the first round only, and those that failed fail once.
    """
    results: dict[str, list[dict[str, Any]]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, arguments in jobs.items():
            if results[name] and (name in once or "failure" in results[name][0]):
                continue
            results[name].append(in_its_own_process(function, **arguments))
            yardstick.measure()
    return results
