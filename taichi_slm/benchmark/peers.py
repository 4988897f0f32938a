"""PySPH on the same drops.

Two drops that both codes run from the same particles to the same end, in two dimensions and f64, one thread, in turn,
in a process each. Seconds are those of the loop over time, without pictures or files; both were compiled before. Both
codes have the settings that they come with: this program its defaults (but for particle shifting in the elliptic
drop, as in `taichi-slm verify elliptic_drop`), PySPH those of its own examples of these drops (pysph_drop.py). PySPH
is looked for in the interpreter that the environment variable TAICHI_SLM_PYSPH names, or else in this environment. A
ratio is PySPH over this program, above 1 where this program is faster.
"""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from taichi_slm.benchmark.drops import elliptic_error, for_pysph, ours, square_error, started
from taichi_slm.benchmark.measure import Yardstick, in_its_own_process, processes_in_turn, ratio
from taichi_slm.benchmark.pysph_process import PySPH, PySPHError, find
from taichi_slm.benchmark.report import Findings
from taichi_slm.benchmark.speed import to_its_end
from taichi_slm.verification.case import Curve

OURS, THEIRS = "taichi-slm", "PySPH"
WCSPH, INVISCID, DELTA, CSF = "WCSPH", "WCSPH without artificial viscosity", "delta-SPH", "Morris CSF"
SCHEMES: dict[str, dict[str, Any]] = {
    WCSPH: {"alpha": 0.1}, INVISCID: {"alpha": 0.0}, DELTA: {"alpha": 0.1, "delta_sph": True}, CSF: {},
}  # fmt: skip
DEFAULTS, SHIFTED = "defaults", "shifting 20"
SMALLEST = 10  # R/dx of the smallest elliptic drop that both codes run


@dataclass(frozen=True)
class Run:
    """One code on one drop; ``level`` counts spacings per radius (elliptic) or per length (square)."""

    code: str
    scheme: str
    drop: str
    level: int
    arrangement: str = ""
    once: bool = False  # it takes so long that one turn must do

    @property
    def label(self) -> str:
        """Unlike that of any other run."""
        return f"{self.code}, {self.settings}, {RESOLUTION[self.drop]} {self.level}"

    @property
    def settings(self) -> str:
        """Its scheme and arrangement of particles."""
        return f"{self.scheme}, {self.arrangement}" if self.arrangement else self.scheme


@dataclass(frozen=True)
class Measured:
    """A run and what came of each of its turns."""

    run: Run
    turns: Sequence[dict[str, Any]]

    @property
    def failure(self) -> str:
        """A sentence; empty if it ran."""
        return str(self.turns[0].get("failure", ""))

    @property
    def first(self) -> dict[str, Any]:
        """What its first turn gave: error and steps are the same in all."""
        return self.turns[0]

    @property
    def error(self) -> float:
        """Relative; of what, the title of the drop says."""
        return float(self.first["error"])

    def seconds(self) -> float:
        """The median of its turns."""
        return statistics.median(self.per(lambda _: 1.0))

    def per(self, unit: Callable[[dict[str, Any]], float]) -> list[float]:
        """Seconds of every turn, over ``unit`` of it."""
        return [turn["seconds"] / unit(turn) for turn in self.turns]


