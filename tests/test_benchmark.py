"""`taichi-slm bench`: what is measured has the right shape, C++ and Taichi agree, skips change what they may."""

import csv
import math
import os
import shutil
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from taichi_slm.benchmark import accuracy, bench, peer, reach, skips, speed
from taichi_slm.benchmark.goals import GOALS, TOGETHER, UNFUSED, asked_and_reached
from taichi_slm.benchmark.measure import a_core_each, in_its_own_process, in_turn, ratio
from taichi_slm.benchmark.paper import NO_SKIPS, PAPER_FORMS, PAPER_STEPS
from taichi_slm.benchmark.passes import Pass, Watch
from taichi_slm.benchmark.report import Findings, write_page
from taichi_slm.benchmark.scenes import drop, track, warm
from taichi_slm.cli import app
from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Performance
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Curve

ROOT = Path(__file__).parents[1]


def test_ratios_are_those_of_one_turn():
    """A machine that slows down in the middle changes both numbers of a turn, and no ratio."""
    assert ratio([1.0, 3.0, 30.0], [2.0, 6.0, 60.0]) == 0.5
    calls = []
    seconds = in_turn({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, rounds=2, repeats=2)
    assert "".join(calls) == "aabb" * 3  # once to warm up
    assert all(len(each) == 2 and min(each) > 0 for each in seconds.values())


def test_the_papers_settings_are_those_of_its_config():
    text = (ROOT / "configs" / "track_150W.yaml").read_text(encoding="utf-8")
    assert "extends" not in text
    plain = load_config(ROOT / "configs" / "track_150W.yaml").config
    printed = accuracy.changed(plain, 1.0, "printed")
    import ruamel.yaml

    paper = ruamel.yaml.YAML(typ="safe").load(ROOT / "configs" / "paper.yaml")
    assert paper["numerics"] == PAPER_FORMS
    assert paper["performance"] == NO_SKIPS
    assert printed.numerics.integrator == "leapfrog_printed"
    assert set(PAPER_STEPS) <= set(PAPER_FORMS)


def test_every_switch_of_performance_is_in_the_ablation():
    switches = {name for name, key in Performance.model_fields.items() if key.annotation is bool}
    assert set(NO_SKIPS) == switches


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
@pytest.mark.parametrize(
    ("precision", "limit"), [("f64", 1e-12), pytest.param("f32", 1e-4, marks=pytest.mark.slow)]
)
def test_cpp_computes_the_same_numbers(precision, limit):
    *found, together, unfused = speed.beside_cpp(precision, quick=True)["rows"]
    assert [row["pass"] for row in found] == ["momentum", "continuity", "colour", "forces", "conduction"]
    for row in found:
        assert row["largest difference"] < limit, row
        assert row["over c++"] > 0
        assert 0 < row["of it to launch"] < row["ns per row"]
        assert 10 < row["neighbours"] < 40
    assert 0.0 < unfused["largest difference"] < limit  # sums of their own: none of them is the fused one's
    assert unfused["c++, ns per row"] > together["c++, ns per row"]  # nine loops for the sums of five


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_all_passes_together_take_the_sum_of_their_times(monkeypatch):
    """On a clock of our own: a pass takes 1, 2, 3, 4, 5 ms in turns of two kinds, its version in C++ 1 ms."""
    passes = iter((1e-3, 2e-3, 3e-3, 4e-3, 5e-3))

    def in_turn(jobs, *_):
        took = next(passes)
        return {
            "kernel": [took, 2 * took],
            "launch": [1e-6, 1e-6],
            "c++": [1e-3, 2e-3],
            "limit": [1e-4, 2e-4],
        }

    monkeypatch.setattr(speed, "in_turn", in_turn)
    monkeypatch.setattr(speed, "_beside_unfused", lambda *_: {})
    *found, together, _ = speed.beside_cpp("f64", quick=True)["rows"]
    assert [row["over c++"] for row in found] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])
    assert together["over c++"] == pytest.approx(3.0)
    assert together["ns per row"] == pytest.approx(3.0 * together["c++, ns per row"])


def test_the_watch_sees_every_pass_and_leaves_no_trace():
    sim = Simulation(drop(10), threads=1)
    warm(sim)

    def passes():
        """All that the flow is made of, but for the numbers that every kick finds anew."""
        return {
            name: value
            for name, value in vars(sim.flow_step.flow).items()
            if name not in ("moved", "fastest", "dt")
        }

    watch, before = Watch(sim), passes()
    sim.step()
    assert not watch.passes
    steps = sim.steps
    with watch.watching():
        sim.step()
    assert passes() == before
    momentum = watch.passes["flow: momentum"]
    assert len(momentum.seconds) == sim.steps - steps
    assert set(momentum.rows) == {sim.rows.mobile}
    assert {"surface: colour", "heat: rates", "flow: continuity"} <= set(watch.passes)


