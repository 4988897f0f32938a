"""How cost grows, and with what it does not.

Cold metal: one track on plates of growing depth; the pool stays the same, so its cost per step should. Size: drops
that are liquid all through; cost per particle should not change, but for what a step costs with hardly any.
Threads: a drop and a track. Memory: what the fields take, and how much more a process with more particles takes at
its peak. Start: the program's answers before it computes, and the first step with an empty and a filled cache of
kernels.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from taichi_slm.benchmark.measure import Yardstick, in_its_own_process, processes_in_turn, ratio
from taichi_slm.benchmark.passes import Watch
from taichi_slm.benchmark.report import Findings
from taichi_slm.benchmark.scenes import drop, track, warm, weld
from taichi_slm.benchmark.speed import Block, shares
from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Config
from taichi_slm.run.simulation import Simulation
from taichi_slm.sph.neighbours import LIST_ROOM, LIST_SPARE
from taichi_slm.verification.case import Curve

# passes over all particles or all cells
OVER_ALL = ("lists: spread", "lists: grow", "lists: choose", "cells: clear", "cells: fill", "cells: rouse")
_RSS_UNIT = 1 if sys.platform == "darwin" else 1024  # ru_maxrss is in bytes there, in KiB elsewhere


def compute(findings: Findings, quick: bool, yardstick: Yardstick) -> None:
    """Cold metal, size, threads, memory, start."""
    rounds = 2 if quick else 5
    _cold(findings, rounds, (1, 3) if quick else (3, 10, 30), quick, yardstick)
    _size(findings, rounds, (10, 20) if quick else (10, 20, 40, 80), yardstick)
    _threads(findings, rounds, quick, yardstick)
    _memory(findings, {2: (20, 100), 3: (6, 12)} if quick else {2: (40, 200), 3: (10, 24)}, yardstick)
    _cold_memory(findings, (800e-6, 1000e-6) if quick else (800e-6, 1200e-6), yardstick)
    _start(findings, 2 if quick else 5, yardstick)


def steps(scene: str, size: float, count: int, threads: int = 1) -> dict[str, Any]:
    """``count`` heat steps of a scene, see `_with_a_pool`."""
    sim = _with_a_pool(scene, size, threads)
    before, began = sim.steps, time.perf_counter()
    for _ in range(count):
        sim.step()
    seconds = time.perf_counter() - began
    return {"particles": sim.scene.count, "active particles": sim.rows.hot, "moving particles": sim.rows.mobile,
            "us per flow step": 1e6 * seconds / (sim.steps - before)}  # fmt: skip


def passes(scene: str, size: float, count: int) -> dict[str, float]:
    """The same with a clock on every pass: us per flow step of each."""
    sim = _with_a_pool(scene, size, 1)
    watch, before, began = Watch(sim), sim.steps, time.perf_counter()
    with watch.watching():
        for _ in range(count):
            sim.step()
    seconds, active = time.perf_counter() - began, sim.rows.hot
    block = Block(seconds, sim.steps - before, active, sim.rows.mobile, watch.passes)
    rows = shares([block], active)
    return {row["pass"]: 1e-3 * active * row["ns per active particle and flow step"] for row in rows}


def _with_a_pool(scene: str, size: float, threads: int) -> Simulation:
    """A scene with a pool, and every kernel of it launched.

    "drop" of R/dx ``size``, "track" on a plate ``size`` times as deep, "track_3d" on one as much wider and deeper.
    """
    config = {"drop": lambda: drop(int(size)), "track": lambda: track(6, plate=size, duration=1e-3),
              "track_3d": lambda: _wide_track(size)}[scene]()  # fmt: skip
    sim = Simulation(config, threads=threads)
    if scene == "drop":
        warm(sim)
    for _ in range({"drop": 8, "track": 60, "track_3d": 120}[scene]):
        sim.step()
    return sim


def _wide_track(size: float) -> Config:
    width, depth = 0.24e-3 * size, 0.1e-3 * size
    return load_config("track_3d", [f"bodies.0.width={width}", f"bodies.0.depth={depth}"]).config


def _in_turn(jobs: dict[str, dict[str, Any]], rounds: int, yardstick: Yardstick) -> list[dict[str, Any]]:
    """A row for every job; its time also over that of the first."""
    found = processes_in_turn(jobs, "benchmark.scaling:steps", rounds, yardstick)
    rows, first = [], next(iter(found.values()))
    for name, runs in found.items():
        if "failure" in runs[0] or "failure" in first[0]:
            rows.append({"scene": name, "failure": runs[0].get("failure", "nothing to compare with")})
            continue
        own, other = ([run["us per flow step"] for run in each] for each in (runs, first))
        median = statistics.median(own)
        rows.append({"scene": name, **runs[0], "us per flow step": median, "time over the first": ratio(own, other),
                     "ns per active particle and flow step": 1e3 * median / runs[0]["active particles"]})  # fmt: skip
    return rows


def _cold(
    findings: Findings, rounds: int, depths: tuple[int, ...], quick: bool, yardstick: Yardstick
) -> None:
    jobs = {f"plate x {n}": {"scene": "track", "size": n, "count": 20 if quick else 150} for n in depths}
    rows = _in_turn(jobs, rounds, yardstick)
    passes = _cold_passes(jobs, rounds, yardstick)
    over_all = [row["more"] for row in passes if row.get("pass") in OVER_ALL]
    if over_all and "us per flow step" in rows[0]:
        rows[-1]["limit"] = 1.0 + sum(over_all) / rows[0]["us per flow step"]
    findings.table("scaling_cold", "Cold metal under one pool", rows,
                   "Plates that are so many times 100 um deep; a single one is warm to its bottom. Limit: only those "
                   "passes take longer that go over all particles or all cells, now and then.")  # fmt: skip
    _plot(findings, "scaling_cold", "Cold metal under one pool", rows, "us per flow step")
    findings.table("scaling_cold_passes", "Where more cold metal costs time", passes)
    wide = {f"track_3d, plate x {size:g}": {"scene": "track_3d", "size": size, "count": 20 if quick else 60}
            for size in ((1.0, 1.5) if quick else (1.0, 1.6, 2.4, 3.0))}  # fmt: skip
    rows = _in_turn(wide, 1 if quick else 2, yardstick)
    findings.table("scaling_cold_3d", "Cold metal around a track in 3-D", rows,
                   "The shipped scene on plates that are so many times as wide and as deep. From 400,000 particles on "
                   "lists lie in blocks that take memory on demand, and cost more to read.")  # fmt: skip


def _cold_passes(jobs: dict[str, dict[str, Any]], rounds: int, yardstick: Yardstick) -> list[dict[str, Any]]:
    """Of every pass, its time under the thinnest and under the thickest plate."""
    names = list(jobs)
    ends = {name: jobs[name] for name in (names[0], names[-1])}
    found = processes_in_turn(ends, "benchmark.scaling:passes", rounds, yardstick)
    rows: list[dict[str, Any]] = [runs[0] for runs in found.values() if "failure" in runs[0]]
    if not rows:
        thin, thick = (
            {name: statistics.median(run.get(name, 0.0) for run in runs) for name in runs[0]}
            for runs in found.values()
        )
        first, last = (f"{name}, us per flow step" for name in ends)
        rows = [{"pass": name, first: thin.get(name, 0.0), last: us, "more": us - thin.get(name, 0.0)}
                for name, us in thick.items()]  # fmt: skip
        rows.sort(key=lambda row: -row["more"])
    return rows


def _size(findings: Findings, rounds: int, resolutions: tuple[int, ...], yardstick: Yardstick) -> None:
    jobs = {
        f"drop, R/dx {n}": {"scene": "drop", "size": n, "count": max(3, 4800 // n**2)} for n in resolutions
    }
    rows = _in_turn(jobs, rounds, yardstick)
    findings.table("scaling_size", "Size of the pool: drops, liquid all through", rows)
    _plot(findings, "scaling_size", "Size of the pool", rows, "ns per active particle and flow step")


def _threads(findings: Findings, rounds: int, quick: bool, yardstick: Yardstick) -> None:
    numbers = [n for n in (1, 2, 4, 8, 16) if n <= (os.cpu_count() or 1)]
    rows = []
    for scene, size in (("drop", 20 if quick else 60), ("track", 1)):
        jobs = {f"{scene}, {n} threads": {"scene": scene, "size": size, "count": 5 if quick else 40, "threads": n}
                for n in numbers}  # fmt: skip
        rows += _in_turn(jobs, rounds, yardstick)
    findings.table("scaling_threads", "Threads", rows)


def memory(resolution: int, precision: str, dimension: int) -> dict[str, Any]:
    """A drop after a step: its particles, bytes of its fields, lists and of the entries in use, the process's peak."""
    sim = Simulation(drop(resolution, dimension=dimension), threads=1, precision=precision)
    sim.step()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _RSS_UNIT  # before the copies below
    fields = sum(sim.state.array(name).nbytes for name in sim.state.names)
    names = ("rows", "core", "listed", "near_count", "near", "far_count", "far")
    lists = sum(getattr(sim.rows, name).to_numpy().nbytes for name in names if hasattr(sim.rows, name))
    counts = (
        getattr(sim.rows, name).to_numpy() for name in ("near_count", "far_count") if hasattr(sim.rows, name)
    )
    used = 4 * sum(int(count.sum()) for count in counts)
    return {"particles": sim.scene.count, "fields": fields, "lists": lists, "used": used, "peak": peak}