RESOLUTION = {"elliptic": "R/dx", "square": "1/dx"}
TITLE = {
    "elliptic": "Elliptic drop without viscosity: the semi-axis that is further off",
    "square": "A square becomes a disc by surface tension: Laplace jump",
}
NOTE = {
    "elliptic": (
        "Monaghan's drop, as in `taichi-slm verify elliptic_drop`: same disc, speed of sound, velocity and pressure at "
        "the start, no viscosity; end A0 t = 1. Errors are those of 2 sqrt(mean x^2) against the exact semi-axes; the "
        "error is the larger one. PySPH has two evaluations a step, and the artificial viscosity of its example (alpha "
        "0.1), which this drop should not have, or none. Each code starts from rings and from a lattice: PySPH is "
        "better on rings, this program on a lattice."
    ),
    "square": (
        "PySPH's example: a square of side 0.3, surface tension 1, density 1, kinematic viscosity 0.2, speed of sound "
        "20, until t = {end:g}. Same particles in the liquid, same properties; not the same: PySPH's drop lies in a "
        "periodic box of 1 x 1 full of particles of the same density and viscosity, which count as particles, and ours "
        "in nothing. The surroundings damp the drop as well; at rest both must have sigma/R. The jump is the mean "
        "pressure within R/2 less that of the surroundings (PySPH: beyond 0.35 from the centre, ours: none), at 25 "
        "moments of the second half of the time; the error is the root mean square of what it is off."
    ),
}  # fmt: skip


def compute(findings: Findings, quick: bool, yardstick: Yardstick) -> None:
    """Tables and a plot for each drop, then the ratios."""
    missing, pysph = "", None
    try:
        pysph = find()
    except PySPHError as error:
        missing = str(error)
    end = 0.2 if quick else 1.0  # of the square drop; the other has the end of its exact answer
    measured: dict[str, list[Measured]] = {}
    for drop, title in TITLE.items():
        runs = [run for run in plan(drop, quick) if run.code == OURS or pysph]
        measured[drop] = measure(runs, end, pysph, 1 if quick else 2, yardstick)
        note = NOTE[drop].format(end=end) + (f" PySPH {pysph.version}." if pysph else "")
        rows = [row(each) for each in measured[drop]]
        findings.table(f"peers_{drop}", title, rows + absent(missing), note)
        _plot(findings, drop, title, measured[drop])
    every = [each for found in measured.values() for each in found if not each.failure]
    found = in_its_own_process("benchmark.peers:profile", level=SMALLEST)
    yardstick.measure()
    profiled = found.get("passes", [found])
    findings.table(
        "peers_steps", "PySPH over this program: a step, and the way to the end",
        steps(every, python_and_launches(profiled)) + absent(missing),
        "Of the square drop, once with the same particles in the liquid, and once with at least as many in the liquid "
        "as PySPH has in all. The limit of this machine for our passes, on the smallest drop: the time of a step if "
        "Python and launches, the share of them in the last table, cost us nothing.",
    )  # fmt: skip
    findings.table(
        "peers_error", "PySPH over this program: time to an equal or smaller error", to_error(every) + absent(missing),
        "A coarse run may be near by chance, so the error that a run holds is the largest of it and of all finer ones "
        "of its kind, for both codes. Ours is the quickest run, from either arrangement of the particles, that holds "
        "no larger error than PySPH's.",
    )  # fmt: skip
    findings.table(
        "peers_profile", "Where a step of the smallest drop goes", profiled,
        f"The elliptic one at R/dx {SMALLEST}. What is between the passes, Python and launches, does not shrink with "
        "the drop; the sums over neighbours do.",
    )  # fmt: skip


def profile(level: int) -> dict[str, Any]:
    """All steps of our elliptic drop with a clock on every pass: {"passes": a row for each}."""
    return to_its_end(started("elliptic", level, "rings", 1.0))


def absent(missing: str) -> list[dict[str, Any]]:
    """A row that says that the other code is missing, and why; none if it is there."""
    return [{"code": THEIRS, "failure": missing}] if missing else []


