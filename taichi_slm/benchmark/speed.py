"""Where the time of a step goes, and how far a pass is from plain C++.

A drop of 5,000 particles, all of them liquid, and a melting track on a plate that stays solid, run on one thread.
Blocks of steps are run with a clock on every pass and without one, in turn; steps are timed without. A row is one
particle of the lists over which a pass runs: the moving ones, those beside them, or all with work, as the pass
needs. "Python and launches" is what is left of a step when all passes are taken away. A launch that took more than
five times as long as its like was stalled by another process, and counts as five.

What is summed from the same state is one loop here: pressure, viscosity, wall forces and shift; divergence,
diffusion, Shepard sum and background. These passes cannot be one: each needs what the pass before it wrote to the
neighbours (moved places and pressures, surface forces, kicked velocities). In C++ they stand beside us twice: pass by
pass with the same sums in a loop, and as the step is written before anybody fuses it, with a loop for every term.
"""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from taichi_slm.benchmark import peer
from taichi_slm.benchmark.goals import TOGETHER, UNFUSED
from taichi_slm.benchmark.measure import Yardstick, in_its_own_process, in_turn, ratio
from taichi_slm.benchmark.passes import Pass, Watch
from taichi_slm.benchmark.report import Findings
from taichi_slm.benchmark.scenes import drop, track, warm
from taichi_slm.compiler import VARIABLE, installed
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Curve

US = 1e6
STALL = 5.0  # times the median: a launch is never that much longer than its like, but for another process


def compute(findings: Findings, quick: bool, yardstick: Yardstick) -> None:
    """Profiles of both scenes, then the passes beside C++ on the lists of the drop; by every compiler and precision."""
    summaries: list[dict[str, Any]] = []
    ways = [(compiler, precision) for precision in ("f64", "f32") for compiler in installed()]
    for scene, title in (("drop", "a drop"), ("track", "a melting track")):
        for compiler, precision in ways:
            environment = {VARIABLE: compiler}
            found = in_its_own_process(
                "benchmark.speed:profile", environment, scene=scene, precision=precision, quick=quick
            )
            yardstick.measure()
            row = {"scene": scene, "compiler": compiler, "precision": precision}
            if "failure" in found:
                summaries.append({**row, "failure": found["failure"]})
                continue
            summaries.append({**row, **found["step"]})
            if (compiler, precision) == ways[0]:
                findings.table(
                    f"speed_{scene}", f"The passes of a step: {title}, {precision}", found["passes"]
                )
    findings.table("speed_step", "A step", summaries,
                   "An active particle is one that has work of any kind. A heat step has several flow steps in it. "
                   "The clock's own cost is the time of a step with it over that of a step without.")  # fmt: skip
    beside = []
    for compiler, precision in ways:
        environment = {VARIABLE: compiler}
        found = in_its_own_process(
            "benchmark.speed:beside_cpp", environment, precision=precision, quick=quick
        )
        yardstick.measure()
        rows = found.get("rows", [{"pass": found.get("failure", "")}])
        beside += [{"compiler": compiler, "precision": precision} | row for row in rows]
    findings.table("speed_cpp", "The passes and plain C++ on the same lists, one thread", beside, peer.ABOUT)
    _plot(findings, beside, ways)


def _plot(findings: Findings, rows: list[dict[str, Any]], ways: list[tuple[str, str]]) -> None:
    """The time of every pass over that of its C++ version."""
    curves = []
    for compiler, precision in ways:
        own = [row for row in rows
               if (row["compiler"], row["precision"]) == (compiler, precision) and "over c++" in row]  # fmt: skip
        ratios, passes = [row["over c++"] for row in own], [row["pass"] for row in own]
        curves.append(Curve(f"{compiler}, {precision}", ratios, passes, "points"))
    if any(curve.x for curve in curves):
        first, last = rows[0]["pass"], rows[-1]["pass"]
        curves.append(Curve("plain C++", [1.0, 1.0], [first, last], "dashed"))
    findings.plot("speed_cpp", "Time of a pass", "over that of plain C++", "", curves, "")


