"""The scenes that ship: listed, shown, copied out, found by name; in a checkout and in an installed package."""

import sys
from pathlib import Path

import pytest

from taichi_slm.cli import main
from taichi_slm.config import shipped
from taichi_slm.config.load import load_config
from taichi_slm.errors import ConfigError
from taichi_slm.run import driver

CONFIGS = Path(__file__).parents[1] / "configs"


@pytest.fixture
def cli(tmp_path, monkeypatch, capsys):
    """Run a command line in an empty folder; returns (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["taichi-slm", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code or 0, *capsys.readouterr()

    return run


def test_the_package_has_every_file_of_configs():
    """Where the package is installed, this compares what setup.py took along with the checkout."""
    for file in [*CONFIGS.glob("*.yaml"), CONFIGS / "schema.json"]:
        assert (shipped.folder() / file.name).read_bytes() == file.read_bytes()


def test_the_list(cli):
    code, out, err = cli("scenes")
    assert (code, err) == (0, "")
    names = {path.stem for path in CONFIGS.glob("*.yaml")} - {"paper"}
    assert {line.split()[0] for line in out.splitlines()} == names
    assert "track_3d                3-D  3-D powder track, 316L, 75 W\n" in out


def test_one_scene_with_its_estimate(cli):
    code, out, err = cli("scenes", "track_150W")
    assert (code, err) == (0, "")
    text = (CONFIGS / "track_150W.yaml").read_text(encoding="utf-8")
    told = cli("validate", "track_150W")[1]
    assert out == f"{text}\n{told}"
    assert "\n  particles " in told
    sentence = "track_150: no scene of this name ships. Did you mean 'track_150W'?\n"
    assert cli("scenes", "track_150") == (2, "", sentence)


@pytest.mark.parametrize("name", shipped.scene_names())
def test_a_copy_is_the_same_scene(cli, name):
    """Also where it extends others, two deep."""
    code, out, _ = cli("scenes", name, "--write", "mine/own.yaml")
    assert code == 4  # a folder is not made in passing
    Path("mine").mkdir()
    code, out, err = cli("scenes", name, "--write", "mine/own.yaml")
    assert (code, err) == (0, "")
    written = {Path(line) for line in out.split()}
    assert written == set(Path("mine").iterdir()) >= {Path("mine/own.yaml"), Path("mine/schema.json")}
    assert load_config("mine/own.yaml").config == load_config(CONFIGS / f"{name}.yaml").config
    assert Path("mine/own.yaml").read_bytes() == (CONFIGS / f"{name}.yaml").read_bytes()


def test_a_copy_takes_nobodys_place(cli):
    Path("track_150W.yaml").write_text("mine")
    code, out, err = cli("scenes", "track_50W", "--write", "own.yaml")
    assert (code, out) == (4, "")
    assert err.startswith("track_150W.yaml exists already and is never written over")
    assert [path.name for path in Path().iterdir()] == ["track_150W.yaml"]
    Path("track_150W.yaml").unlink()
    code, _, err = cli("scenes", "track_50W", "--write", "track_150W.yaml")
    assert (code, list(Path().iterdir())) == (4, [])
    assert "needs another file of this name beside it" in err
    assert cli("scenes", "track_50W", "--write", "one.yaml")[0] == 0
    assert cli("scenes", "track_200W", "--write", "two.yaml")[1] == "two.yaml\n"  # its base is there already
    assert cli("scenes", "track_200W", "--write", "two.yaml")[0] == 4


def test_a_name_finds_a_file_first_then_a_scene(cli, monkeypatch):
    seen = []
    monkeypatch.setattr(driver, "execute", lambda loaded, **_: seen.append(loaded))
    Path("track_100W").mkdir()  # a folder of that name is no scene
    assert cli("run", "track_100W", "--set", "seed=5")[0] == 0
    assert seen[0].config.laser.power == 100.0
    assert (seen[0].config.seed, seen[0].path.name) == (5, "track_100W.yaml")
    Path("track_50W").write_text((CONFIGS / "column_two_fluids.yaml").read_text(encoding="utf-8"))
    assert cli("run", "track_50W")[0] == 0
    assert (seen[1].config.laser, seen[1].path) == (None, Path("track_50W"))


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("track_150", "track_150W"),
        ("track_150W.yaml", "track_150W"),
        ("configs/track_3d.yaml", "track_3d"),
        ("spotweld_3ms", "spot_weld_3ms"),
    ],
)
def test_a_name_that_is_nearly_one(cli, name, meant):
    sentence = f"{name}: there is no such file. Did you mean '{meant}'?\n"
    assert cli("run", name) == (2, "", sentence)


def test_no_guess_where_nothing_is_near(cli):
    assert cli("run", "paper") == (2, "", "paper: there is no such file.\n")  # a base, not a scene
    with pytest.raises(ConfigError, match="embedded null byte"):
        load_config("/nonexistent/\0")
