"""What an error costs.

Scenes with an exact or a measured answer (those of `taichi-slm verify`), each run in a process of its own on one
thread: at several spacings in f64 and f32, and in f64 with the kernels compiled by quadrants where that is installed;
and at several time steps (all limits times one factor) at one spacing.
Where a lattice cuts a drop is chance, and so is the error of one run: that of the static drop at R/dx 14 is 0.02 % to
0.8 % for spacings within 6 %, and crosses zero. So every row is several runs, their spacings a few per cent apart
(Neumann melting: their distances two spacings): the error is the root mean square of theirs, time their median.
"Paper's steps" is the same scene and spacing stepped as the paper does: 0.05 h/c0, nothing skipped, heat in every
step by its Algorithm 1 with an apparent heat capacity. "Paper's forms" has every printed form as well
(configs/paper.yaml); most end early, and who has not ended after ten minutes is stopped. They take so long that they
are one run each. Time is that of the steps, without the compiling. Cases run beside each other, one on a core; the
runs of a case are made in turn on the same core.
"Dominated by" is, of default settings in f64, the largest factor by which other settings at the same resolution are
both faster and nearer to the answer. Those with 1 or less are on the front; up to 1.05 they cannot be told from it:
times of the same run scatter by that. Errors scatter, too: others count as nearer when their squared errors are smaller
on the same lattices by more than 2.1 standard errors of the mean (95 %, of five), and as equally near otherwise. And an
answer may itself be known to some digits only: radius and depth of the weld were published to 0.01 mm, so what comes
nearer to them by less than half of that in both (2.2 %) is not nearer. "By bare numbers" is the same without either.
"""

import importlib
import statistics
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from taichi_slm.benchmark.measure import Yardstick, a_core_each, processes_in_turn
from taichi_slm.benchmark.paper import NO_SKIPS, PAPER_FORMS, PAPER_STEPS
from taichi_slm.benchmark.report import Findings
from taichi_slm.compiler import VARIABLE, installed
from taichi_slm.config.schema import Config
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Curve

STEP_FACTORS = (0.25, 0.5, 1.5)
FORMS_END_WITHIN = 600.0  # [s]; those of the weld do not end within an hour
_LIMITS = ("courant", "viscous_factor", "capillary_factor", "heat_factor", "temperature_step")
_PUBLISHED = "the paper, published"
_MARKED = ("step", "paper's steps", "paper's forms", _PUBLISHED)  # settings that are points of the plots
CERTAIN = 2.13  # standard errors of a mean of five that 95 % of chance stays below, on one side (Student's t)
UM = 1e-6


def _within_6_per_cent(level: float) -> list[float]:
    return [share * level for share in (1.0, 0.94, 0.97, 1.03, 1.06)]


def _two_further(level: int) -> list[int]:
    return list(range(level - 2, level + 3))


@dataclass(frozen=True)
class Answered:
    """A scene with an answer: its error at a level of resolution."""

    title: str
    module: str  # of verification.cases
    levels: tuple[Any, ...]  # spacings or spacings per something; the quick ones are the first two
    middle: Any  # where time steps are varied
    error: Callable[[Any, Any], float]  # (module, level) -> relative error
    # the levels that stand for one, which is among them
    near: Callable[[Any], Sequence[Any]] = _within_6_per_cent
    known_to: float = 0.0  # error of the answer itself


def _swing(module: Any, resolution: float) -> float:
    found = module.swing(2, resolution, "lattice")
    return float(np.sqrt(np.mean((found["moment"] - found["exact"]) ** 2)) / np.abs(found["exact"]).max())


def _jump(module: Any, resolution: float) -> float:
    found = module.history(2, resolution, "lattice", periods=1.0)
    return abs(float(found["pressure"][found["time"] > 0.5].mean()) - 1.0)


def _front(module: Any, travelled: int) -> float:
    return abs(float(module.front(20.9, travelled)[0]) / module.exact_lambda(20.9) - 1.0)


def _source(module: Any, dx: float) -> float:
    depth, end = 20 * UM, 50e-6
    sim = module.heated(dx, depth, end, 0.0, (230 * UM, 230 * UM, 160 * UM))
    exact = module.rise(module.from_beam(sim), end, depth)
    return float(np.abs(sim.temperature - module.START - exact).max() / exact.max())


def _cycle(module: Any, resolution: float) -> float:
    config = module.scene(2).model_copy(update={"spacing": 1.0 / resolution})
    found = module.errors(config)
    return float(module.worst(found.inside, found.time, 1, 2))


def _weld(module: Any, spacing: float) -> float:
    pool, (radius, depth) = module.weld(module.scene(spacing)), module.measured()
    return float(np.hypot(pool.radius / radius - 1.0, pool.depth / depth - 1.0))