def profile(scene: str, precision: str, quick: bool) -> dict[str, Any]:
    """Passes and steps of ``scene``: {"step": a row, "passes": rows}."""
    drops = scene == "drop"
    config = drop(16 if quick else 40) if drops else track(3 if quick else 12, 1.0 if quick else 3.0, 1e-3)
    sim = Simulation(config, precision=precision, threads=1)
    if drops:
        warm(sim)
    sim.compile()
    while not drops and sim.time < (40e-6 if quick else 200e-6):
        sim.step()  # until there is a pool
    block, blocks = (2, 8) if quick else (5, 40)
    watch, found, plain = Watch(sim), [], []
    with watch.watching():
        sim.step()  # the first launches of what had no particles when it was compiled
    for _ in range(blocks):
        before = sim.steps
        plain.append(_block(sim, block) / (sim.steps - before))
        watch.passes.clear()
        before = sim.steps
        with watch.watching():
            seconds = _block(sim, block)
        found.append(Block(seconds, sim.steps - before, sim.rows.hot, sim.rows.mobile, dict(watch.passes)))
    per_step, active = statistics.median(plain), statistics.mean(each.active for each in found)
    step = {
        "particles": sim.scene.count, "active particles": active,
        "moving particles": statistics.mean(each.moving for each in found), "us per flow step": US * per_step,
        "ns per active particle and flow step": 1e9 * per_step / active,
        "flow steps per heat step": sum(each.steps for each in found) / (block * blocks),
        "with the clock over without": ratio([each.seconds / each.steps for each in found], plain),
        "neighbours of an active particle": _neighbours(sim),
    }  # fmt: skip
    return {"step": step, "passes": shares(found, active)}


def to_its_end(sim: Simulation) -> dict[str, Any]:
    """All steps of ``sim`` with a clock on every pass: seconds, cores at work, {"passes": a row for each}."""
    sim.step()  # the first launches
    watch, first, active, moving, heat_steps = Watch(sim), sim.steps, 0, 0, 0
    began, busy = time.perf_counter(), time.process_time()
    with watch.watching():
        while not sim.finished:
            sim.step()
            active, moving, heat_steps = active + sim.rows.hot, moving + sim.rows.mobile, heat_steps + 1
    seconds, busy = time.perf_counter() - began, time.process_time() - busy
    active, moving = round(active / heat_steps), round(moving / heat_steps)
    block = Block(seconds, sim.steps - first, active, moving, watch.passes)
    return {"seconds": seconds, "busy": busy / seconds, "passes": shares([block], active)}


@dataclass(frozen=True)
class Block:
    """Some steps with a clock on every pass."""

    seconds: float
    steps: int  # of flow
    active: int  # rows at its end
    moving: int
    passes: dict[str, Pass]


def _block(sim: Simulation, steps: int) -> float:
    """Seconds of ``steps`` heat steps."""
    began = time.perf_counter()
    for _ in range(steps):
        sim.step()
    return time.perf_counter() - began


def _neighbours(sim: Simulation) -> float:
    rows = sim.rows.hot_rows.to_numpy()[: sim.rows.hot]
    return float(sim.rows.near_count.to_numpy()[rows].mean())


def shares(blocks: list[Block], active: float) -> list[dict[str, Any]]:
    """A row for every pass that was launched, the most expensive first, and one for what is left."""
    steps = sum(block.steps for block in blocks)
    names = dict.fromkeys(name for block in blocks for name in block.passes)
    rows: list[dict[str, Any]] = []
    for name in names:
        each = [block.passes[name] for block in blocks if name in block.passes]
        seconds = [s for one in each for s in one.seconds]
        if not seconds:
            continue
        row: dict[str, Any] = {
            "pass": name, "share of the time": without_stalls(seconds) / steps,
            "launches per flow step": len(seconds) / steps, "us per launch": US * statistics.median(seconds),
        }  # fmt: skip
        visited = [(s, n) for one in each for s, n in zip(one.seconds, one.rows or (), strict=False) if n]
        if visited:
            row["rows"] = statistics.mean(n for _, n in visited)
            row["ns per row"] = 1e9 * statistics.median(s / n for s, n in visited)
        rows.append(row)
    rows.sort(key=lambda row: -row["share of the time"])
    left = [block.seconds - sum(sum(one.seconds) for one in block.passes.values()) for block in blocks]
    rows.append({"pass": "Python and launches", "share of the time": without_stalls(left) / steps})
    whole = sum(row["share of the time"] for row in rows)
    for row in rows:
        row["ns per active particle and flow step"] = 1e9 * row["share of the time"] / active
        row["share of the time"] /= whole
    return rows