def _grown(
    entry: str, sizes: tuple[dict[str, Any], ...], yardstick: Yardstick, **arguments: Any
) -> dict[str, Any]:
    """What ``entry`` says of the larger of two scenes; "further ...": bytes of a particle more; or a failure.

    Each is run twice, so that neither compiles: that takes some 25 MB for a while.
    """
    for size in sizes:
        in_its_own_process(f"benchmark.scaling:{entry}", **arguments, **size)
    few, many = (in_its_own_process(f"benchmark.scaling:{entry}", **arguments, **size) for size in sizes)
    yardstick.measure()
    if "failure" in few or "failure" in many:
        return {"failure": few.get("failure") or many["failure"]}
    more = many["particles"] - few["particles"]
    return many | {
        f"further {name}": (many[name] - few[name]) / more for name in ("peak", "scene") if name in many
    }


def _memory(findings: Findings, resolutions: dict[int, tuple[int, int]], yardstick: Yardstick) -> None:
    rows = []
    for dimension, precision in ((d, precision) for d in resolutions for precision in ("f64", "f32")):
        sizes = tuple({"resolution": n} for n in resolutions[dimension])
        found = _grown("memory", sizes, yardstick, precision=precision, dimension=dimension)
        row: dict[str, Any] = {"drop": f"{dimension}-D", "precision": precision}
        if "failure" in found:
            rows.append(row | found)
            continue
        count = found["particles"]
        rows.append(row | {
            "particles": count, "fields, bytes per particle": found["fields"] / count,
            "neighbour lists, bytes per particle": found["lists"] / count,
            "of them entries in use": found["used"] / count,
            "process, bytes per further particle": found["further peak"],
            "with no room but for those": found["further peak"] - (found["lists"] - found["used"]) / count,
            "process, MB": found["peak"] / 1e6,
        })  # fmt: skip
    findings.table("scaling_memory", "Memory of a drop with heat, flow and surface tension: all of it moves", rows,
                   "The further particles are those of the larger drop over those of a smaller one; the process's "
                   "peak holds what is copied while a scene is built as well. A list has room for "
                   f"{LIST_ROOM} times the neighbours on a lattice and {LIST_SPARE[2]} (2-D) or {LIST_SPARE[3]} "
                   "(3-D).")  # fmt: skip