CASES = {
    "oscillating_drop": Answered("Oscillating drop: second moment, rms over the amplitude", "oscillating_drop",
                                 (8, 14, 20, 40), 14, _swing),
    "static_drop": Answered("Static drop: Laplace jump", "static_drop", (8, 14, 20, 40), 14, _jump),
    "neumann": Answered("Neumann melting: rate of the front", "neumann", (8, 16, 24, 40), 16, _front, _two_further),
    "gaussian_source": Answered("Gaussian source: largest deviation over the largest rise", "gaussian_source",
                                (28 * UM, 20 * UM, 14 * UM, 10 * UM), 20 * UM, _source),
    "thermal_cycle": Answered("Test 1: volume of the inside, two cycles", "thermal_cycle", (12, 20, 32), 20, _cycle),
    "spot_weld": Answered("Spot weld: radius and depth against the measured ones", "spot_weld",
                          (60 * UM, 50 * UM, 40 * UM), 60 * UM, _weld,
                          known_to=float(np.hypot(0.005 / 0.48, 0.005 / 0.26))),
}  # fmt: skip
SLOW = ("spot_weld",)  # begun first, and not looked at in a quick run
# Tables 2 and 3 of the paper
PUBLISHED = {
    "spot_weld": {"settings": _PUBLISHED, "resolution": "50 um", "particles": 19_000, "seconds": 200 * 3600.0,
                  "error": float(np.hypot(0.46 / 0.48 - 1.0, 0.25 / 0.26 - 1.0))},
}  # fmt: skip
NOTES = {
    "spot_weld": "Radius and depth of one pulse; the absorptivity is chosen on this case (docs/verification.md). "
    "What the paper published is 200 cpu-hours on a laptop of 2012, until all was solid; the others end at 3.2 ms.",
}


def compute(findings: Findings, quick: bool, yardstick: Yardstick) -> None:
    """A table and a plot for every case."""
    names = [name for name in CASES if name not in SLOW] if quick else [*SLOW, *CASES]

    def measure(name: str) -> dict[str, list[dict[str, Any]]]:
        return processes_in_turn(jobs(name, quick), "benchmark.accuracy:point", 1, yardstick)

    measured = a_core_each({name: partial(measure, name) for name in names})
    for name, case in CASES.items():
        if name not in measured:
            continue
        rows = [_row(label, run) for label, (run,) in measured[name].items()]
        add_front(rows, case.known_to)
        for row in rows:
            row["of the runs"] = ", ".join(f"{error:.3g}" for error in row.pop("errors", ()))
        rows += [PUBLISHED[name]] if name in PUBLISHED else []
        findings.table(f"accuracy_{name}", case.title, rows, NOTES.get(name, ""))
        _plot(findings, name, case.title, rows)


def jobs(name: str, quick: bool) -> dict[str, dict[str, Any]]:
    """The runs of a case by their names; the arguments of :func:`point`, and the environment."""
    case = CASES[name]
    levels = case.levels[:2] if quick else case.levels
    middle = case.levels[0] if quick else case.middle
    plan = {f"f64, {_level(level)}": {"level": level} for level in levels}
    plan |= {f"f32, {_level(level)}": {"level": level, "precision": "f32"} for level in levels}
    if "quadrants" in installed():
        other = {"environment": {VARIABLE: "quadrants"}}
        plan |= {f"quadrants, {_level(level)}": {"level": level, **other} for level in levels}
    for factor in STEP_FACTORS[1:] if quick else STEP_FACTORS:
        plan[f"step x {factor:g}, {_level(middle)}"] = {"level": middle, "step": factor}
    plan[f"paper's steps, {_level(middle)}"] = {"level": middle, "forms": "steps"}
    printed = {"level": middle, "forms": "printed", "ends_within": FORMS_END_WITHIN}
    plan[f"paper's forms, {_level(middle)}"] = printed
    return {label: {"case": name, "alone": quick, **arguments} for label, arguments in plan.items()}


def point(
    case: str, level: Any, precision: str = "f64", step: float = 1.0, forms: str = "", alone: bool = False
) -> dict[str, Any]:
    """A case at ``level``: error, seconds of the steps; steps and particles of the run at the level itself.

    ``alone``: of that run only, and with the paper's ``forms`` always; otherwise of all levels that stand for this one.
    """
    levels = [level] if alone or forms else CASES[case].near(level)
    runs = [one_run(case, each, precision, step, forms) for each in levels]
    errors = [run["error"] for run in runs]
    return runs[levels.index(level)] | {
        "error": float(np.sqrt(np.mean(np.square(errors)))), "errors": errors, "runs": len(runs),
        "seconds": statistics.median(run["seconds"] for run in runs),
    }  # fmt: skip


