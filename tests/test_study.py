"""Studies: axes and their checks, processes that fail, stop, die and go on."""

import contextlib
import csv
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import study_program
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from taichi_slm.cli import main
from taichi_slm.errors import BlowUpError, ConfigError, StorageError
from taichi_slm.output.history import read_history
from taichi_slm.study import execute
from taichi_slm.study.conduct import conduct
from taichi_slm.study.execute import standing
from taichi_slm.study.folder import StudyFolder
from taichi_slm.study.plan import load_plan

ROOT = Path(__file__).parents[1]
SCENE = """\
title: comet
dimension: 2
spacing: 20 um
seed: 7
bodies:
  - {shape: plate, length: 0.2 mm, depth: 0.1 mm}
  - {shape: powder_row, length: 0.2 mm, radius: 25 um}
laser:
  power: 100
  beam_radius: 54 um
  path: [{kind: line, start: [0], end: [0.2 mm], speed: 2.0}]
time: {end: 1e-4}
output: {images: [], history_interval: 1e-5, snapshot_interval: 1e-4, checkpoint_interval: 1e-5}
"""
GRID = "{kind: grid, values: {laser.power: [50 W, 0.1 kW]}}"


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Write a study of the axes (YAML lines) and load it, in an empty folder with the scene."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STUDY_ONCE", str(tmp_path / "killed"))
    Path("comet.yaml").write_text(SCENE)

    def plan(*axes, more=""):
        lines = "".join(f"  - {axis}\n" for axis in axes)
        Path("study.yaml").write_text(f"scene: comet.yaml\naxes:\n{lines}{more}")
        return load_plan(Path("study.yaml"))

    return plan


@pytest.fixture
def console(tmp_path):
    with open(tmp_path / "said.txt", "w") as file:
        yield Console(file=file)


def changes(plan):
    return [tuple(run.changes.values()) for run in plan.runs]


def starts(name, folder="studies/study"):
    """How often the run ``name`` was begun or taken up again."""
    return StudyFolder(Path(folder)).log(name).read_text().count("compiled in")


def table(folder="studies/study"):
    with open(Path(folder) / "table.csv", newline="") as file:
        return list(csv.DictReader(file))


# --------------------------------------------------------------------------- axes


def test_grid_is_every_value_with_every_other_in_SI(study):
    plan = study("{kind: grid, values: {laser.power: [50 W, 0.1 kW], laser.beam_radius: [20 um, 30e-6]}}")
    assert changes(plan) == [(50.0, 2e-5), (50.0, 3e-5), (100.0, 2e-5), (100.0, 3e-5)]
    assert plan.keys == ["laser.power", "laser.beam_radius"]
    assert [run.number for run in plan.runs] == [1, 2, 3, 4]
    assert plan.runs[0].name.startswith("power=50_beam_radius=2e-05-")


def test_zip_goes_in_step_and_axes_multiply(study):
    plan = study(
        "{kind: zip, values: {laser.power: [50, 60], laser.beam_radius: [20 um, 30 um]}}",
        "{kind: list, points: [{laser.path.0.speed: 1}, {laser.path.0.speed: 2 m/s, spacing: 10 um}]}",
    )
    assert changes(plan) == [
        (50, 2e-5, 1, 2e-5),
        (50, 2e-5, 2, 1e-5),
        (60, 3e-5, 1, 2e-5),
        (60, 3e-5, 2, 1e-5),
    ]


def test_latin_hypercube_has_one_point_in_each_tenth_of_each_range(study):
    ranges = "{laser.power: [50 W, 150 W], laser.beam_radius: [20 um, 40 um]}"
    first = changes(study(f"{{kind: latin_hypercube, count: 10, ranges: {ranges}}}"))
    power, radius = np.array(first).T
    assert sorted(np.floor((power - 50) / 10)) == list(range(10))
    assert sorted(np.floor((radius - 20e-6) / 2e-6)) == list(range(10))
    assert changes(study(f"{{kind: latin_hypercube, count: 10, ranges: {ranges}}}")) == first
    assert changes(study(f"{{kind: latin_hypercube, count: 10, seed: 1, ranges: {ranges}}}")) != first


