"""Every switch of `performance:` off in turn, and all off.

A short melting track on a plate that stays mostly cold. Time is that of the same track with a switch off over that
with all on, from runs in turn, each in a process of its own on one thread. "Paper's steps" are 0.05 h/c0 with heat in
each by its Algorithm 1. The difference is that of the results after 30 us, before round-off has grown into another
flow: root mean square of the temperature over the hottest rise, of the place of what is or was liquid in spacings, and
of the pool's sizes in spacings. A run whose lists are built at other moments (skin 0.42 instead of 0.4) stands beside:
its sums are in another order, so its difference is what round-off makes of a flow, and no skip can be told from it
by less.
"""

import statistics
from typing import Any

import numpy as np

from taichi_slm.benchmark.measure import Yardstick, processes_in_turn
from taichi_slm.benchmark.paper import NO_SKIPS, PAPER_RUN, PAPER_STEPS
from taichi_slm.benchmark.report import Findings
from taichi_slm.benchmark.scenes import track
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.pools import pool_now

ON, ALL_OFF, ROUND_OFF = "all on", "all off", "round-off only"
EXACT, SCATTER = (
    (1e-4, 0.05, 0.1),
    (0.02, 1.0, 2.0),
)  # temperature [rise], places [dx], sizes of the pool [dx]
COMPARED = 30e-6  # [s]
CHANGES_STEPS = ("round-off", "heat_clock", "keep_neighbours", "all off")
NOTE = (
    "Expected of a skip that only leaves out what adds nothing: temperature within {} of the hottest rise, places "
    "within {} and the pool's sizes within {} spacings. Of what changes steps, sums or the moment at which melt is "
    "let go: {}, {} and {}, since two runs of a flow part that far on their own."
).format(*EXACT, *SCATTER)


def compute(findings: Findings, quick: bool, yardstick: Yardstick) -> None:
    """One table: the track with its flow, and the same without."""
    rows: list[dict[str, Any]] = []
    for flow in (True, False):
        switches: dict[str, dict[str, Any]] = {ON: {}, ROUND_OFF: {"skin": 0.42}}
        switches |= {f"{name} off": {name: value} for name, value in NO_SKIPS.items() if flow or _heats(name)}
        switches[ALL_OFF] = dict(NO_SKIPS)
        jobs = {name: {"switches": off, "flow": flow, "quick": quick} for name, off in switches.items()}
        jobs[PAPER_RUN] = jobs[ALL_OFF] | {"numerics": PAPER_STEPS}
        found = processes_in_turn(
            jobs, "benchmark.skips:melt", 2 if quick else 5, yardstick, once=(PAPER_RUN,)
        )
        scene = "with flow" if flow else "heat alone"
        rows += [{"scene": scene, "skips": name, **_compared(name, found[name], found[ON])} for name in found]
    findings.table("skips", "One skip off at a time", rows, NOTE)


def _heats(switch: str) -> bool:
    return switch in ("skip_cold", "skip_dark")


def melt(
    switches: dict[str, Any], flow: bool, quick: bool, numerics: dict[str, Any] | None = None
) -> dict[str, Any]:
    """A track with ``switches`` of performance, and ``numerics``, changed: its time and its result."""
    changes: dict[str, Any] = {"performance": switches, "numerics": numerics or {},
               "physics": {"flow": flow, **({} if flow else {"radiation": False})}}  # fmt: skip
    config = track(3 if quick else 6, plate=2.0, duration=COMPARED if quick else 100e-6, **changes)
    sim = Simulation(config, threads=1)
    sim.advance(COMPARED)
    pool, arrays = pool_now(sim), sim.arrays(("id", "position", "temperature", "ever_liquid"))
    result = {"rise": sim.hottest - config.ambient_temperature, "spacing": config.spacing,
              "length": pool.length, "depth": pool.depth, **arrays}  # fmt: skip
    sim.run()
    return result | {"seconds": sim.solver_time_s, "steps": sim.steps, "particles": sim.scene.count}


def _compared(name: str, runs: list[dict[str, Any]], reference: list[dict[str, Any]]) -> dict[str, Any]:
    first, to = runs[0], reference[0]
    if "failure" in first or "failure" in to:
        return {"failure": first.get("failure") or to.get("failure")}
    seconds = [run["seconds"] for run in runs]
    times = [
        a / b["seconds"] for a, b in zip(seconds, reference, strict=False)
    ]  # fewer of one that runs once
    differences = difference(first, to)
    expected = "yes" if within(name, differences) else "no"
    return {
        "particles": first["particles"], "flow steps": first["steps"], "seconds": statistics.median(seconds),
        "time over all on": statistics.median(times), **differences,
        "as expected": "" if name == PAPER_RUN else expected,  # that has another form of latent heat, too
    }  # fmt: skip


def difference(run: dict[str, Any], to: dict[str, Any]) -> dict[str, float]:
    """How far two results are apart; particles that only one of them has are left out of both."""
    _, a, b = np.intersect1d(run["id"], to["id"], return_indices=True)
    T = np.asarray(run["temperature"])[a] - np.asarray(to["temperature"])[b]
    x = (np.asarray(run["position"])[a] - np.asarray(to["position"])[b]) / to["spacing"]
    melted = (np.asarray(run["ever_liquid"])[a] > 0) | (np.asarray(to["ever_liquid"])[b] > 0)
    return {
        "temperature, rms": float(np.sqrt(np.mean(T**2))) / to["rise"],
        "place of the melted, rms dx": float(np.sqrt(np.mean(x[melted] ** 2))) if melted.any() else 0.0,
        "pool length, dx": abs(run["length"] - to["length"]) / to["spacing"],
        "pool depth, dx": abs(run["depth"] - to["depth"]) / to["spacing"],
    }  # fmt: skip


def within(name: str, differences: dict[str, float]) -> bool:
    """Whether they are as small as expected of the switch ``name``."""
    temperature, place, size = SCATTER if name.startswith(CHANGES_STEPS) else EXACT
    found = list(differences.values())
    return found[0] <= temperature and found[1] <= place and max(found[2:]) <= size
