"""`taichi-slm stress`: the search finds a known edge, the criterion an explosion; edges are where they must be."""

import math
from dataclasses import asdict

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from taichi_slm.benchmark.measure import in_its_own_process
from taichi_slm.benchmark.report import Findings
from taichi_slm.cli import app
from taichi_slm.config.shipped import scene_names
from taichi_slm.errors import BlowUpError
from taichi_slm.run.simulation import Simulation
from taichi_slm.solver.timestep import StepLimits
from taichi_slm.stress import edges, endurance, margins, stress
from taichi_slm.stress.page import write_page
from taichi_slm.stress.processes import side_by_side
from taichi_slm.stress.scenes import SCENES, Setting, stepped, with_numerics
from taichi_slm.stress.search import largest_stable
from taichi_slm.stress.watch import INSTANTS, Seen, fault, watch
from taichi_slm.verification.cases import heat_decay
from taichi_slm.verification.scenes import HEAT_ONLY, configure


@pytest.mark.parametrize("edge", [0.2, 0.99, 1.0, 1.7, 5.3])
@pytest.mark.parametrize("first", [0.125, 1.0])
def test_the_search_brackets_a_known_edge(edge, first):
    tried = []

    def stable(multiple):
        tried.append(multiple)
        return multiple <= edge

    found = largest_stable(stable, first, bisections=4)
    assert found.stable <= edge < found.unstable
    assert found.width == pytest.approx(2 ** (1 / 16) - 1)
    assert found.runs == len(tried) == len(set(tried))


def test_an_edge_out_of_bounds_is_an_open_side():
    assert largest_stable(lambda _: False, 1.0, 0.25).stable is None
    assert largest_stable(lambda _: False, 1.0, 0.25).unstable == 0.25
    always = largest_stable(lambda _: True, 1.0, highest=8.0)
    assert (always.stable, always.unstable, always.width) == (8.0, None, math.inf)


def still(**changes):
    """A run of the kinetic energy 1 J that did nothing else."""
    return Seen(**{"kinetic": [1.0] * INSTANTS, "fastest": 1.0, "hottest": 2000.0, "coldest": 300.0, "mobile": 100,
                   **changes})  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"kinetic": [2.9] * INSTANTS, "fastest": 2.9, "hottest": 2400.0, "removed": 3}, ""),
        ({"kinetic": [1.0] * 39 + [3.1]}, "kinetic energy 3.1 times"),
        ({"kinetic": [1.0, math.nan]}, "kinetic energy nan times"),
        ({"fastest": 3.1}, "speed 3.1 times"),
        ({"hottest": 2500.0}, "temperatures from 300 to 2500 K"),
        ({"coldest": -200.0}, "temperatures from -200"),
        ({"removed": 4}, "4 particles removed"),
        ({"mass_error": 1e-5}, "mass error"),
        ({"energy_error": 0.02}, "energy error"),
    ],
)
def test_the_criterion(changes, says):
    found = fault(still(**changes), still(), 10.0)
    assert found.startswith(says)
    assert bool(found) == bool(says)


def test_the_criterion_looks_at_each_quarter_but_not_at_stillness():
    """What has come to rest may not start to move again, unless it is too little to matter."""
    reference = still(kinetic=[1.0] * 10 + [1e-9] * 30)
    assert fault(still(kinetic=[1.0] * 10 + [1e-9] * 29 + [0.009]), reference, 10.0) == ""
    assert "kinetic energy" in fault(still(kinetic=[1.0] * 10 + [1e-9] * 29 + [0.011]), reference, 10.0)
    assert fault(still(kinetic=[1.0] * 10 + [1e-9] * 29 + [0.011]), reference, 10.0, still=0.02) == ""
    assert fault(still(fastest=0.009), still(fastest=0.001), 10.0) == ""