def test_csv(study):
    Path("points.csv").write_text("laser.power, spacing\n50, 20 um\n\n60 W,\n")
    assert changes(study("{kind: csv, file: points.csv}")) == [(50.0, 2e-5), (60.0, 2e-5)]


def test_repeats_are_seeds_and_a_run_is_known_by_its_scene(study):
    plan = study(GRID, more="repeats: 3\n")
    assert [run.seed for run in plan.runs] == [7, 8, 9, 7, 8, 9]
    again = study("{kind: grid, values: {laser.power: [100, 70]}}", more="seeds: [9, 11]\n")
    shared = {run.name for run in plan.runs} & {run.name for run in again.runs}
    assert shared == {plan.runs[5].name}  # 100 W and seed 9
    assert "seed: 9\n" in plan.runs[5].scene
    assert [run.seed for run in study(GRID, more="repeats: 2\nset: {seed: 20}\n").runs] == [20, 21, 20, 21]


def test_a_key_that_a_run_leaves_alone_has_the_value_of_the_scene(study):
    plan = study("{kind: list, points: [{laser.power: 50}, {laser.power: 60, laser.path.0.speed: 3 m/s}]}")
    assert changes(plan) == [(50.0, 2.0), (60.0, 3.0)]
    assert plan.units == {"laser.power": "W", "laser.path.0.speed": "m/s"}
    assert [run.name.rpartition("-")[0] for run in plan.runs] == ["power=50", "power=60_speed=3"]


def test_seeds_that_draw_nothing_are_warned_of(study):
    """A row of powder is the same for every seed, a bed is not."""
    seeds = "seeds: [1, 2]\n"
    assert "runs that differ in their seed alone will be equal" in study(GRID, more=seeds).warnings[-1]
    assert not any("equal" in said for said in study(GRID).warnings)
    bed = "{shape: powder_bed, length: 0.2 mm, height: 50 um, mean_radius: 15 um, std_radius: 2 um}"
    Path("comet.yaml").write_text(SCENE.replace("{shape: powder_row, length: 0.2 mm, radius: 25 um}", bed))
    assert not any("equal" in said for said in study(GRID, more=seeds).warnings)


# --------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("axis", "more", "sentence"),
    [
        ("{kind: grid, values: {laser.powr: [1]}}", "", "yaml:3: laser.powr: unknown key. Did you mean 'power'?"),
        ("{kind: grid, values: {laser.power: [50, -5]}}", "", "yaml:3: laser.power: must be at least 0; '-5' is"),
        ("{kind: grid, values: {laser.power: [50, 5 m]}}", "", "which cannot be turned into W. (run 2"),
        ("{kind: gird, values: {}}", "", "study.yaml:3: axes.0.kind: 'gird' is not one of grid, zip, list"),
        ("{kind: grid, value: {laser.power: [1]}}", "", "axes.0.value: unknown key of 'grid'. Did you mean 'values'?"),
        ("{kind: grid, values: {laser.power: 5}}", "", "axes.0.values.laser.power: expected a list; '5' is"),
        ("{kind: grid, values: {laser.power: []}}", "", "expected at least 1 entries; 0 given"),
        ("{kind: zip, values: {laser.power: [1, 2], spacing: [1]}}", "", "laser.power has 2, spacing has 1"),
        ("{kind: latin_hypercube, count: 2, ranges: {laser.power: [9, 1]}}", "", "must rise: 9 is not below 1"),
        ("{kind: latin_hypercube, count: 2, ranges: {laser.power: [1 W, 2 kW]}}", "", "the same unit; 'W' and 'kW'"),
        ("{kind: latin_hypercube, count: 2, ranges: {laser.power: [a, b]}}", "", "expected two numbers"),
        ("{kind: csv, file: none.csv}", "", "there is no such file"),
        (GRID, "repeat: 2", "study.yaml:4: repeat: unknown key. Did you mean 'repeats'?"),
        (GRID, "repeats: 0", "repeats: must be at least 1; '0' is given"),
        (GRID, "set: {laser.power: 3}\nseeds: [1, 1]", "run 2 is the same scene as run 1"),
        (GRID, "overview: {x: spacing}", "study.yaml:4: overview.x: 'spacing' is not a key of the axes: laser.power"),
        (GRID, "seeds: [1]\nrepeats: 2\ntitle: [", "is not closed"),
        ("{kind: grid, values: {laser: [null], laser.power: [1]}}", "", "laser.power: this key is changed at"),
        ("{kind: grid, values: {title=x.y: [1]}}", "", "'title=x.y' is not the path of a key, as laser.power is"),
        ("{kind: grid, values: {seed: [1]}}", "repeats: 2", "this key is changed at study.yaml:3 already"),
        ("{kind: latin_hypercube, count: 20000, ranges: {laser.power: [1, 2]}}", "", "ask for 20,000 runs"),
        ("{kind: grid, values: {spacing: [20 um, 1 m]}}", "", "(run 2 of 2)"),
    ],
)  # fmt: skip
def test_a_wrong_study_is_refused_with_file_line_and_key(study, axis, more, sentence):
    with pytest.raises(ConfigError) as caught:
        study(axis, more=f"{more}\n")
    assert sentence in str(caught.value)
    assert caught.value.exit_code == 2