def test_the_shares_of_a_step_add_up_and_a_stall_is_nobodys():
    """Blocks of two steps; in one of them the machine stood still for a second during a pass."""

    def block(stall):
        launches = [Pass([1e-3, 1e-3 + stall], [100, 100]), Pass([5e-4], None)]
        return speed.Block(
            3e-3 + stall, 2, 500, 100, dict(zip(("flow: a", "lists: b"), launches, strict=True))
        )

    rows = {row["pass"]: row for row in speed.shares([block(0.0) for _ in range(99)] + [block(1.0)], 500.0)}
    assert sum(row["share of the time"] for row in rows.values()) == pytest.approx(1.0)
    assert rows["flow: a"]["share of the time"] == pytest.approx(2 / 3, rel=0.02)
    assert rows["flow: a"]["ns per row"] == pytest.approx(1e4)
    assert "rows" not in rows["lists: b"]
    assert rows["Python and launches"]["ns per active particle and flow step"] == pytest.approx(500.0)


def test_the_limit_is_what_is_left_of_the_steps():
    """10 s, of which 6 in a pass twice as slow as C++, 3 in one without a twin, 1 in Python; half of the cores idle."""
    names = ("flow: momentum", "lists: search", "Python and launches")
    passes = [
        {"pass": name, "share of the time": share} for name, share in zip(names, (0.6, 0.3, 0.1), strict=True)
    ]
    cores = reach.machine()["cores"]
    profile = {"seconds": 10.0, "busy": 0.5 * cores, "passes": passes}
    left = reach.limit(profile, {"momentum": 2.0}, around=4.0)
    assert left["without Python and launches, s"] == pytest.approx(9.0)
    assert left["and five passes no slower than plain C++, s"] == pytest.approx(6.0)
    assert left["and all cores busy, s"] == pytest.approx(3.0)
    assert left["the run then, s"] == pytest.approx(7.0)
    faster = reach.limit(profile, {"momentum": 0.5}, around=0.0)  # than C++: that is no limit
    assert faster["and five passes no slower than plain C++, s"] == pytest.approx(9.0)


def test_a_scene_that_is_refused_stands_in_the_table_with_its_reason():
    """And the others are measured."""
    row = reach._run(reach.WholeScene("track_150W", ("laser.power=-1",)))
    assert "laser.power" in row["failure"]


def test_skips_change_what_they_may():
    """Skips that leave out what adds nothing, on a short track: to round-off; all off: to what a flow scatters."""

    def melt(**switches):
        config = track(2, duration=8e-6, spacing=6e-6, performance=switches)
        sim = Simulation(config, threads=1)
        sim.run()
        arrays = sim.arrays(("id", "position", "temperature", "ever_liquid"))
        return {"rise": sim.hottest - 293.0, "spacing": config.spacing, "length": 0.0, "depth": 0.0, **arrays}

    reference = melt()
    assert reference["ever_liquid"].any()
    exact = ("skip_solid", "skip_cold", "skip_interior", "skip_dark")
    assert skips.within("these off", skips.difference(melt(**dict.fromkeys(exact, False)), reference))
    assert skips.within("all off", skips.difference(melt(**NO_SKIPS), reference))


def test_a_point_of_a_curve_is_a_run_of_the_case():
    default = accuracy.point("neumann", 8, alone=True)
    shorter = accuracy.point("neumann", 8, step=0.5, alone=True)
    assert default["error"] < 0.01
    assert default["seconds"] > 0
    assert shorter["steps"] > 1.3 * default["steps"]


def test_an_error_is_that_of_several_runs():
    """The root mean square over the levels that stand for one; the rest is of that one itself."""
    of_each = {level: accuracy.point("neumann", level, alone=True) for level in (6, 7, 8, 9, 10)}
    found = accuracy.point("neumann", 8)
    errors = [run["error"] for run in of_each.values()]
    assert found["error"] == pytest.approx(math.hypot(*errors) / math.sqrt(5), rel=1e-9)
    assert (found["steps"], found["runs"]) == (of_each[8]["steps"], 5)
    assert accuracy.CASES["spot_weld"].near(50e-6)[0] == 50e-6


