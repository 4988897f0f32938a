"""Whole scenes, from the command to the last picture.

Each is run by `taichi-slm run` with its pictures, as a user would, on all cores, with the kernels in the cache; before
that, some without output and with a clock on every pass. The last table is the limit of this machine for these
passes: what would be left of the steps without Python and launches; if the passes that have a version in C++ ran at
its speed where that is faster; and if all cores had work all the time; and of the run, with its kernels, files and
pictures as they are. It is arithmetic on what was measured, not a run.
"""

import json
import math
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_slm.benchmark.measure import Yardstick, in_its_own_process, machine
from taichi_slm.benchmark.report import Findings
from taichi_slm.benchmark.speed import to_its_end
from taichi_slm.config.load import load_config
from taichi_slm.run.simulation import Simulation


@dataclass(frozen=True)
class WholeScene:
    """A shipped scene, with changes of its keys, and the wall time [s] that was asked of it."""

    shipped: str
    changes: tuple[str, ...] = ()
    seconds: float | None = None
    profiled: bool = True

    @property
    def name(self) -> str:
        """As it stands in the tables."""
        return " ".join((self.shipped, *self.changes))


MILLIMETRE = (
    "spacing=5 um", "bodies.0.length=1.2 mm", "bodies.1.length=1.12 mm", "laser.path.0.end=[1.1 mm, 0 mm]",
    "time.end=3 ms", "output.snapshot_interval=0.1 ms",
)  # fmt: skip
SCENES = (
    WholeScene("track_150W", seconds=20.0),
    WholeScene("spot_weld_3ms", seconds=20.0),
    WholeScene("spot_weld_3ms", ("spacing=25 um",), 240.0),
    WholeScene("track_3d", MILLIMETRE, 3600.0, profiled=False),
)
QUICK = (WholeScene("track_150W", ("time.end=20 us",)), WholeScene("spot_weld_3ms", ("time.end=60 us",)))
WITH_CPP = {
    "flow: momentum": "momentum", "flow: continuity": "continuity", "surface: colour": "colour",
    "surface: forces": "forces", "heat: rates": "conduction",
}  # fmt: skip


def compute(findings: Findings, quick: bool, yardstick: Yardstick) -> None:
    """The runs, their profiles, the limits."""
    scenes = QUICK if quick else SCENES
    runs, profiles = [], {}
    for scene in scenes:  # first what fills the cache of kernels
        if scene.profiled:
            profiles[scene] = in_its_own_process(
                "benchmark.reach:profile", scene=scene.shipped, changes=scene.changes
            )
        else:
            in_its_own_process("benchmark.reach:fill_cache", scene=scene.shipped, changes=scene.changes)
        yardstick.measure()
        runs.append(_run(scene))
        yardstick.measure()
    findings.table("reach_runs", "Wall time of whole scenes", runs)
    around = {run["scene"]: run["wall, s"] - run["steps, s"] for run in runs if "failure" not in run}
    beside = in_its_own_process("benchmark.speed:beside_cpp", precision="f64", quick=quick)
    slower = {row["pass"]: row["over c++"] for row in beside.get("rows", ()) if "over c++" in row}
    limits = []
    for scene, found in profiles.items():
        if "failure" in found:
            limits.append({"scene": scene.name, "failure": found["failure"]})
            continue
        name = "_".join(re.findall(r"\w+", scene.name))
        findings.table(f"reach_{name}", f"Where the time goes: {scene.name}, all steps", found["passes"])
        limits.append({"scene": scene.name} | limit(found, slower, around.get(scene.name, math.nan)))
    findings.table("reach_limits", "What would be left of the steps", limits)


def _run(scene: WholeScene) -> dict[str, Any]:
    """One run by the command line: what it says of itself, and its wall time."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "run"
        command = [sys.executable, "-m", "taichi_slm.cli", "run", scene.shipped, "--out", str(out)]
        for change in scene.changes:
            command += ["--set", change]
        row: dict[str, Any] = {"scene": scene.name}
        began = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        wall = time.perf_counter() - began
        if done.returncode:
            said = (done.stderr or done.stdout).strip().splitlines()
            return row | {"failure": said[-1] if said else f"ended with {done.returncode}"}
        told = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    return row | {
        "particles": told["particles"], "flow steps": told["steps"], "wall, s": wall, "asked, s": scene.seconds,
        "steps, s": told["solver_time_s"], "compiling, s": told["compile_time_s"],
        "scene and files, s": told["wall_time_s"] - told["solver_time_s"] - told["compile_time_s"],
        "Python and pictures, s": wall - told["wall_time_s"],
        "us per flow step": 1e6 * told["solver_time_s"] / told["steps"],
        "memory, MB": (told["peak_memory_bytes"] or 0) / 1e6,
    }  # fmt: skip


def fill_cache(scene: str, changes: list[str]) -> dict[str, Any]:
    """Compile the kernels of a scene, and launch them once."""
    sim = Simulation(load_config(scene, changes).config)
    sim.step()
    return {"compile": sim.compile_time_s}


def profile(scene: str, changes: list[str]) -> dict[str, Any]:
    """All steps of a scene on all cores: seconds, how busy the cores were, a row for every pass."""
    return to_its_end(Simulation(load_config(scene, changes).config))


def limit(found: dict[str, Any], slower: dict[str, float], around: float) -> dict[str, float]:
    """Seconds that would be left of a `profile`, and of a run with ``around`` [s] of other things than steps.

    ``slower``: time of a pass over that of its version in C++.
    """
    seconds = {row["pass"]: row["share of the time"] * found["seconds"] for row in found["passes"]}
    passes = {name: s for name, s in seconds.items() if name != "Python and launches"}
    at_cpp = sum(s / max(1.0, slower.get(WITH_CPP.get(name, ""), 1.0)) for name, s in passes.items())
    cores = machine()["cores"] or 1
    all_busy = at_cpp * min(1.0, found["busy"] / cores)
    return {
        "steps, s": found["seconds"], "cores busy": found["busy"],
        "without Python and launches, s": sum(passes.values()),
        "and five passes no slower than plain C++, s": at_cpp, "and all cores busy, s": all_busy,
        "the run then, s": all_busy + around,
    }  # fmt: skip
