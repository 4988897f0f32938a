"""The largest stable step of each limit.

A limit is measured in a scene where it rules: sound in the drop, the column, the weld and the track; the capillary
limit in a drop of low c0 and in the track; viscosity in a drop and a column of thick liquid; heat in the weld and
the track. The step is then a multiple of this limit and of nothing else: the other limits of the flow are lifted,
and "over other limits" says how many times their own default limit the longest stable step was (the edge may be
theirs). Heat is measured without flow, at 0.4 of the laser's power (no flow carries the heat away), over the beam
and, what counts, 60 heat steps of cold metal after it.

A multiple counts from the default factor of the limit (courant 0.4, viscous_factor 0.08, capillary_factor 0.25,
heat_factor 0.2), in every row. It is doubled until a run is unstable, or halved until one is stable, then bisected
on a logarithmic scale; the edge lies between "stable" and "unstable". The criterion: the run ends; at each of 40
instants its kinetic energy is at most 3 times the largest of the reference in the same quarter of the run (or 1 %
of the reference's largest, or, for the column, 1e-4 M g H), its speed at most 3 times the reference's (or 0.1 % of
c0), its temperatures within the reference's range widened by a quarter on either side; no more particles are
removed than in the reference, but for 1 % and two; the accounts of mass and energy are kept to 1e-6 and 1 %. The
reference is the same matter at the same spacing with the default forms, in f64, at the default step of this limit.

"Printed integrator" is (B.1) with the default forms, "printed forms" is configs/paper.yaml but for its steps; the
paper's own step, 0.05 h/c0, is 0.125 of the default one. The printed forms have another solution than the default
ones, whatever the step: they are judged by their own run at half the paper's step, and the remark says what that run
shows by the criterion beside the default forms.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from taichi_slm.benchmark.measure import say
from taichi_slm.benchmark.report import Findings
from taichi_slm.config.numerics import Numerics
from taichi_slm.stress.processes import side_by_side
from taichi_slm.stress.scenes import FACTORS, LIFTED, SCENES, Setting, stepped
from taichi_slm.stress.search import Bracket, largest_stable
from taichi_slm.stress.watch import STEPS, Seen, fault, watch
from taichi_slm.verification.case import Curve

PAPERS_STEP = 0.125  # 0.05 h/c0 in units of the default
AXES: dict[str, dict[str, Setting]] = {
    "c0": {f"c0 x {factor:g}": Setting(c0=factor) for factor in (0.5, 2.0)},
    "delta": {f"delta {delta:g}": Setting(numerics={"delta": delta}) for delta in (0.0, 0.03, 0.3)},
    "viscosity": {f"viscosity x {factor:g}": Setting(viscosity=factor) for factor in (0.1, 10.0)},
    "spacing": {f"spacing x {factor:g}": Setting(spacing=factor) for factor in (1.4, 0.7)},
    "precision": {"f32": Setting(precision="f32")},
    "integrator": {
        "kick-drift": Setting(numerics={"integrator": "kick_drift"}),
        "printed integrator": Setting(numerics={"integrator": "leapfrog_printed"}),
        "printed forms": Setting(printed=True),
    },
}
THICK = {"drop": 500.0, "column": 10.0}  # viscosity x, where it rules the step
RULING: dict[str, tuple[str, ...]] = {
    "drop": ("sound", "viscosity"), "soft drop": ("capillary",), "column": ("sound", "viscosity"),
    "weld": ("sound", "heat"), "track": ("sound", "capillary", "heat"),
}  # fmt: skip
QUICK: dict[str, tuple[str, ...]] = {
    "drop": ("sound",), "soft drop": ("capillary",), "column": ("sound",), "weld": ("sound",), "track": ("heat",),
}  # fmt: skip
SUBJECTS = {"drop": ("drop", "soft drop"), "column": ("column",), "weld": ("weld",), "track": ("track",)}
OWN_AXES = {"sound": tuple(AXES), "capillary": ("viscosity", "spacing", "precision"),
            "viscosity": ("spacing", "precision"), "heat": ("spacing", "precision")}  # fmt: skip


def plan(subject: str, quick: bool) -> dict[str, dict[str, Any]]:
    """The searches of a subject by name: arguments of :func:`edge`. A quick look leaves out most settings."""
    found: dict[str, dict[str, Any]] = {}
    for scene in SUBJECTS[subject]:
        limits = QUICK[scene] if quick else RULING[scene]
        for limit in limits:
            for label, setting in _settings(scene, limit, quick).items():
                thick = THICK[scene] if limit == "viscosity" else 1.0
                setting = Setting(**{**asdict(setting), "viscosity": thick * setting.viscosity})
                printed = setting.printed or setting.numerics.get("integrator") == "leapfrog_printed"
                found[f"{scene}, {limit}, {label}"] = {
                    "scene": scene, "limit": limit, "setting": asdict(setting), "bisections": 1 if quick else 3,
                    "first": PAPERS_STEP if printed and limit == "sound" else 1.0,
                }  # fmt: skip
    return found


def _settings(scene: str, limit: str, quick: bool) -> dict[str, Setting]:
    axes = {name: AXES[name] for name in OWN_AXES[limit]}
    if quick:
        axes = {"integrator": {"printed integrator": AXES["integrator"]["printed integrator"]}}
        axes = axes if (scene, limit) == ("column", "sound") else {}
    return {"default": Setting(), **{label: each for axis in axes.values() for label, each in axis.items()}}


def edge(scene: str, limit: str, setting: Mapping[str, Any], bisections: int, first: float) -> dict[str, Any]:
    """The bracket of the largest stable multiple; what ended the shortest unstable run; ratios to the other limits."""
    chosen, forms = SCENES[scene], Setting(**setting)
    physical = forms.physical()
    reference = watch(stepped(chosen.build(physical), physical, limit, 1.0), chosen.start)
    if reference.failure:
        return {"failure": f"the reference: {reference.failure}"}
    tried: dict[float, Seen] = {}
    remark = ""
    if forms.printed:
        own = watch(stepped(chosen.build(forms), forms, limit, 0.5 * first), chosen.start, forms.precision)
        say(f"{0.5 * first:.3g} x: {own.failure or 'the printed forms own reference'} ({own.steps} steps)")
        beside = own.failure or fault(own, reference, chosen.build(forms).numerics.sound_speed, chosen.still)
        remark = f"at {0.5 * first:.3g}: {_short(beside) or 'as the default forms'}"
        if own.failure:
            return asdict(Bracket(None, 0.5 * first, 1)) | {"why": own.failure, "over": {}, "remark": remark}
        reference = own
    cap_of = max(reference.steps * (0.5 * first if forms.printed else 1.0), 100.0)
    default = chosen.build(physical).numerics.model_dump()
    others = {name: default[key] for name, key in FACTORS.items()}

    def stable(multiple: float) -> bool:
        config = stepped(chosen.build(forms), forms, limit, multiple)
        cap = int(STEPS * max(1.0, 1.0 / multiple) * cap_of)
        seen = watch(config, chosen.start, forms.precision, reference, chosen.still, cap)
        tried[multiple] = seen
        say(f"{multiple:.3g} x: {seen.failure or 'stable'} ({seen.steps} steps)")
        return not seen.failure

    found = largest_stable(stable, first, bisections=bisections)
    return asdict(found) | {
        "why": tried[found.unstable].failure if found.unstable else "",
        "over": _over(tried[found.stable], limit, others) if found.stable else {},
        "remark": remark,
    }


def _over(seen: Seen, limit: str, default: Mapping[str, float]) -> dict[str, float]:
    """The longest step over the other limits with their default factors; they were lifted by a known factor."""
    return {name: ratio * LIFTED / default[name] for name, ratio in seen.ratios.items() if name != limit}


def compute(subject: str, findings: Findings, quick: bool, jobs: int, tell: Callable[[str], None]) -> None:
    """A table of the scene, and a plot for each limit."""
    searches = plan(subject, quick)
    found = side_by_side("stress.edges:edge", searches, jobs, tell)
    rows = [row(name, found[name]) for name in searches]
    findings.table(f"edges_{subject}", f"Largest stable step: {subject}", rows)
    for limit in dict.fromkeys(job["limit"] for job in searches.values()):
        _plot(findings, subject, limit, found)


def row(name: str, found: Mapping[str, Any]) -> dict[str, Any]:
    """A row of the table."""
    scene, limit, label = name.split(", ", 2)
    start = {"limit": limit, "setting": label if scene != "soft drop" else f"c0 / 5, {label}"}
    if "failure" in found:
        return start | {"why": found["failure"]}
    factor = getattr(Numerics(), FACTORS[limit])
    stable, above = found["stable"], found["unstable"]
    return start | {
        "stable": stable, "unstable": above, "as a factor": factor * stable if stable else None,
        "over other limits": ", ".join(f"{each} {ratio:.2g}" for each, ratio in found["over"].items()),
        "what ended it": _short(found["why"]) if stable else f"not even at {above:.3g}: {_short(found['why'])}",
        "remark": found["remark"],
    }  # fmt: skip


def _short(why: str) -> str:
    """Without the names of particles and places."""
    return "blew up" if why.startswith("blew up") and "collapsed" not in why else why


def _plot(findings: Findings, subject: str, limit: str, found: Mapping[str, Any]) -> None:
    """The multiple of every setting, in the order of the table."""
    curves, labels = [], ["default", *(label for axis in OWN_AXES[limit] for label in AXES[axis])]
    for scene in SUBJECTS[subject]:
        edges = {label: found.get(f"{scene}, {limit}, {label}", {}).get("stable") for label in labels}
        known = [label for label in labels if edges[label]]
        curves.append(Curve(scene, [edges[label] for label in known], known, "points"))
    drawn = [label for curve in curves for label in curve.y]
    if drawn:
        curves.append(Curve("default step", [1.0, 1.0], [drawn[0], drawn[-1]], "dashed"))
    title = f"Largest stable step: {subject}, {limit}"
    findings.plot(f"edges_{subject}_{limit}", title, "multiple of the default step", "", curves, "x")