def cold_memory(width: float, precision: str) -> dict[str, Any]:
    """A weld in the middle of a plate (3-D) of ``width`` [m]: its particles, the process's peak, the scene's bytes."""
    sim = Simulation(weld(width), threads=1, precision=precision)
    for _ in range(5):
        sim.step()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _RSS_UNIT
    arrays = (values for values in vars(sim.scene).values() if hasattr(values, "nbytes"))
    # a view of one row takes nothing
    scene = sum(values.nbytes for values in arrays if 0 not in values.strides)
    return {"particles": sim.scene.count, "active particles": sim.rows.hot, "peak": peak, "scene": scene}


def _cold_memory(findings: Findings, widths: tuple[float, float], yardstick: Yardstick) -> None:
    rows = []
    for precision in ("f64", "f32"):
        found = _grown(
            "cold_memory", tuple({"width": width} for width in widths), yardstick, precision=precision
        )
        if "failure" in found:
            rows.append({"precision": precision} | found)
            continue
        per_particle, of_scene = found["further peak"], found["further scene"]
        rows.append({
            "precision": precision, "particles": found["particles"], "of them active": found["active particles"],
            "process, bytes per further cold particle": per_particle, "of them the scene on the host": of_scene,
            "fields, lists and cells": per_particle - of_scene,
        })  # fmt: skip
    findings.table("scaling_memory_cold", "Memory of cold metal in 3-D", rows,
                   "A weld with evaporation on a plate, and on a wider one: the further particles are all cold, so "
                   "they have no lists and no fields of what moves or is hot. Measured before a checkpoint or a "
                   "snapshot, which copy all fields to the host for a moment.")  # fmt: skip


