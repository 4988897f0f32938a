"""How far the default step of every shipped scene is from its own edge.

The scene itself is run from its start, shortened to "until", with all its limits (sound, viscosity, capillary,
heat, the laser's rise) times one factor. The margin is the largest factor at which it is stable by the criterion of
the edges, with its own default step as the reference. "Ruled by" is what rules the default step of the shipped
scene, and "next" how much longer the next limit would let it be. Promised is a margin of 1.25 at least; a scene
that does not keep it is marked.
"""

from collections.abc import Callable
from typing import Any

from taichi_slm.benchmark.measure import say
from taichi_slm.benchmark.report import Findings
from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Config
from taichi_slm.config.shipped import scene_names, scene_path
from taichi_slm.stress.processes import side_by_side
from taichi_slm.stress.scenes import FACTORS, Setting, stepped
from taichi_slm.stress.search import largest_stable
from taichi_slm.stress.watch import STEPS, Seen, watch

PROMISED = 1.25
UNTIL: dict[str, float] = {  # [s]
    "column_two_fluids": 1.0, "droplet_thermal_cycle": 1.0, "spot_weld_3ms": 1.5e-3, "track_50W": 150e-6,
    "track_100W": 120e-6, "track_150W": 100e-6, "track_200W": 100e-6, "track_doped": 120e-6, "track_tracers": 100e-6,
    "track_316L_physical": 60e-6, "track_3d": 60e-6,
}  # fmt: skip
QUICK = ("column_two_fluids", "track_150W")


def scene(name: str) -> Config:
    """The shipped scene, shortened."""
    overrides = [f"time.end={UNTIL[name]}"] if name in UNTIL else []
    return load_config(scene_path(name), overrides).config


def margin(name: str, bisections: int) -> dict[str, Any]:
    """The bracket of the largest stable factor of all limits, and why the shortest unstable run ended."""
    from taichi_slm.run.estimate import estimate

    told = estimate(load_config(scene_path(name)))
    config = scene(name)
    reference = watch(config, lambda _: None)
    say(f"1 x: {reference.failure or 'the reference'} ({reference.steps} steps)")
    tried: dict[float, Seen] = {1.0: reference}

    def stable(multiple: float) -> bool:
        if multiple not in tried:
            cap = int(STEPS * max(reference.steps, 100))
            tried[multiple] = watch(
                stepped(config, Setting(), "all", multiple), lambda _: None, "f64", reference, 0.0, cap
            )
            say(f"{multiple:.3g} x: {tried[multiple].failure or 'stable'} ({tried[multiple].steps} steps)")
        return not tried[multiple].failure

    found = largest_stable(stable, 1.0, 0.5, 8.0, bisections)
    flow = {each: told.limits[each] for each in ("sound", "viscosity", "capillary") if each in told.limits}
    order = sorted(flow, key=lambda each: flow[each])
    factor = getattr(config.numerics, FACTORS[order[0]])
    return {
        "stable": found.stable, "unstable": found.unstable,
        "why": tried[found.unstable].failure if found.unstable else "",
        "rules": f"{order[0]} ({FACTORS[order[0]]} {factor:g})",
        "next": f"{order[1]} {flow[order[1]] / flow[order[0]]:.2f}" if len(order) > 1 else "",
        "step": flow[order[0]], "until": config.time.end, "removed": reference.removed,
    }  # fmt: skip


def compute(findings: Findings, quick: bool, jobs: int, tell: Callable[[str], None]) -> None:
    """One row a scene."""
    names = [name for name in scene_names() if not quick or name in QUICK]
    plan = {name: {"name": name, "bisections": 1 if quick else 3} for name in names}
    rows = []
    for name, found in side_by_side("stress.margins:margin", plan, jobs, tell).items():
        if "failure" in found:
            rows.append(
                {"scene": name, "what ended it": found["failure"], "keeps its margin": "not measured"}
            )
            continue
        kept = found["stable"] is not None and found["stable"] >= PROMISED
        why = found["why"]
        rows.append({
            "scene": name, "ruled by": found["rules"], "next": found["next"], "default step [s]": found["step"],
            "until [s]": found["until"], "margin": found["stable"], "unstable at": found["unstable"],
            "keeps its margin": "yes" if kept else "no",
            "what ended it": "blew up" if why.startswith("blew up") and "collapsed" not in why else why,
        })  # fmt: skip
    findings.table(
        "margins", f"Margin of the default step in every shipped scene, promised {PROMISED:g}", rows
    )
