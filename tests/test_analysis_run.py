"""`taichi-slm analyse` on run folders: what it writes, what it says, and how it ends where there is nothing to find."""

import csv
import json
import shutil
import sys

import fake_run
import numpy as np
import pytest
from fake_run import FakeSimulation, NobodyDraws
from rich.console import Console

from taichi_slm.analysis.analyse import examine
from taichi_slm.analysis.recording import along
from taichi_slm.cli import main
from taichi_slm.config.schema import Config
from taichi_slm.output.history import read_history
from taichi_slm.run import driver
from taichi_slm.run.driver import execute

UM = 1e-6


@pytest.fixture
def command(monkeypatch, capsys):
    """Run a command line; returns (exit code, stdout, stderr)."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["taichi-slm", *map(str, arguments)])
        try:
            main()
        except SystemExit as ended:
            return (ended.code or 0, *capsys.readouterr())
        return (0, *capsys.readouterr())

    return run


@pytest.fixture(scope="module")
def comet(tmp_path_factory):
    """A run folder of the stand-in: a comet of heat over a powder row."""
    return make(tmp_path_factory.mktemp("comet"))


def make(place, **changes):
    with pytest.MonkeyPatch.context() as patch, open(place / "said.txt", "w") as file:
        patch.setattr(driver, "_build", lambda config, *_: FakeSimulation(config))
        patch.setattr(driver, "Draughtsmen", NobodyDraws)
        output = {"history_interval": 1e-5, "snapshot_interval": 2e-5}
        parsed = fake_run.config(spacing=10e-6, end=1e-4, output=output, **changes)
        return driver.execute(fake_run.loaded(parsed), place / "run", console=Console(file=file))


@pytest.fixture
def folder(comet, tmp_path):
    return shutil.copytree(comet, tmp_path / "run")


def rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def melted(tmp_path_factory, track):
    """A real track of 584 particles, run until all is solid."""
    place = tmp_path_factory.mktemp("track")
    output = {"history_interval": 5 * UM, "snapshot_interval": 5 * UM, "images": []}
    config = track(time={"end": 1e-3}, output=output)
    with open(place / "said.txt", "w") as file:
        return execute(fake_run.loaded(config), place / "run", threads=1, console=Console(file=file))


def test_a_track_from_first_to_last(melted, command):
    """The sizes are those that the run itself wrote: history.csv and summary.json."""
    code, out, err = command("analyse", melted)
    assert (code, err) == (0, "")
    analysis = melted / "analysis"
    found = json.loads((analysis / "analysis.json").read_text())
    summary = json.loads((melted / "summary.json").read_text())
    history = read_history(melted / "history.csv")
    pools = read_history(analysis / "pools.csv")
    for column, known in (("length_m", "melt_length_m"), ("depth_m", "melt_depth_m")):
        for time in np.unique(pools["time_s"]):
            first = int(np.flatnonzero(pools["time_s"] == time)[0])  # the largest pool, as in the history
            row = int(np.argmin(np.abs(history["time_s"] - time)))
            assert pools[column][first] == pytest.approx(history[known][row], rel=1e-5)  # f"{value:.7g}"
    kept = summary["melt_pool"]["track"]
    assert found["track"]["track_particles"] == pytest.approx(
        kept["particles"], abs=10
    )  # crumbs are left out
    assert found["track"]["unmelted_powder_particles"] == kept["unmelted_powder"]
    assert found["spatter"]["removed_particles"] == summary["mass"]["removed"]
    assert found["energy"]["in_J"] == pytest.approx(found["energy"]["out_J"], rel=1e-6)
    assert found["energy"]["absorbed_J"] == pytest.approx(summary["energy"]["absorbed_J"])
    assert found["solidification"]["frozen_particles"] >= found["track"]["track_particles"]
    fronts = read_history(analysis / "fronts.csv")
    good = np.isfinite(fronts["front_speed_m_s"])
    product = fronts["front_speed_m_s"] * fronts["gradient_K_m"]
    assert product[good] == pytest.approx(fronts["cooling_rate_at_front_K_s"][good], rel=1e-5)
    for name in ("pools", "track", "fronts", "energy"):
        assert (analysis / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        assert f"{name}.png" in out
    assert {"run", "melt", "track", "fusion", "voids", "freezing", "spatter"} <= {
        line.split()[0] for line in out.splitlines()
    }


def test_the_columns_name_their_units(folder, command):
    assert command("analyse", folder)[0] == 0
    units = ("_s", "_m", "_m2", "_m3", "_K", "_kg", "_kg_m", "_m_s", "_K_s", "_K_m")
    bare = {
        "pool", "particles", "id", "times_melted", "drops", "particles_in_flight", "removed_particles", "kind", "group",
        "foreign_share", "foreign_share_if_random", "mixing_index",
    }  # fmt: skip
    files = sorted((folder / "analysis").glob("*.csv"))
    assert {file.stem for file in files} == {"pools", "track", "fronts", "spatter", "mixing"}
    for file in files:
        for name in rows(file)[0]:
            assert name in bare or name.endswith(units), (file.name, name)


def test_the_comet_in_3d(tmp_path, command):
    run = make(tmp_path, dimension=3)
    assert command("analyse", run)[0] == 0
    pools = rows(run / "analysis/pools.csv")
    assert {"width_m", "volume_m3", "mass_kg"} <= set(pools[0])
    assert float(pools[-1]["width_m"]) > 0.0
    assert {"width_m", "crest_m", "area_below_m2"} <= set(rows(run / "analysis/track.csv")[0])


def test_it_changes_nothing_else_in_the_folder(folder, command):
    def others():
        return {
            path: path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file() and path.parent != folder / "analysis"
        }

    before = others()
    assert command("analyse", folder)[0] == 0
    assert others() == before


def test_nothing_was_ever_liquid(tmp_path, command, monkeypatch):
    monkeypatch.setattr(fake_run, "SOLIDUS", 1e4)
    monkeypatch.setattr(fake_run, "LIQUIDUS", 1.1e4)
    run = make(tmp_path)
    facts = json.loads((run / "provenance.json").read_text())
    for each in facts["materials"]:
        each["solidus_K"], each["liquidus_K"] = 1e4, 1.1e4
    (run / "provenance.json").write_text(json.dumps(facts))
    code, out, err = command("analyse", run)
    assert (code, err) == (0, "")
    assert "nothing was liquid in any snapshot: all sizes are 0" in out
    found = json.loads((run / "analysis/analysis.json").read_text())
    assert found["pool"]["pools"] == 0
    assert found["pool"]["max_length_m"] == found["pool"]["max_area_m2"] == 0.0
    assert found["solidification"]["frozen_particles"] == 0
    assert rows(run / "analysis/pools.csv") == []


def test_what_is_no_run_folder_is_told_in_a_sentence(tmp_path, command):
    for place, said in ((tmp_path, "is not a run folder"), (tmp_path / "none", "there is no folder")):
        code, out, err = command("analyse", place)
        assert (code, out) == (4, "")
        assert said in err
        assert err.count("\n") == 1


def test_a_run_without_snapshots(folder, command):
    (folder / "snapshots.pvd").unlink()
    code, _, err = command("analyse", folder)
    assert code == 4
    assert "has no snapshots to analyse" in err


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.999])
def test_a_truncated_snapshot(folder, command, keep):
    path = folder / "snapshots/000002.vtu"
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data))])
    code, out, err = command("analyse", folder)
    assert (code, out) == (4, "")
    assert "000002.vtu" in err
    assert "Traceback" not in err
    assert not (folder / "analysis/pools.csv").exists()


def test_damaged_facts(folder, command):
    (folder / "provenance.json").write_text('{"materials": [{"name": "steel"}]}')
    code, _, err = command("analyse", folder)
    assert code == 4
    assert "does not name the materials" in err


def test_an_unfinished_run_says_so(folder):
    """The comet's run ends while metal is liquid."""
    assert any("still liquid" in sentence for sentence in examine(folder).sentences)


def test_the_axes_follow_the_beam():
    """A beam along (3, 4): 'along' is that direction, 'across' to its left, both of length one."""
    path = [
        {"kind": "line", "start": [0, 0], "end": [1e-4, 0], "speed": 1.0},
        {"kind": "line", "start": [0, 0], "end": [3e-4, 4e-4], "speed": 1.0},
    ]
    laser = {"power": 1, "beam_radius": 1e-5, "absorptivity": 0.3, "path": path}
    body = {"shape": "plate", "length": 1e-3, "width": 1e-3, "depth": 1e-4}
    keys = {"dimension": 3, "spacing": 1e-5, "bodies": [body], "time": {"end": 1e-3}}
    axes = along(Config.model_validate({**keys, "laser": laser}))
    assert axes == pytest.approx(np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]))
    assert (along(Config.model_validate(keys)) == np.eye(3)).all()