@pytest.mark.parametrize(
    ("mine", "theirs", "known_to", "dominated_by"),
    [
        ([0.2], [0.15], 0.0, 0.2 / 0.15),
        ([0.2], [0.15], 0.06, 1.0),  # the answer is not known as well as that
        ([0.20, 0.21, 0.19, 0.2, 0.2], [0.15, 0.16, 0.14, 0.15, 0.15], 0.0, 0.2001 / 0.1501),
        ([0.03, 0.03, 0.03, 0.03, 0.04], [0.03, 0.03, 0.03, 0.03, 0.02], 0.0, 1.0),  # one lattice of five
        ([0.03, 0.03, 0.03, 0.03, 0.03], [0.03, 0.03, 0.03, 0.03, 0.02], 0.0, 1.0),
    ],
)
def test_settings_are_dominated_by_others_that_are_faster_and_certainly_nearer(
    mine, theirs, known_to, dominated_by
):
    rows = [
        {"settings": "f64", "seconds": 2.0, "errors": mine},
        {"settings": "step x 1.5", "seconds": 1.0, "errors": theirs},
    ]
    for row in rows:
        row |= {"resolution": "8", "error": sum(error**2 for error in row["errors"]) ** 0.5}
    accuracy.add_front(rows, known_to)
    assert rows[0]["dominated by"] == pytest.approx(dominated_by, rel=1e-3)
    assert rows[0]["by bare numbers"] > 1.05


def test_settings_are_dominated_by_others_at_their_resolution():
    rows = [
        {"settings": "f64", "resolution": "8", "seconds": 2.0, "error": 0.2, "errors": [0.2]},
        {"settings": "f32", "resolution": "8", "seconds": 1.0, "error": 0.15, "errors": [0.15]},
        {"settings": "f64", "resolution": "14", "seconds": 9.0, "error": 0.3, "errors": [0.3]},
        {"settings": "step x 1.5", "resolution": "14", "seconds": 6.0, "error": 0.4, "errors": [0.4]},
        {"settings": "paper's forms", "resolution": "14", "failure": "blew up"},
    ]
    accuracy.add_front(rows)
    assert rows[0]["dominated by"] == pytest.approx(0.2 / 0.15)
    assert rows[2]["dominated by"] == pytest.approx(0.3 / 0.4)
    title = "Static drop: Laplace jump"
    table = {"name": "accuracy_static_drop", "title": title, "columns": ["settings", "resolution", "dominated by"],
             "rows": [["f64", "8", 1.04], ["f64", "14", 1.2], ["f32", "8", None]]}  # fmt: skip
    (goal,) = asked_and_reached({"subjects": {"accuracy": {"tables": [table]}}})
    assert (goal["asked"], goal["reached"], goal["kept"]) == ("at most 1.05", 1.2, f'no: see "{title}"')


def test_a_process_that_fails_is_a_sentence():
    assert "neither" in in_its_own_process("benchmark.accuracy:point", case="neither", level=1)["failure"]


def test_a_process_that_does_not_end_is_stopped():
    found = in_its_own_process("benchmark.accuracy:point", case="static_drop", level=40, ends_within=0.01)
    assert found == {"failure": "stopped after 0 s"}


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system binds nothing to a core")
def test_tasks_beside_each_other_have_a_core_each():
    """And so do the processes that they start; all end, in their order, also if there are more than cores."""
    cores = os.sched_getaffinity(0)
    together = threading.Barrier(len(cores), timeout=60.0)
    seen = []

    def task(number):
        if number < len(cores):
            together.wait()  # or there are not as many at a time as there are cores
        told = subprocess.run(
            [sys.executable, "-c", "import os; print(*os.sched_getaffinity(0))"],
            capture_output=True,
            text=True,
            check=True,
        )
        seen.append((number, told.stdout.split()))
        return number

    numbers = range(2 * len(cores))
    found = a_core_each({str(number): partial(task, number) for number in numbers})
    assert list(found.values()) == list(numbers)
    assert all(len(own) == 1 for _, own in seen)
    assert {int(own[0]) for number, own in seen if number < len(cores)} == cores
    assert os.sched_getaffinity(0) == cores