def test_errors_of_all_runs_are_shown_at_once_and_nothing_starts(study, monkeypatch, capsys):
    with pytest.raises(ConfigError) as caught:
        study("{kind: grid, values: {laser.power: [50, -5, -6], laser.beam_radius: [1 um, 2 s]}}")
    assert len(str(caught.value).splitlines()) == 3
    monkeypatch.setattr(sys, "argv", ["taichi-slm", "study", "study.yaml"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "Traceback" not in capsys.readouterr().err
    assert not Path("studies").exists()


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_subnormal=False)  # Taichi, in the same process, lets the processor flush them to zero
    | st.text(max_size=8)
    | st.sampled_from(["50 W", "2 um"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=2),
    max_leaves=6,
)
KEYS = st.sampled_from(
    ["laser.power", "spacing", "bodies.0", "laser", "title=x.y", " spacing", "extends", "seed", "a.b"]
)
AXES = st.fixed_dictionaries(
    {"kind": st.sampled_from(["grid", "zip", "list", "latin_hypercube", "csv", "x"])},
    optional={
        "values": st.dictionaries(KEYS, st.lists(VALUES, max_size=2) | VALUES, max_size=2),
        "points": st.lists(st.dictionaries(KEYS, VALUES, max_size=2), max_size=2),
        "ranges": st.dictionaries(KEYS, st.lists(VALUES, min_size=2, max_size=2), max_size=2),
        "count": st.integers(-1, 3),
        "file": st.text(max_size=5),
    },
)


@settings(max_examples=60, deadline=None)
@given(axes=st.lists(AXES, max_size=2) | VALUES, repeats=st.integers(0, 2) | VALUES, changed=VALUES)
def test_any_study_is_planned_or_refused_with_a_sentence(tmp_path_factory, axes, repeats, changed):
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "comet.yaml").write_text(SCENE)
    text = json.dumps({"scene": "comet.yaml", "axes": axes, "repeats": repeats, "set": {"seed": changed}})
    (folder / "study.yaml").write_text(text)
    with contextlib.suppress(ConfigError):
        assert load_plan(folder / "study.yaml").runs