def without_stalls(seconds: list[float]) -> float:
    """Sum of times, each at most ``STALL`` times their median: beyond that the machine did something else."""
    longest = STALL * statistics.median(seconds)
    return sum(min(s, longest) for s in seconds)


def beside_cpp(precision: str, quick: bool) -> dict[str, Any]:
    """Every pass that has a C++ version: {"rows": time of either, their ratio and their difference}."""
    missing = peer.missing()
    if missing:
        return {"rows": [{"pass": missing}]}
    sim = Simulation(drop(16 if quick else 40), precision=precision, threads=1)
    warm(sim)
    for _ in range(8):
        sim.step()  # off the lattice, with a flow
    sim.activity.neighbours()
    rows: list[dict[str, Any]] = []
    # of every pass
    turns: dict[str, list[list[float]]] = {"kernel": [], "launch": [], "c++": [], "limit": []}
    arithmetic, twins = peer.multiply_adds(precision), peer.twins(sim, precision)
    for twin in twins:
        difference = twin.difference()
        seconds = in_turn(
            {"kernel": twin.kernel, "launch": twin.empty, "c++": twin.cpp, "limit": arithmetic},
            5 if quick else 41,
            2 if quick else 5,
        )
        share = twin.rows * twin.neighbours * peer.OPERATIONS[twin.name] / arithmetic()
        seconds["limit"] = [share * each for each in seconds["limit"]]
        for name, values in seconds.items():
            turns[name].append(values)
        per_row = {name: 1e9 * statistics.median(values) / twin.rows for name, values in seconds.items()}
        rows.append({
            "pass": twin.name, "rows": twin.rows, "neighbours": twin.neighbours,
            "ns per row": per_row["kernel"], "of it to launch": per_row["launch"],
            "c++, ns per row": per_row["c++"], "over c++": ratio(seconds["kernel"], seconds["c++"]),
            "limit over c++": ratio(seconds["limit"], seconds["c++"]),
            "largest difference": difference,
        })  # fmt: skip
    together = {name: [sum(turn) for turn in zip(*each, strict=True)] for name, each in turns.items()}
    whole = {name: 1e9 * statistics.median(values) / sim.rows.mobile for name, values in together.items()}
    rows.append({
        "pass": TOGETHER, "rows": sim.rows.mobile, "ns per row": whole["kernel"],
        "of it to launch": whole["launch"], "c++, ns per row": whole["c++"],
        "over c++": ratio(together["kernel"], together["c++"]),
        "limit over c++": ratio(together["limit"], together["c++"]),
    })  # fmt: skip
    return {"rows": [*rows, _beside_unfused(sim, twins, precision, quick, whole["limit"])]}


def _beside_unfused(
    sim: Simulation, twins: Sequence[peer.Twin], precision: str, quick: bool, limit: float
) -> dict[str, Any]:
    """The row of all ``twins`` beside the step in C++ that has a loop for every term; ``limit`` [ns per row]."""
    unfused, difference = peer.unfused(sim, precision)

    def kernels() -> None:
        for twin in twins:
            twin.kernel()

    seconds = in_turn({"kernel": kernels, "c++": unfused}, 5 if quick else 41, 2 if quick else 5)
    per_row = {name: 1e9 * statistics.median(values) / sim.rows.mobile for name, values in seconds.items()}
    return {
        "pass": UNFUSED, "rows": sim.rows.mobile, "ns per row": per_row["kernel"],
        "c++, ns per row": per_row["c++"], "over c++": ratio(seconds["kernel"], seconds["c++"]),
        "limit over c++": limit / per_row["c++"], "largest difference": difference,
    }  # fmt: skip
