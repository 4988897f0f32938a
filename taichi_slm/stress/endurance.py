"""A million steps of a tiny scene, watched from outside.

`taichi-slm run` of a drop of some thirty particles, its temperature cycled, with surface tension, heat, a row of
history every 500 steps, checkpoints and snapshots, in a process of its own. Every second its resident memory and its
open files are read from the system, and its step and the time of it from status.json; after the last step a file STOP
ends it, and it leaves with a checkpoint. Flat means: from a tenth of the steps on memory grows by less than 2 %, files
by none, and the last quarter of the steps takes as long as the second (a shared machine scatters by a fifth).
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from taichi_slm.benchmark.report import Findings
from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import read_json
from taichi_slm.run.run_folder import RunFolder
from taichi_slm.verification.case import Curve

STEPS, QUICK_STEPS = 1_000_000, 20_000
SECONDS = 1.0  # between looks
DT = 2e-3  # flow step of the scene, by its speed of sound [s]
SCENE = """
title: A tiny drop for a million steps
dimension: 2
spacing: 0.1
materials:
  fluid:
    density: {{liquid: {{line: {{value: 1000, slope: -1.0, at: 1000}}}}}}
    heat_capacity: {{liquid: {{constant: 1000}}}}
    conductivity: {{liquid: {{constant: 1}}}}
    viscosity: {{liquid: {{constant: 10}}}}
    surface_tension: {{constant: 100}}
    maximum_temperature: 1500
bodies:
  - shape: droplet
    material: fluid
    centre: [0, 0]
    radius: 0.3
    program: {{kind: sine, mean: 1000, amplitude: 0.01, frequency: 0.1}}
numerics: {{sound_speed: 20, maximum_step: {step}}}
time: {{end: {end}}}
output: {{history_interval: {row}, snapshot_interval: {snapshot}, checkpoint_interval: {save}, images: []}}
"""


def watch(steps: int, tell: Callable[[str], None]) -> dict[str, np.ndarray]:
    """Run the scene for ``steps``; returns what was seen every second: seconds, step, memory [bytes], open files.

    Raises StorageError where the system does not tell (no /proc).
    """
    if not Path("/proc/self/statm").is_file():
        raise StorageError("memory and open files of a process are read from /proc, which this system lacks")
    seen: list[tuple[float, int, int, int]] = []
    with tempfile.TemporaryDirectory() as scratch:
        scene, out = Path(scratch) / "endurance.yaml", RunFolder(Path(scratch) / "run")
        scene.write_text(
            SCENE.format(step=DT, end=2 * steps * DT, row=500 * DT, snapshot=steps * DT / 50, save=5000 * DT),
            encoding="utf-8",
        )
        command = [
            sys.executable,
            "-m",
            "taichi_slm.cli",
            "run",
            str(scene),
            "--out",
            str(out.path),
            "--threads",
            "1",
        ]
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as process:
            while process.poll() is None:
                time.sleep(SECONDS)
                written = out.status.stat().st_mtime if out.status.is_file() else 0.0
                step = int(read_json(out.status)["step"]) if written else 0
                if step and (not seen or written > seen[-1][0]) and (look := _look(process.pid)):
                    seen.append((written, step, *look))
                if len(seen) % 60 == 1:
                    tell(f"endurance: {step:,} steps")
                if step >= steps:
                    out.stop.touch()
            assert process.stderr is not None
            complaint = process.stderr.read()
        if process.returncode != 75:
            raise StorageError(f"the run ended with {process.returncode}: {complaint.strip()[-300:]}")
    columns = np.array(seen).T
    return dict(zip(("seconds", "step", "memory", "files"), columns, strict=True))


def _look(process: int) -> tuple[int, int] | None:
    """Resident memory [bytes] and open files of a process; None if it has just ended."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
        files = len(list(Path(f"/proc/{process}/fd").iterdir()))
        return (pages * os.sysconf("SC_PAGE_SIZE"), files) if pages else None
    except (OSError, IndexError):
        return None


def flatness(seen: dict[str, np.ndarray]) -> dict[str, float]:
    """Growth of memory [bytes] and of open files from a tenth of the steps on; step time late over early."""
    step, last = seen["step"], seen["step"][-1]
    late = step >= 0.1 * last

    def pace(low: float, high: float) -> float:
        part = (step >= low * last) & (step <= high * last)
        return float(np.polyfit(step[part], seen["seconds"][part], 1)[0])

    return {
        "steps": float(last),
        "memory [bytes]": float(seen["memory"][-1]),
        "growth of memory [bytes]": float(seen["memory"][-1] - seen["memory"][late][0]),
        "open files": float(seen["files"][-1]),
        "growth of open files": float(np.median(seen["files"][-5:]) - np.median(seen["files"][late][:5])),
        "step [ms]": 1e3 * pace(0.25, 1.0),
        "last quarter over second": pace(0.75, 1.0) / pace(0.25, 0.5),
    }


def compute(findings: Findings, quick: bool, _jobs: int, tell: Callable[[str], None]) -> None:
    """Watch one run."""
    seen = watch(QUICK_STEPS if quick else STEPS, tell)
    findings.table("endurance", "A long run, watched", [flatness(seen)])
    scaled = [("memory [100 MB]", seen["memory"] / 1e8), ("open files [10]", seen["files"] / 10)]
    curves = [Curve(name, seen["step"].tolist(), values.tolist(), "line") for name, values in scaled]
    findings.plot("endurance", "Memory and open files of a long run", "step", "", curves, "")