@pytest.mark.parametrize(
    "text", ["", "- 1", "scene: nowhere.yaml\naxes: [{kind: csv, file: x}]", "scene: [1]", "a: b: c"]
)
def test_what_is_no_study_is_refused(study, text):
    Path("bad.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"bad\.yaml"):
        load_plan(Path("bad.yaml"))


@pytest.mark.parametrize(
    "text", ["a\n", "laser.power\n", "laser.power,laser.power\n1,2\n", "spacing\n1,2\n", 'spacing\n"1\n']
)
def test_a_damaged_table_of_points_is_refused(study, text):
    Path("points.csv").write_text(text)
    with pytest.raises(ConfigError, match=r"points.csv"):
        study("{kind: csv, file: points.csv}")


def test_another_folder_is_never_written_into(study, console):
    Path("mine").mkdir()
    Path("mine/thesis.txt").write_text("all of it")
    with pytest.raises(StorageError, match="not a study"):
        conduct(study(GRID), Path("mine"), console=console)
    assert [path.name for path in Path("mine").iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs" / "studies").glob("*.yaml")), ids=lambda path: path.stem
)
def test_shipped_studies_are_valid(path):
    plan = load_plan(path)
    assert plan.title != path.stem
    assert len({run.name for run in plan.runs}) == len(plan.runs) > 3


# --------------------------------------------------------------------------- processes


def test_failed_runs_do_not_stop_the_rest_and_only_what_is_missing_is_done(study, console):
    plan = study("{kind: grid, values: {laser.power: [50, 2 kW, 666, 90]}}", more="repeats: 1\n")
    names = [run.name for run in plan.runs]
    with pytest.raises(BlowUpError, match="2 of 4 runs failed") as caught:
        conduct(plan, jobs=2, console=console)
    assert "heat: particle 3 at 20000 K" in str(caught.value)
    assert "killed by signal 9" in str(caught.value)
    rows = table()
    assert [row["state"] for row in rows] == ["done", "failed", "failed", "done"]
    assert [float(row["laser.power"]) for row in rows] == [50, 2000, 666, 90]
    assert float(rows[3]["max_temperature_K"]) == pytest.approx(900)
    assert float(rows[0]["energy.absorbed_J"]) == pytest.approx(2e-4)
    assert Path("studies/study/overview.png").read_bytes().startswith(b"\x89PNG")

    with pytest.raises(BlowUpError, match="1 of 4 runs failed"):  # again: the killed one alone
        conduct(plan, jobs=2, console=console)
    assert [starts(name) for name in names] == [1, 1, 2, 1]
    assert "resume" in StudyFolder(Path("studies/study")).log(names[2]).read_text()
    assert [row["state"] for row in table()] == ["done", "failed", "done", "done"]

    more = study("{kind: grid, values: {laser.power: [90, 95, 50]}}")  # a study that has changed
    conduct(more, console=console)
    assert starts(more.runs[1].name) == 1
    assert [starts(name) for name in names] == [1, 1, 2, 1]
    assert [float(row["max_temperature_K"]) for row in table()] == pytest.approx([900, 950, 500])

    with pytest.raises(BlowUpError):
        conduct(plan, only=2, retry=True, console=console)
    assert starts(names[1]) == 2
    assert (Path("studies/study/set_aside") / f"{names[1]}.1" / "crash").is_dir()


def begun(*arguments, sleep=0.15):
    """A study as a process of its own, once two of its runs have a checkpoint; and where these are."""
    command = [sys.executable, study_program.__file__, "study", "study.yaml", "--jobs", "2", *arguments]
    process = subprocess.Popen(
        command, env=os.environ | {"STUDY_SLEEP": str(sleep)}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while (
        len(at_work := {path.parts[-3] for path in Path(".").glob("studies/*/runs/*/checkpoints/*.npz")}) < 2
    ):
        assert time.monotonic() < deadline, process.communicate()
        time.sleep(0.05)
    return process, at_work


def checked_as_unbroken(plan):
    """Every run is done and has each row of its history once."""
    for run in plan.runs:
        place = StudyFolder(Path("studies/study")).run(run.name)
        assert standing(place) == "done"
        assert len(np.unique(read_history(place.history)["time_s"])) == 11
        assert len(read_history(place.history)["time_s"]) == 11


def test_ctrl_c_leaves_a_study_that_goes_on(study, console):
    plan = study("{kind: grid, values: {laser.power: [50, 60, 70]}}")
    process, at_work = begun()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "the same command does the rest" in err
    states = {run.name: standing(StudyFolder(Path("studies/study")).run(run.name)) for run in plan.runs}
    assert {states[name] for name in at_work} <= {"resumable", "done"}
    assert list(states.values()).count("missing") >= 1
    conduct(plan, jobs=2, console=console)
    assert {run.name: starts(run.name) for run in plan.runs} == {
        name: 2 if state == "resumable" else 1 for name, state in states.items()
    }
    checked_as_unbroken(plan)


def test_a_killed_study_is_taken_up_without_doing_a_run_twice(study, console):
    """Its runs live on; the next study waits for them."""
    plan = study("{kind: grid, values: {laser.power: [50, 60, 70]}}")
    process, at_work = begun()
    process.kill()
    process.communicate()
    conduct(plan, jobs=3, console=console)
    assert len(at_work) == 2
    assert [starts(run.name) for run in plan.runs] == [1, 1, 1]
    checked_as_unbroken(plan)


def test_a_study_on_a_dask_cluster_loses_nothing_with_a_worker(study, console, monkeypatch):
    """A scheduler and two workers on loopback; one worker is killed while it has a run."""
    pytest.importorskip("distributed")
    plan = study("{kind: grid, values: {laser.power: [50, 60, 70]}}")
    monkeypatch.setenv("STUDY_SLEEP", "0.15")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
    dask = [sys.executable, "-m"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen(
        [*dask, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
         "--scheduler-file", "scheduler.json"], **quiet,
    )  # fmt: skip
    workers = []
    try:
        address = wait_for(lambda: json.loads(Path("scheduler.json").read_text())["address"])
        workers = [
            subprocess.Popen(
                [*dask, "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard",
                 "--preload", "study_program"], **quiet,
            )
            for _ in range(2)
        ]  # fmt: skip
        killed = []

        def kill_one(workers=workers):
            if not killed and list(Path("studies/study/runs").glob("*/checkpoints/*.npz")):
                workers[0].kill()
                killed.append(time.monotonic())

        monkeypatch.setattr("taichi_slm.study.view.View.look", lambda view: kill_one())
        conduct(plan, scheduler=address, console=console)
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()
    assert killed
    assert [starts(run.name) for run in plan.runs] == [1, 1, 1]
    checked_as_unbroken(plan)
    assert [row["state"] for row in table()] == ["done"] * 3


def wait_for(ask):
    """What ``ask`` returns once it does."""
    for _ in itertools.count():
        try:
            return ask()
        except (OSError, ValueError):
            time.sleep(0.05)


def test_a_file_STOP_is_a_wish_to_stop(study):
    plan = study(GRID)
    folder = StudyFolder.prepare(Path("studies/study"))
    stop = execute.Stop(folder.stop)
    assert not stop.wanted()
    folder.stop.touch()
    assert stop.wanted()
    job = execute.Job(folder.path.resolve(), plan.runs[0].name, 1, "cpu", "f64")
    assert execute.perform(job, execute.StopFile(folder.stop)).state == "stopped"
    assert standing(folder.run(plan.runs[0].name)) == "missing"


def test_no_scheduler_is_a_sentence(study, console, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("taichi_slm.study.cluster.CONNECT_SECONDS", 1)
    with pytest.raises(ConfigError, match="no Dask scheduler answers there"):
        conduct(study(GRID), scheduler="tcp://127.0.0.1:9", console=console)


@pytest.mark.slow
def test_a_study_with_the_true_solver(study, console, monkeypatch):
    monkeypatch.setattr(execute, "PROGRAM", (sys.executable, "-m", "taichi_slm.cli"))
    plan = study(GRID, more="set: {output.images: [state], output.images_at_most: 1, spacing: 10 um}\n")
    conduct(plan, console=console)
    low, high = (float(row["max_temperature_K"]) for row in table())
    assert 293 < low < high
    assert Path("studies/study/contact_sheet.png").is_file()