def one_run(case: str, level: Any, precision: str, step: float, forms: str) -> dict[str, Any]:
    """Run a case once: its error, the seconds of its steps, steps and particles."""
    chosen = CASES[case]
    module = importlib.import_module(f"taichi_slm.verification.cases.{chosen.module}")
    made: list[Simulation] = []

    def simulate(config: Config, **arguments: Any) -> Simulation:
        made.append(
            Simulation(changed(config, step, forms), **{**arguments, "threads": 1, "precision": precision})
        )
        return made[-1]

    with _simulations_by(simulate, module):
        error = chosen.error(module, level)
    sim = made[-1]
    return {"error": error, "seconds": sim.solver_time_s, "steps": sim.steps, "particles": sim.scene.count,
            "ended": sim.time / sim.config.time.end}  # fmt: skip


def changed(config: Config, step: float, forms: str) -> Config:
    """The config of a case with its step limits times ``step``, or stepped as the paper does, or with its forms."""
    numerics = config.numerics.model_dump()
    performance = config.performance.model_dump()
    if forms:
        numerics |= PAPER_STEPS if forms == "steps" else PAPER_FORMS
        performance |= NO_SKIPS
    else:
        numerics |= {name: step * numerics[name] for name in _LIMITS}
    parts = {
        "numerics": type(config.numerics)(**numerics),
        "performance": type(config.performance)(**performance),
    }
    return config.model_copy(update=parts)


@contextmanager
def _simulations_by(build: Callable[..., Simulation], module: Any) -> Iterator[None]:
    """The functions of a case build their simulations themselves; in here, by ``build``."""
    pools: Any = importlib.import_module("taichi_slm.verification.pools")
    places = [each for each in (module, pools) if hasattr(each, "Simulation")]
    for each in places:
        each.Simulation = build
    try:
        yield
    finally:
        for each in places:
            each.Simulation = Simulation


def _level(level: Any) -> str:
    return f"{level / UM:g} um" if isinstance(level, float) else str(level)


def _row(label: str, found: dict[str, Any]) -> dict[str, Any]:
    settings, level = label.rsplit(", ", 1)
    row: dict[str, Any] = {"settings": settings, "resolution": level}
    if "failure" in found:
        return row | {"failure": found["failure"]}
    if found["error"] is None or not np.isfinite(found["error"]):
        return row | {"failure": f"ended after {found['ended']:.2f} of the time"}
    return row | {"runs": found["runs"], "particles": found["particles"], "flow steps": found["steps"],
                  "seconds": found["seconds"], "error": found["error"], "errors": found["errors"]}  # fmt: skip


def add_front(rows: list[dict[str, Any]], known_to: float = 0.0) -> None:
    """Say of default settings in f64 by how much others at their resolution dominate them.

    ``known_to``: error of the answer itself.
    """
    measured = [row for row in rows if "error" in row]
    for row in measured:
        if row["settings"] == "f64":
            others = [
                each for each in measured if each is not row and each["resolution"] == row["resolution"]
            ]
            faster = [row["seconds"] / other["seconds"] for other in others]
            bare = [_bare_ratio(row, other) for other in others]
            certain = [_ratio(row, other, known_to) for other in others]
            row["dominated by"] = max(map(min, faster, certain), default=0.0)
            row["by bare numbers"] = max(map(min, faster, bare), default=0.0)


def _bare_ratio(row: dict[str, Any], other: dict[str, Any]) -> float:
    """How many times as far from the answer ``row`` is as ``other``."""
    return float(row["error"] / max(other["error"], 1e-300))


def _ratio(row: dict[str, Any], other: dict[str, Any], known_to: float) -> float:
    """The same; 1 where ``row`` is further, but not for certain, or by less than the answer is known to."""
    ratio = _bare_ratio(row, other)
    if ratio > 1.0 and row["error"] - other["error"] < known_to:
        return 1.0
    if ratio > 1.0 and len(row["errors"]) == len(other["errors"]) > 1:
        gaps = np.square(row["errors"]) - np.square(other["errors"])  # on the same lattices
        if gaps.mean() < CERTAIN * gaps.std(ddof=1) / np.sqrt(len(gaps)):
            return 1.0
    return ratio


def _plot(findings: Findings, name: str, title: str, rows: list[dict[str, Any]]) -> None:
    measured = [row for row in rows if "error" in row]

    def curve(settings: str, style: Any) -> Curve:
        own = sorted(
            (row for row in measured if row["settings"].startswith(settings)), key=lambda row: row["seconds"]
        )
        return Curve(settings, [row["seconds"] for row in own], [row["error"] for row in own], style)

    styles = {"f64": "line", "f32": "dashed", "quadrants": "dashed"} | dict.fromkeys(_MARKED, "points")
    curves = [curve(settings, style) for settings, style in styles.items()]
    findings.plot(f"accuracy_{name}", title, "run time of the steps [s]", "relative error [1]", curves)