def first_step() -> dict[str, Any]:
    """Seconds from the start of Taichi to the end of the first step of a track, and those of compiling in it."""
    began = time.perf_counter()
    sim = Simulation(track(3))
    sim.step()
    return {"seconds": time.perf_counter() - began, "compiling": sim.compile_time_s}


def _start(findings: Findings, rounds: int, yardstick: Yardstick) -> None:
    seconds: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "track.yaml"
        scene.write_text(json.dumps(track(3).model_dump(mode="json", exclude_unset=True)), encoding="utf-8")
        for turn in range(rounds):
            kernels = {"TI_OFFLINE_CACHE_FILE_PATH": str(Path(folder) / f"cache{turn}")}
            actions: dict[str, Callable[[], Any]] = {
                "taichi-slm --help": partial(_command, "--help"),
                "taichi-slm validate": partial(_command, "validate", str(scene)),
                "process to first step, no kernels in the cache":
                    partial(in_its_own_process, "benchmark.scaling:first_step", kernels),
                "process to first step, kernels in the cache":
                    partial(in_its_own_process, "benchmark.scaling:first_step", kernels),
            }  # fmt: skip
            for name, action in actions.items():
                began = time.perf_counter()
                result = action()
                taken = time.perf_counter() - began
                if "failure" not in result:
                    seconds.setdefault(name, []).append(taken)
                yardstick.measure()
    rows = [{"what": name, "seconds": statistics.median(each), "shortest": min(each), "longest": max(each)}
            for name, each in seconds.items()]  # fmt: skip
    findings.table("scaling_start", "Start: wall time of a process", rows)


def _command(*arguments: str) -> dict[str, Any]:
    """Run the program; {} or {"failure": ...}."""
    code = "import sys; from taichi_slm.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
    )
    return {"failure": done.stderr} if done.returncode else {}


def _plot(findings: Findings, name: str, title: str, rows: list[dict[str, Any]], y: str) -> None:
    measured = [row for row in rows if y in row]
    curve = Curve("", [row["particles"] for row in measured], [row[y] for row in measured])
    findings.plot(name, title, "particles", y, [curve])