def test_the_edge_of_euler_heat_is_that_of_the_theory():
    """0.325 in 2-D at h/dx 1.2 (docs/theory.md): beyond it 200 steps of Euler widen a random field of a square."""
    config = configure(
        spacing=heat_decay.LENGTH / 16, materials={"metal": heat_decay.solid(heat_decay.K)}, physics=HEAT_ONLY,
        bodies=[{"shape": "box", "corner": [0, 0], "size": [heat_decay.LENGTH] * 2, "material": "metal"}],
        performance={"skip_cold": False}, numerics={"heat_scheme": "euler"},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    field = 800.0 + np.random.default_rng(1).uniform(-50.0, 50.0, sim.scene.count)

    def stable(multiple):
        sim.impose(field)
        sim.limits = StepLimits(with_numerics(config, {"heat_factor": 0.2 * multiple}), sim.host_tables)
        try:
            for _ in range(200):
                sim.step()
        except BlowUpError:
            return False
        return float(np.abs(sim.temperature - 800.0).max()) < 50.0

    found = largest_stable(stable, 1.4, 1.0, 3.0, bisections=3)
    assert found.width < 0.1
    assert 0.2 * found.stable <= 0.325 <= 0.2 * found.unstable


def test_the_default_step_is_stable_and_the_printed_integrator_at_it_is_not():
    drop = SCENES["drop"]
    config = drop.build(Setting())
    short = config.model_copy(update={"time": config.time.model_copy(update={"end": config.time.end / 3})})
    reference = watch(stepped(short, Setting(), "sound", 1.0), drop.start)
    assert reference.failure == ""
    assert reference.share == pytest.approx(1.0)
    assert len(reference.kinetic) == INSTANTS
    assert fault(reference, reference, 50.0) == ""
    printed = Setting(numerics={"integrator": "leapfrog_printed"})
    found = watch(stepped(short, printed, "sound", 1.0), drop.start, reference=reference)
    assert found.failure
    assert found.share < 1.0


def test_one_limit_rules_and_the_others_are_lifted():
    setting = Setting(c0=2.0, viscosity=3.0, spacing=1.5)
    base = SCENES["drop"].build(setting)
    plain = SCENES["drop"].build(Setting())
    assert base.spacing == pytest.approx(1.5 * plain.spacing)
    assert base.numerics.sound_speed == 2.0 * plain.numerics.sound_speed
    assert base.materials["steel"].viscosity.liquid.constant == pytest.approx(
        3.0 * plain.materials["steel"].viscosity.liquid.constant
    )
    numerics = stepped(base, setting, "sound", 2.0).numerics
    assert numerics.courant == pytest.approx(0.8)
    assert min(numerics.viscous_factor, numerics.capillary_factor) > 1e6
    everything = stepped(base, setting, "all", 2.0).numerics
    assert (everything.courant, everything.viscous_factor) == pytest.approx((0.8, 0.16))
    heat = stepped(SCENES["track"].build(Setting()), Setting(), "heat", 1.5)
    assert not heat.physics.flow
    assert heat.numerics.heat_factor == pytest.approx(0.3)
    printed = stepped(base, Setting(printed=True), "sound", 0.125)
    assert printed.numerics.integrator == "leapfrog_printed"
    assert printed.numerics.courant == pytest.approx(0.05)
    assert not printed.performance.skip_solid


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_the_scenes_can_be_built(name, factor):
    config = SCENES[name].build(Setting(viscosity=factor))
    assert config.bodies
    for found in (edges.plan(each, quick) for each in edges.SUBJECTS for quick in (True, False)):
        assert all(Setting(**each["setting"]) for each in found.values())


def test_every_shipped_scene_has_a_shortened_one():
    assert set(scene_names()) == set(margins.UNTIL)
    assert set(margins.QUICK) < set(margins.UNTIL)
    for name in margins.QUICK:
        assert margins.scene(name).time.end == margins.UNTIL[name]


def test_a_process_that_fails_is_a_sentence():
    arguments = {
        "scene": "neither",
        "limit": "sound",
        "setting": asdict(Setting()),
        "bisections": 1,
        "first": 1.0,
    }
    assert "neither" in in_its_own_process("stress.edges:edge", **arguments)["failure"]


@pytest.mark.slow
def test_the_edge_of_the_drop():
    """Sound in a drop: Verlet holds more than twice the default step, and not eight times (docs/stability.md)."""
    lines = []
    plan = {
        name: job for name, job in edges.plan("drop", quick=True).items() if name == "drop, sound, default"
    }
    (found,) = side_by_side("stress.edges:edge", plan, 1, lines.append).values()
    assert 2.0 <= found["stable"] < found["unstable"] <= 4.0
    assert len(lines) == found["runs"]
    assert edges.row("drop, sound, default", found)["as a factor"] == pytest.approx(0.4 * found["stable"])


def test_files_and_page(tmp_path, monkeypatch):
    """stress.json, a CSV file, and a page that has every number; subjects of an earlier run stay."""

    def compute(findings: Findings, quick, jobs, tell):
        tell("drop: 1 x: stable")
        findings.table("some", "Some rows", [{"a": 1.5, "b": "x|y"}, {"a": None}])

    for name in ("drift", "margins"):
        monkeypatch.setattr(f"taichi_slm.stress.{name}.compute", compute)
    quiet = Console(quiet=True)
    stress.stress(["margins"], tmp_path, True, 1, quiet)
    report = stress.stress(["drift"], tmp_path, True, 1, quiet)
    assert list(report["subjects"]) == ["drift", "margins"]
    assert (tmp_path / "some.csv").read_text(encoding="utf-8") == "a,b\n1.5,x|y\n,\n"
    write_page(report, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert page.count("| 1.5 | x\\|y |") == 2
    assert "A quick look" in page


def test_a_wrong_subject_is_named():
    result = CliRunner().invoke(app, ["stress", "colum"])
    assert result.exit_code != 0
    assert "did you mean 'column'" in str(result.exception)
    assert result.exception.exit_code == 2


@pytest.mark.slow
def test_memory_files_and_step_time_of_a_long_run_stay_flat():
    """60,000 steps here; a million, with the same function, in docs/stability.md (`taichi-slm stress endurance`)."""
    found = endurance.flatness(endurance.watch(60_000, lambda _: None))
    assert found["steps"] >= 60_000
    # Python's own heap breathes by a megabyte or two; a leak of a float a step would be half of that
    assert found["growth of memory [bytes]"] < 4e6
    assert found["growth of open files"] <= 0
    assert found["last quarter over second"] < 2.0  # other work may slow a shared machine for a while
