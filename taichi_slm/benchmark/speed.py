"""Where the time of a step goes, and how far a pass is from plain C++.

A drop of 5,000 particles, all of them liquid, and a melting track, of which a few percent are, run on one thread.
Blocks of steps are run with a clock on every pass and without one, in turn; steps are timed without. A row is one
particle of the lists over which a pass runs: the moving ones, those beside them, or all with work, as the pass
needs. "Python and launches" is what is left of a step when all passes are taken away.
"""

import statistics
import time
from typing import Any

from taichi_slm.benchmark import peer
from taichi_slm.benchmark.measure import Yardstick, in_its_own_process, in_turn, ratio
from taichi_slm.benchmark.passes import Pass, Watch
from taichi_slm.benchmark.report import Findings
from taichi_slm.benchmark.scenes import drop, track, warm
from taichi_slm.run.simulation import Simulation

US = 1e6


def compute(findings: Findings, quick: bool, yardstick: Yardstick) -> None:
    """Profiles of both scenes in both precisions, then Taichi beside C++ on the lists of the drop."""
    summaries: list[dict[str, Any]] = []
    for scene, title in (("drop", "a drop"), ("track", "a melting track")):
        for precision in ("f64", "f32"):
            found = in_its_own_process("speed:profile", scene=scene, precision=precision, quick=quick)
            yardstick.measure()
            name = f"{scene}, {precision}"
            if "failure" in found:
                summaries.append({"scene": name, "failure": found["failure"]})
                continue
            summaries.append({"scene": name, **found["step"]})
            if precision == "f64":
                findings.table(
                    f"speed_{scene}", f"The passes of a step: {title}, {precision}", found["passes"]
                )
    findings.table("speed_step", "A step", summaries,
                   "An active particle is one that has work of any kind. A heat step has several flow steps in it. "
                   "The clock's own cost is the time of a step with it over that of a step without.")  # fmt: skip
    beside = []
    for precision in ("f64", "f32"):
        found = in_its_own_process("speed:beside_cpp", precision=precision, quick=quick)
        yardstick.measure()
        beside += found.get("rows", [{"pass": found.get("failure", ""), "precision": precision}])
    findings.table("speed_cpp", "Taichi and plain C++ on the same lists, one thread", beside, peer.ABOUT)


def profile(scene: str, precision: str, quick: bool) -> dict[str, Any]:
    """Passes and steps of ``scene``: {"step": a row, "passes": rows}."""
    drops = scene == "drop"
    config = drop(16 if quick else 40) if drops else track(3 if quick else 12, duration=1e-3)
    sim = Simulation(config, precision=precision, threads=1)
    if drops:
        warm(sim)
    sim.compile()
    while not drops and sim.time < (40e-6 if quick else 200e-6):
        sim.step()  # until there is a pool
    block, blocks = (4, 3) if quick else (15, 12)
    watch = Watch(sim)
    with watch.watching():
        sim.step()  # the first launches of what had no particles when it was compiled
    watch.passes.clear()
    plain, watched, active, moving = [], [], [], []
    flow_steps, whole = 0, 0.0
    for _ in range(blocks):
        before = sim.steps
        plain.append(_block(sim, block) / (sim.steps - before))
        before = sim.steps
        with watch.watching():
            seconds = _block(sim, block)
        whole += seconds
        watched.append(seconds / (sim.steps - before))
        flow_steps += sim.steps - before
        active.append(sim.rows.total)
        moving.append(sim.rows.mobile)
    per_step = statistics.median(plain)
    step = {
        "particles": sim.scene.count, "active particles": statistics.mean(active),
        "moving particles": statistics.mean(moving), "us per flow step": US * per_step,
        "ns per active particle and flow step": 1e9 * per_step / statistics.mean(active),
        "flow steps per heat step": flow_steps / (block * blocks), "with the clock over without": ratio(watched, plain),
        "neighbours of an active particle": _neighbours(sim),
    }  # fmt: skip
    return {"step": step, "passes": _shares(watch, whole, flow_steps, statistics.mean(active))}


def _block(sim: Simulation, steps: int) -> float:
    """Seconds of ``steps`` heat steps."""
    began = time.perf_counter()
    for _ in range(steps):
        sim.step()
    return time.perf_counter() - began


def _neighbours(sim: Simulation) -> float:
    rows = sim.rows.rows.to_numpy()[: sim.rows.total]
    return float(sim.rows.near_count.to_numpy()[rows].mean())


def _shares(watch: Watch, whole: float, flow_steps: int, active: float) -> list[dict[str, Any]]:
    """A row for every pass that was launched, the most expensive first; ``whole`` [s] is all that was watched."""
    launched = {name: seen for name, seen in watch.passes.items() if seen.seconds}
    rows = [_pass(name, seen, whole, flow_steps, active) for name, seen in launched.items()]
    rows.sort(key=lambda row: -row["share of the time"])
    left = whole - sum(sum(seen.seconds) for seen in launched.values())
    rows.append({"pass": "Python and launches", "share of the time": left / whole,
                 "ns per active particle and flow step": 1e9 * left / flow_steps / active})  # fmt: skip
    return rows


def _pass(name: str, seen: Pass, whole: float, flow_steps: int, active: float) -> dict[str, Any]:
    total = sum(seen.seconds)
    row: dict[str, Any] = {
        "pass": name, "share of the time": total / whole, "launches per flow step": len(seen.seconds) / flow_steps,
        "us per launch": US * statistics.median(seen.seconds),
    }  # fmt: skip
    visited = [(s, n) for s, n in zip(seen.seconds, seen.rows or (), strict=False) if n]
    if visited:
        row["rows"] = statistics.mean(n for _, n in visited)
        row["ns per row"] = 1e9 * statistics.median(s / n for s, n in visited)
    return row | {"ns per active particle and flow step": 1e9 * total / flow_steps / active}


def beside_cpp(precision: str, quick: bool) -> dict[str, Any]:
    """Every pass that has a C++ version: {"rows": time of either, their ratio and their difference}."""
    missing = peer.missing()
    if missing:
        return {"rows": [{"pass": missing, "precision": precision}]}
    sim = Simulation(drop(16 if quick else 40), precision=precision, threads=1)
    warm(sim)
    for _ in range(8):
        sim.step()  # off the lattice, with a flow
    sim.activity.neighbours()
    rows = []
    for twin in peer.twins(sim, precision):
        difference = twin.difference()
        seconds = in_turn({"taichi": twin.taichi, "c++": twin.cpp}, 5 if quick else 41, 2 if quick else 5)
        per_row = {name: 1e9 * statistics.median(values) / twin.rows for name, values in seconds.items()}
        rows.append({
            "pass": twin.name, "precision": precision, "rows": twin.rows, "neighbours": twin.neighbours,
            "taichi, ns per row": per_row["taichi"], "c++, ns per row": per_row["c++"],
            "taichi over c++": ratio(seconds["taichi"], seconds["c++"]),
            "largest difference": difference,
        })  # fmt: skip
    return {"rows": rows}