def plan(drop: str, quick: bool) -> list[Run]:
    """What is run, in the order of a turn."""
    if drop == "square":
        levels, theirs = ((20, 40), (20,)) if quick else ((20, 40, 60, 80, 140), (20, 40, 60))
        return [*(Run(OURS, DEFAULTS, drop, n, once=n > 80) for n in levels),
                *(Run(THEIRS, CSF, drop, n, once=n > 20) for n in theirs)]  # fmt: skip
    if quick:
        return [*(Run(OURS, SHIFTED, drop, n, "rings") for n in (5, 10)),
                Run(THEIRS, WCSPH, drop, 10, "rings")]  # fmt: skip
    return [
        *(Run(OURS, SHIFTED, drop, n, "rings", once=n > 28) for n in (5, 7, 10, 14, 20, 28, 40)),
        *(Run(OURS, SHIFTED, drop, n, "lattice") for n in (5, 7, 10, 20)),
        *(Run(THEIRS, WCSPH, drop, n, "rings", once=n > 20) for n in (10, 20, 40)),
        *(Run(THEIRS, INVISCID, drop, n, kind) for kind in ("rings", "lattice") for n in (10, 20)),
        Run(THEIRS, DELTA, drop, 20, "rings"),
        Run(THEIRS, WCSPH, drop, 20, "lattice"),
    ]


def measure(
    runs: Sequence[Run], end: float, pysph: PySPH | None, rounds: int, yardstick: Yardstick
) -> list[Measured]:
    """Each run in a process of its own, one after the other, in ``rounds`` turns."""
    jobs: dict[str, dict[str, Any]] = {}
    for run in runs:
        jobs[run.label] = {"drop": run.drop, "level": run.level, "arrangement": run.arrangement, "end": end}
        if run.code == THEIRS and pysph:
            jobs[run.label] |= {"interpreter": pysph.interpreter} | SCHEMES[run.scheme]
    once = [run.label for run in runs if run.once]
    found = processes_in_turn(jobs, "benchmark.peers:point", rounds, yardstick, once)
    return [Measured(run, found[run.label]) for run in runs]


def point(
    drop: str,
    level: int,
    arrangement: str,
    end: float,
    interpreter: str = "",
    alpha: float = 0.1,
    delta_sph: bool = False,
) -> dict[str, Any]:
    """One run: by this program, or by the PySPH of ``interpreter``; {"failure": a sentence} if that does not answer."""
    if not interpreter:
        return ours(drop, level, arrangement, end)
    try:
        return by_pysph(PySPH(interpreter, ""), for_pysph(drop, level, arrangement, end, alpha, delta_sph))
    except PySPHError as error:
        return {"failure": str(error)}


def by_pysph(pysph: PySPH, job: dict[str, Any]) -> dict[str, Any]:
    """Particles, seconds, steps and error of PySPH's run of ``job``. Raises PySPHError."""
    answer = pysph.run(job)
    count = len(job["position"])
    found = elliptic_error(answer.position) if job["drop"] == "elliptic" else square_error(answer.jump)
    return {"particles": count, "liquid": int(sum(job.get("colour", [1] * count))), "steps": answer.steps,
            "seconds": answer.seconds} | found  # fmt: skip


def row(each: Measured) -> dict[str, Any]:
    """The row of a run."""
    run = each.run
    head: dict[str, Any] = {"code": run.code, "scheme": run.settings, RESOLUTION[run.drop]: run.level}
    if each.failure:
        return head | {"failure": each.failure}
    first, seconds = each.first, each.seconds()
    head["particles"] = first["particles"]
    if run.drop == "square":
        head["of them liquid"] = first["liquid"]
    head |= {
        "steps": first["steps"], "seconds": seconds, "us per step": 1e6 * seconds / first["steps"],
        "ns per particle and step": 1e9 * seconds / first["steps"] / first["particles"],
    }  # fmt: skip
    errors = {name: first[name] for name in ("semi-axis a", "semi-axis b", "mean jump") if name in first}
    return head | errors | {"error": each.error}


def _ours(drop: str, measured: Sequence[Measured]) -> list[Measured]:
    """Our runs of ``drop``, the coarsest first."""
    own = [each for each in measured if each.run.code == OURS and each.run.drop == drop]
    return sorted(own, key=lambda each: each.run.level)


def _over(theirs: Measured, own: Measured, unit: Callable[[dict[str, Any]], float] = lambda _: 1.0) -> float:
    """Seconds per unit, PySPH over ours: the median of the turns that both had."""
    above, below = theirs.per(unit), own.per(unit)
    both = min(len(above), len(below))
    return ratio(above[:both], below[:both])


