"""`taichi-slm compare`: what differs between scenes, what is analysed anew, the table and the plot."""

import csv
import json
import os
import shutil

import pytest
from rich.console import Console
from test_analysis_run import command, make  # noqa: F401

from taichi_slm.analysis import analyse as module
from taichi_slm.analysis.compare import compare, differing
from taichi_slm.config.schema import Config
from taichi_slm.errors import ConfigError

UM = 1e-6


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two comets: the second over a longer plate."""
    place = tmp_path_factory.mktemp("pair")
    runs = []
    for name, length in (("short", 400 * UM), ("long", 460 * UM)):
        (place / name).mkdir()
        runs.append(make(place / name, length=length).rename(place / f"{name}_run"))
    return runs


@pytest.fixture
def runs(pair, tmp_path):
    return [shutil.copytree(run, tmp_path / run.name) for run in pair]


def test_keys_that_differ(track):
    a = track()
    b = track(laser={"power": 70}, title="another name")
    c = Config.model_validate(
        {**a.model_dump(mode="json"), "bodies": [a.model_dump(mode="json")["bodies"][0]], "seed": 4}
    )
    found = differing([a, b, c])
    assert found["laser.power"] == [60.0, 70.0, 60.0]
    assert found["seed"] == [0, 0, 4]
    assert found["bodies.1.radius"] == [20 * UM, 20 * UM, None]
    assert set(found) - {"laser.power", "seed"} == {key for key in found if key.startswith("bodies.1.")}


def test_side_by_side(runs, tmp_path, command):  # noqa: F811
    code, out, err = command("compare", *runs, "--out", tmp_path / "both")
    assert (code, err) == (0, "")
    with open(tmp_path / "both/compare.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["run"] for row in rows] == ["short_run", "long_run"]
    assert [float(row["bodies.0.length"]) for row in rows] == pytest.approx([400 * UM, 460 * UM])
    for row, run in zip(rows, runs, strict=True):
        numbers = json.loads((run / "analysis/analysis.json").read_text())
        assert float(row["pool.max_length_m"]) == pytest.approx(numbers["pool"]["max_length_m"], rel=1e-6)
        assert int(row["track.track_particles"]) == numbers["track"]["track_particles"]
    assert (tmp_path / "both/compare.png").read_bytes()[:4] == b"\x89PNG"
    lines = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line.strip()}
    assert lines["short_run"] == ["long_run"]
    unit, *lengths = lines["bodies.0.length"]
    assert unit == "[m]"
    assert [float(value) for value in lengths] == pytest.approx([400 * UM, 460 * UM])
    assert "pool.max_length_m" in lines
    assert "laser.power" not in lines


def test_what_is_analysed_is_not_analysed_again(runs, tmp_path, monkeypatch):
    said = []
    examine = module.examine
    monkeypatch.setattr(module, "examine", lambda run: (said.append(run.name), examine(run))[1])
    console = Console(quiet=True)
    compare(runs, tmp_path / "out", console)
    compare(runs, tmp_path / "out", console)
    assert said == ["short_run", "long_run"]
    later = (runs[0] / "analysis/analysis.json").stat().st_mtime + 10
    os.utime(runs[0] / "snapshots.pvd", (later, later))  # a resumed run has gone on
    compare(runs, tmp_path / "out", console)
    assert said == ["short_run", "long_run", "short_run"]
    path = runs[1] / "analysis/analysis.json"
    numbers = json.loads(path.read_text())
    path.write_text(json.dumps(numbers | {"edition": -1}))  # an older program's
    os.utime(runs[0] / "snapshots.pvd", (0, 0))
    compare(runs, tmp_path / "out", console)
    assert said == ["short_run", "long_run", "short_run", "long_run"]


def test_runs_of_one_name_are_told_by_their_paths(runs, tmp_path):
    places = [tmp_path / "a" / "run", tmp_path / "b" / "run"]
    for run, place in zip(runs, places, strict=True):
        shutil.copytree(run, place)
    compare(places, tmp_path / "out", Console(quiet=True))
    with open(tmp_path / "out/compare.csv", newline="") as file:
        assert [row["run"] for row in csv.DictReader(file)] == [str(place) for place in places]


def test_one_run_is_none_too_many(runs, tmp_path, command):  # noqa: F811
    with pytest.raises(ConfigError, match="two run folders or more"):
        compare(runs[:1], tmp_path / "out", Console(quiet=True))
    code, out, err = command("compare", runs[0])
    assert (code, out) == (2, "")
    assert "two run folders or more" in err


def test_what_is_no_run_is_told_before_anything_is_written(runs, tmp_path, command):  # noqa: F811
    code, _, err = command("compare", runs[0], tmp_path / "none", "--out", tmp_path / "out")
    assert code == 4
    assert f"there is no folder {tmp_path / 'none'}" in err
    assert not (tmp_path / "out").exists()