def test_files_and_page(tmp_path, monkeypatch):
    """bench.json, a CSV file and a plot, and a page that has every number; subjects of an earlier run stay."""

    def compute(findings: Findings, quick, yardstick):
        findings.table(
            "some", "Some rows", [{"a": 1.5, "b": "x|y"}, {"a": None, "c": float("nan")}], "A note."
        )
        findings.plot(
            "some", "A plot", "x", "y", [Curve("one", [1.0, 2.0], [3.0, 4.0]), Curve("none", [], [])]
        )

    for name in ("skips", "speed"):
        monkeypatch.setattr(f"taichi_slm.benchmark.{name}.compute", compute)
    quiet = Console(quiet=True)
    bench.bench(["speed"], tmp_path, True, quiet)
    report = bench.bench(["skips"], tmp_path, True, quiet)
    assert list(report["subjects"]) == ["speed", "skips"]
    subject = report["subjects"]["skips"]
    assert {"title", "about", "quick", "seconds", "drift", "machine", "tables", "plots"} <= set(subject)
    assert subject["drift"] >= 1.0
    with open(tmp_path / "some.csv", newline="", encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["a", "b", "c"], ["1.5", "x|y", ""], ["", "", "nan"]]
    assert (tmp_path / "plots" / "some.png").stat().st_size > 1000
    write_page(report, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "| 1.5 | x\\|y |  |" in page
    assert page.count("images/performance/some.png") == 2


def _report(**tables):
    made = [{"name": name, "columns": list(rows[0]), "rows": [list(row.values()) for row in rows]}
            for name, rows in tables.items()]  # fmt: skip
    return {"subjects": {"one": {"tables": made}}}


def test_a_goal_is_judged_by_the_worst_of_its_numbers():
    """At most: the largest; at least: the smallest; rows of others, without a number or left out do not count."""
    cpp = [
        {"compiler": "taichi", "precision": "f64", "pass": "momentum", "over c++": 1.5},
        {"compiler": "taichi", "precision": "f64", "pass": "colour", "over c++": 2.5},
        {"compiler": "taichi", "precision": "f64", "pass": TOGETHER, "over c++": 3.5},
        {"compiler": "taichi", "precision": "f64", "pass": UNFUSED, "over c++": 1.25},
        {"compiler": "taichi", "precision": "f32", "pass": "colour", "over c++": 9.0},
    ]
    peers = [
        {"drop": "square", "time of a step": 30.0},
        {"drop": "square", "time of a step": 12.0},
        {"drop": "elliptic", "time of a step": None},
    ]
    scenes = [
        {"scene": "a", "asked, s": 20.0, "wall, s": 10.0},
        {"scene": "b", "asked, s": None, "wall, s": 5.0},
    ]
    rows = asked_and_reached(_report(speed_cpp=cpp, peers_steps=peers, reach_runs=scenes))
    assert [(row["asked"], row["reached"], row["kept"]) for row in rows] == [
        ("at most 20", 10.0, "yes"),
        ("at most 2", 2.5, 'no: see "The passes and plain C++ on the same lists, one thread"'),
        ("at most 1.4", 1.25, "yes"),
        ("at least 10", 12.0, "yes"),
    ]


def test_the_limit_of_the_machine_stands_beside_what_was_reached():
    """The worst of its numbers, as of what was reached; none where none was found."""
    steps = [
        {"drop": "elliptic", "time of a step": 8.0, "limit of a step": 9.0},
        {"drop": "elliptic", "time of a step": 11.0, "limit of a step": 12.0},
        {"drop": "elliptic", "time of a step": 15.0, "limit of a step": None},
        {"drop": "square", "time of a step": 60.0, "limit of a step": None},
    ]
    rows = asked_and_reached(_report(peers_steps=steps))
    assert [(row["reached"], row["limit of this machine"]) for row in rows] == [(60.0, None), (8.0, 9.0)]


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_the_arithmetic_of_a_core_is_faster_than_any_pass():
    """Whole vectors of multiply-adds: between 1e9 and 1e12 operations a second, and less time than the pass in C++."""
    adds = peer.multiply_adds("f64")
    (seconds,) = in_turn({"adds": adds}, 1)["adds"]
    assert 1e9 < adds() / seconds < 1e12
    for row in speed.beside_cpp("f64", quick=True)["rows"]:
        assert 0.0 < row["limit over c++"] < 1.0, row


def test_the_page_has_a_number_for_every_goal():
    """So that no goal reads a table or a column that is called otherwise by now, or points to one."""
    page = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    for goal in GOALS:
        assert f"| {goal.what} | {goal.bound} {goal.asked:g} | " in page
        assert f"\n### {goal.see}\n" in page


def test_a_wrong_subject_is_named():
    result = CliRunner().invoke(app, ["bench", "sped"])
    assert result.exit_code != 0
    assert "did you mean 'speed'" in str(result.exception)