def python_and_launches(profiled: Sequence[dict[str, Any]]) -> float:
    """The share of a step that is in no pass; 0 where none was measured."""
    return sum(row["share of the time"] for row in profiled if row.get("pass") == "Python and launches")


def steps(measured: Sequence[Measured], outside: float) -> list[dict[str, Any]]:
    """For every run of PySPH: ours with the same liquid particles, and ours with as many as PySPH has in all.

    ``outside``: share of a step of our smallest elliptic drop that is in no pass.
    """
    rows = []
    for theirs in measured:
        if theirs.run.code != THEIRS:
            continue
        alike = [
            own for own in _ours(theirs.run.drop, measured) if own.run.arrangement == theirs.run.arrangement
        ]
        same = [own for own in alike if own.run.level == theirs.run.level]
        many = [own for own in alike if own.first["particles"] >= theirs.first["particles"]][:1]
        for own in [*same, *(own for own in many if own not in same)]:
            rows.append({
                "drop": theirs.run.drop, "PySPH": _named(theirs), "taichi-slm": _named(own),
                "PySPH's particles": theirs.first["particles"], "ours": own.first["particles"],
                "time of a step": _over(theirs, own, lambda turn: turn["steps"]),
                "time per particle and step": _over(theirs, own, lambda turn: turn["steps"] * turn["particles"]),
                "time to the end": _over(theirs, own), "error": _ratio(theirs.error, own.error),
            })  # fmt: skip
            if own.run.drop == "elliptic" and own.run.level == SMALLEST:
                rows[-1]["limit of a step"] = rows[-1]["time of a step"] / (1.0 - outside)
    return rows


def to_error(measured: Sequence[Measured]) -> list[dict[str, Any]]:
    """For every run of PySPH: ours that is no worse, and the time of both."""
    rows = []
    for theirs in measured:
        if theirs.run.code != THEIRS:
            continue
        row = {"drop": theirs.run.drop, "PySPH": _named(theirs), "PySPH's error": theirs.error}
        limit = row["it holds"] = held(theirs, measured)
        every = _ours(theirs.run.drop, measured)
        good = [each for each in every if held(each, measured) <= limit]
        if not good:
            rows.append(row | {"taichi-slm": "none that was run"})
            continue
        own = min(good, key=Measured.seconds)
        kind = [each for each in every if each.run.settings == own.run.settings]
        coarser = kind[kind.index(own) - 1] if own is not kind[0] else None
        rows.append(row | {
            "taichi-slm": _named(own), "its error": own.error,
            "error of the next coarser": coarser.error if coarser else "none was run",
            "PySPH, seconds": theirs.seconds(), "taichi-slm, seconds": own.seconds(),
            "time to an equal or smaller error": _over(theirs, own),
        })  # fmt: skip
    return rows


def held(each: Measured, measured: Sequence[Measured]) -> float:
    """The largest error of a run and of the finer ones of its kind: a coarse run may be near by chance."""
    run = each.run
    kind = (run.code, run.drop, run.settings)
    return max(
        other.error
        for other in measured
        if (other.run.code, other.run.drop, other.run.settings) == kind and other.run.level >= run.level
    )


def _named(each: Measured) -> str:
    return f"{each.run.settings}, {RESOLUTION[each.run.drop]} {each.run.level}"


def _ratio(of: float, to: float) -> float:
    return of / to if to else float("inf")


def _plot(findings: Findings, drop: str, title: str, measured: Sequence[Measured]) -> None:
    curves: dict[str, list[Measured]] = {}
    for each in measured:
        if not each.failure:
            curves.setdefault(f"{each.run.code}, {each.run.settings}", []).append(each)
    findings.plot(f"peers_{drop}", title, "seconds", "relative error", [
        Curve(label, [each.seconds() for each in own], [each.error for each in own],
              "points" if len(own) == 1 else "line" if label.startswith(OURS) else "dashed")
        for label, own in curves.items()
    ])  # fmt: skip
