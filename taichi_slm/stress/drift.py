"""What shorter steps buy below the edge.

Elliptic drop (inviscid, R/dx 12, c0 15, nothing but the scheme can change its energy): kinetic plus elastic energy
at A0 t = 1 over that of the start, less one, at a quarter, half and once the default step and half-way to the edge
(on a logarithmic scale), with the default forms, with the printed integrator, and with the printed forms at their
own step; a change by a tenth counts as unstable. The weld and the track without flow: the error of the energy
account, and the heat that they hold in the end against that at the shortest step, where heat alone rules the step
once the beam is off.
"""

from collections.abc import Callable
from typing import Any

from taichi_slm.benchmark.measure import say
from taichi_slm.benchmark.report import Findings
from taichi_slm.stress.processes import side_by_side
from taichi_slm.stress.scenes import SCENES, Setting, stepped
from taichi_slm.stress.search import largest_stable
from taichi_slm.stress.watch import watch
from taichi_slm.verification.case import Curve
from taichi_slm.verification.cases import elliptic_drop

RESOLUTION, COURANT = 12, 0.4
WHOLE = elliptic_drop.TIMES[[0, -1]]  # the run in one go: no step is shortened to meet a time between
BELOW = (0.25, 0.5, 1.0)
FORMS: dict[str, dict[str, Any]] = {
    "default": {},
    "printed integrator": {"integrator": "leapfrog_printed"},
    "printed forms": elliptic_drop.PRINTED,
}
PRINTED_STEPS = (0.125, 0.25, 0.0625, 0.03125, 1.0)
GONE = 0.1  # relative change of the energy from which the drop counts as unstable


def ellipse(form: str, multiples: list[float], bisections: int) -> dict[str, Any]:
    """Relative change of the elliptic drop's energy at multiples of the default step; None after a blow-up."""
    changes: dict[float, float | None] = {}
    elliptic_drop.TIMES = WHOLE

    def change(multiple: float) -> float:
        found = elliptic_drop.stretch(RESOLUTION, courant=COURANT * multiple, **FORMS[form])["total"]
        value = float(found[-1] / found[0] - 1.0)
        changes[multiple] = value if abs(value) < 1e6 else None
        say(f"{multiple:.3g} x: {value:.3g}")
        return value

    if form == "default":
        edge = largest_stable(lambda multiple: abs(change(multiple)) < GONE, bisections=bisections)
        halfway = (edge.stable or 1.0) ** 0.5
    else:
        edge, halfway = None, None
    for multiple in [*multiples, *([halfway] if halfway else [])]:
        if multiple not in changes:
            change(multiple)
    return {"changes": sorted(changes.items()), "edge": edge.stable if edge else None, "halfway": halfway}


def heat(scene: str, multiples: list[float]) -> dict[str, Any]:
    """Error of the energy account and heat held in the end [J, in 2-D J/m] at multiples of the default heat step."""
    rows = []
    for multiple in multiples:
        config = stepped(SCENES[scene].build(Setting()), Setting(), "heat", multiple)
        seen = watch(config, SCENES[scene].start)
        say(f"{multiple:.3g} x: account {seen.energy_error:.2g}")
        rows.append([multiple, seen.energy_error, seen.stored, seen.failure])
    return {"rows": rows}


def compute(findings: Findings, quick: bool, jobs: int, tell: Callable[[str], None]) -> None:
    """Tables of the drop's energy and of the heat scenes' accounts."""
    below = list(BELOW[1:] if quick else BELOW)
    printed = list(PRINTED_STEPS[:2] if quick else PRINTED_STEPS)
    drops = {
        form: {
            "form": form,
            "multiples": below if form == "default" else printed,
            "bisections": 1 if quick else 3,
        }
        for form in FORMS
        if not (quick and form == "printed integrator")
    }
    found = side_by_side("stress.drift:ellipse", drops, jobs, tell)
    rows, curves = [], []
    for form, result in found.items():
        if "failure" in result:
            rows.append({"forms": form, "remark": result["failure"]})
            continue
        for multiple, change in result["changes"]:
            remark = "half-way to the edge" if multiple == result["halfway"] else ""
            gone = change is None or abs(change) >= GONE
            rows.append({"forms": form, "step over the default": multiple, "courant": COURANT * multiple,
                         "energy change": change, "remark": "unstable" if gone else remark})  # fmt: skip
        kept = [(m, abs(c)) for m, c in result["changes"] if c is not None]
        curves.append(Curve(form, [m for m, _ in kept], [c for _, c in kept], "points"))
    findings.table("drift_drop", "Energy of the elliptic drop", rows)
    findings.plot("drift_drop", "Elliptic drop: energy", "step over the default", "|relative change|", curves)
    _heat(findings, ("track",) if quick else ("weld", "track"), below, jobs, tell)


def _heat(
    findings: Findings,
    scenes: tuple[str, ...],
    multiples: list[float],
    jobs: int,
    tell: Callable[[str], None],
) -> None:
    plan = {scene: {"scene": scene, "multiples": multiples} for scene in scenes}
    rows = []
    for scene, result in side_by_side("stress.drift:heat", plan, jobs, tell).items():
        if "failure" in result:
            rows.append({"scene": scene, "remark": result["failure"]})
            continue
        finest = result["rows"][0][2]
        for multiple, error, stored, failure in result["rows"]:
            rows.append({"scene": scene, "step over the default": multiple, "account error": error,
                         "heat against the shortest step": stored / finest - 1.0, "remark": failure})  # fmt: skip
    findings.table("drift_heat", "Energy account of conduction", rows)
