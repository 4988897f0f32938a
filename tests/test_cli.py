"""The commands as a person meets them: what they print, how they end, what they load."""

import errno
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

import taichi_slm
from taichi_slm import errors
from taichi_slm.cli import main
from taichi_slm.config.load import load_config
from taichi_slm.run import doctor, driver
from taichi_slm.run.estimate import energy_density, estimate, memory_bytes
from taichi_slm.solver.timestep import limits

CONFIGS = Path(__file__).parents[1] / "configs"
GOOD = """\
dimension: 2
spacing: 10 um
bodies:
  - {shape: plate, length: 1 mm, depth: 0.1 mm}
  - {shape: powder_row, length: 1 mm, radius: 25 um}
laser:
  power: 150
  beam_radius: 54 um
  path: [{kind: line, start: [0], end: [1e-3], speed: 2.0}]
time: {end: 1e-3}
"""
HEAVY = (
    "numpy",
    "scipy",
    "pydantic",
    "pint",
    "ruamel.yaml",
    "taichi.lang",
    "pyvista",
    "vtkmodules",
    "matplotlib",
)


@pytest.fixture
def cli(tmp_path, monkeypatch, capsys):
    """Run a command line in an empty folder; returns (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    Path("good.yaml").write_text(GOOD)
    Path("bad.yaml").write_text(GOOD.replace("power", "powr"))

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["taichi-slm", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return ended.value.code or 0, out, err

    return run


def loaded_by(*arguments):
    """(seconds, heavy modules that a command line loads), in a process of its own."""
    code = (
        "import sys; from taichi_slm.cli import main; sys.argv = ['taichi-slm', *sys.argv[1:]]\n"
        "try: main()\n"
        f"finally: print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    return time.perf_counter() - began, done.stderr.strip()


# --------------------------------------------------------------------------- start


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_loads_nothing_heavy(option):
    seconds, heavy = loaded_by(option)
    assert heavy == "[]"
    assert seconds < 3.0  # 0.2 s on a machine with nothing else to do


def test_validate_loads_neither_taichi_nor_vtk():
    seconds, heavy = loaded_by("validate", str(CONFIGS / "track_150W.yaml"))
    assert "taichi.lang" not in heavy
    assert not any(name in heavy for name in ("pint", "pyvista", "vtkmodules", "matplotlib"))
    assert seconds < 6.0  # 0.5 s on a machine with nothing else to do


def test_package_loads_its_interface_when_asked():
    code = (
        "import taichi_slm, sys; print('numpy' in sys.modules); taichi_slm.load_config; taichi_slm.Simulation"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        taichi_slm.nonsense  # noqa: B018


def test_version(cli):
    assert cli("--version") == (0, taichi_slm.__version__ + "\n", "")


# --------------------------------------------------------------------------- validate


def test_validate_says_what_a_run_takes(cli):
    code, out, err = cli("validate", "good.yaml", "--set", "laser.power=200")
    assert (code, err) == (0, "")
    assert out.startswith("good.yaml: valid\n  particles       1,")
    for row in ("memory", "step sound", "step viscosity", "step capillary", "step heat", "steps", "output"):
        assert f"\n  {row} " in out
    assert out.count("<- rules") == 1
    assert "P/v = 100 J/m" in out
    assert "P/(v 2w layer) = 18.52 J/mm^3" in out


def test_validate_goes_on_after_a_bad_one(cli):
    code, out, err = cli("validate", "bad.yaml", "good.yaml", "none.yaml")
    assert code == 2
    assert out.startswith("good.yaml: valid")
    assert err == (
        "bad.yaml:7: laser.powr: unknown key. Did you mean 'power'?\nnone.yaml: there is no such file.\n"
    )


def test_validate_names_the_file_of_a_scene_that_cannot_be_built(cli):
    Path("twice.yaml").write_text(
        GOOD.replace("shape: powder_row", "shape: plate, depth: 50 um").replace(", radius: 25 um", "")
    )
    code, _, err = cli("validate", "twice.yaml")
    assert code == 2
    assert err.startswith("twice.yaml: bodies.1 (plate)")


@pytest.mark.parametrize("name", ["track_150W", "column_two_fluids", "track_3d"])
def test_estimate_agrees_with_the_solver(name):
    loaded = load_config(CONFIGS / f"{name}.yaml")
    found = estimate(loaded)
    scene = taichi_slm.scene.build.build_scene(loaded.config)
    assert found.particles == scene.count
    assert found.step <= min(limits(loaded.config, scene.materials).values())
    assert found.steps >= loaded.config.time.end / found.step * (1 - 1e-9)
    assert memory_bytes(loaded.config, 2 * scene.count) > found.memory


def test_energy_density(cli):
    config = load_config(Path("good.yaml")).config
    line, density = energy_density(config)
    assert line == pytest.approx(75.0)  # 150 W / 2 m/s
    assert density == pytest.approx(75.0 / (2 * 54e-6 * 50e-6))
    assert energy_density(config.model_copy(update={"laser": None})) == (None, None)


def test_a_machine_that_is_too_small_is_named(cli, monkeypatch):
    monkeypatch.setattr("taichi_slm.run.estimate.available_memory", lambda: 1e6)
    _, out, _ = cli("validate", "good.yaml")
    assert "warning: memory: about 29" in out


# --------------------------------------------------------------------------- run


def test_run_hands_its_options_over(cli, monkeypatch):
    seen = {}
    monkeypatch.setattr(
        driver, "execute", lambda loaded, **options: seen.update(options, config=loaded.config)
    )
    changes = ("--set", "laser.power=200", "--set", "seed=3")
    code, _, err = cli("run", "good.yaml", *changes, "--out", "x", "--threads", "2", "--precision", "f32")
    assert (code, err) == (0, "")
    assert (seen["config"].laser.power, seen["config"].seed) == (200.0, 3)
    assert {key: seen[key] for key in ("out", "arch", "precision", "threads")} == {
        "out": Path("x"), "arch": "cpu", "precision": "f32", "threads": 2,
    }  # fmt: skip


def test_run_refuses_a_bad_config_before_anything_is_made(cli):
    code, out, err = cli("run", "bad.yaml")
    assert (code, out) == (2, "")
    assert err == "bad.yaml:7: laser.powr: unknown key. Did you mean 'power'?\n"
    assert not Path("runs").exists()


def test_run_tells_warnings(cli, monkeypatch):
    monkeypatch.setattr(driver, "execute", lambda *_, **__: None)
    code, _, err = cli("run", "good.yaml", "--set", "time.end=1e-4")
    assert code == 0
    assert err.startswith("warning: --set time.end=1e-4: time.end: the run ends at 0.0001 s")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.LimitBrokenError, 1),
        (errors.ConfigError, 2),
        (errors.BlowUpError, 3),
        (errors.StorageError, 4),
        (errors.StoppedError, 75),
        (errors.InterruptedRunError, 130),
    ],
)
def test_every_ending_has_its_code(cli, monkeypatch, error, code):
    def fail(*_, **__):
        raise error("a sentence")

    monkeypatch.setattr(driver, "execute", fail)
    assert cli("run", "good.yaml") == (code, "", "a sentence\n")


def test_control_c(cli, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(driver, "execute", interrupt)
    assert cli("run", "good.yaml") == (130, "", "stopped by Ctrl-C\n")


def test_a_fault_is_one_sentence_and_a_file(cli, monkeypatch, tmp_path):
    def fail(*_, **__):
        raise RuntimeError("boom\nsecond line")

    monkeypatch.setattr(driver, "execute", fail)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    code, out, err = cli("run", "good.yaml")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert "RuntimeError: boom" in err
    assert "please report" in err
    assert "second line" in Path(err.split()[-1]).read_text()


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (MemoryError(), "not enough memory: use a larger spacing or a smaller scene\n"),
        (OSError(errno.ENOSPC, "No space", "runs/x"), "runs/x: the disk is full; free some space\n"),
    ],
)
def test_a_full_machine_is_exit_4(cli, monkeypatch, error, sentence):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(driver, "execute", fail)
    assert cli("run", "good.yaml") == (4, "", sentence)


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "good.yaml", "--arch", "abacus"),
        ("run", "good.yaml", "--threads", "0"),
        ("run",),
        ("validate",),
        ("nonsense",),
    ],
)
def test_a_wrong_command_line_is_exit_2(cli, arguments):
    code, _, err = cli(*arguments)
    assert code == 2
    assert "Traceback" not in err


# --------------------------------------------------------------------------- the small ones


def test_schema(cli):
    code, out, _ = cli("schema")
    assert code == 0
    assert "extends" in json.loads(out)["properties"]
    assert cli("schema", "--write", "schema.json")[0] == 0
    assert Path("schema.json").read_text() == out
    assert cli("schema", "--write", "none/schema.json")[0] == 4


def test_materials(cli):
    code, out, _ = cli("materials")
    assert code == 0
    assert "316L" in out
    code, out, _ = cli("materials", "steel_304")
    assert code == 0
    assert "liquidus                1773 K" in out
    assert cli("materials", "316") == (2, "", "there is no alloy '316'. Did you mean '316L'?\n")


def test_render_of_no_run_is_a_sentence(cli):
    code, _, err = cli("render", "nowhere")
    assert code in (2, 4)
    assert "Traceback" not in err


def doctored(monkeypatch, **answers):
    """What `doctor` is told by its probes, in place of the machine; a text is what a broken one says."""
    good = {
        "launch": {"serial": 1e-5, "parallel": 2e-5, "threads": 2, "cache": "cache"},
        "cpu": {"there": True, "works": {"f64": "", "f32": ""}},
        "cuda": {"there": False, "works": {}},
        "vulkan": {"there": False, "works": {}},
        "metal": {"there": False, "works": {}},
        "pictures": {"drawn": True, "renderer": "llvmpipe", "window": "vtkEGLRenderWindow"},
        "films": {"version": "7", "frames": 3},
    }
    told = good | answers

    def probe(*subject):
        answer = told[subject[-1]]
        return (None, answer) if isinstance(answer, str) else (answer, "")

    monkeypatch.setattr(doctor, "_probe", probe)


def test_doctor_of_a_machine_that_will_do(cli, monkeypatch):
    doctored(monkeypatch)
    code, out, err = cli("doctor")
    rows = {line[4:20].strip(): (line[1:3], line[20:].strip()) for line in out.splitlines()}
    assert (code, err) == (0, "")
    assert rows["kernel launch"] == ("ok", "10.0 us serial, 20.0 us parallel")
    assert rows["--arch cpu"] == ("ok", "works in f64 and f32")
    assert rows["--arch cuda"] == ("ok", "not on this machine")
    assert rows["films"] == ("ok", "ffmpeg 7")
    assert rows["pictures"][1] == "drawn by llvmpipe (vtkEGLRenderWindow)"


def test_doctor_names_what_a_run_does_without(cli, monkeypatch):
    """Exit code 0: the run itself would work."""
    Path("cache").mkdir()
    Path("cache", "kernel").write_bytes(bytes(2_500_000))
    doctored(
        monkeypatch,
        pictures="libEGL.so.1: cannot open shared object file",
        films="no module named imageio",
        cuda={"there": True, "works": {"f64": "", "f32": "[CUDA] out of memory"}},
        vulkan={"there": True, "works": {"f64": "no doubles", "f32": "a sum is 7, not 8"}},
    )
    code, out, err = cli("doctor")
    assert (code, err) == (0, "")
    assert "apt install libegl1" in out
    assert "-- films " in out.replace("  ", " ")
    assert "works in f64; not in f32: [CUDA] out of memory" in out  # brackets are no markup
    assert "not in f64: no doubles; not in f32: a sum is 7, not 8" in out
    assert "cache, 2.5 MB" in out


def test_doctor_ends_with_1_where_no_run_would_work(cli, monkeypatch):
    doctored(monkeypatch, launch="no module named taichi", cpu="killed by signal 11")
    monkeypatch.setattr(doctor, "NEEDED", ("numpy", "abacus-of-lead"))
    code, out, err = cli("doctor")
    assert (code, err) == (1, "no run will work here: abacus-of-lead, kernels, --arch cpu\n")
    assert "no: no module named taichi" in out
    assert "no: killed by signal 11" in out


def test_doctor_notices_a_folder_that_takes_no_files(monkeypatch):
    def refuse(**_):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    found = {finding.subject: finding for finding in doctor._machine()}
    assert not found["run folders"].good
    assert "Read-only file system; choose another folder with --out" in found["run folders"].value


def test_doctor_knows_every_dependency():
    text = (CONFIGS.parent / "pyproject.toml").read_text(encoding="utf-8")
    listed = text.partition("dependencies = [")[2].partition("]")[0]
    names = {line.strip().strip('",').partition(">")[0].partition("=")[0] for line in listed.split("\n")}
    assert {*doctor.NEEDED, *doctor.FOR} == names - {""}


def test_a_probe_that_crashes_is_a_finding(tmp_path, monkeypatch):
    """A bad driver ends the probe, not `doctor`."""
    report, said = doctor._probe("abacus")
    assert report is None
    assert "abacus" in said
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\nkill -SEGV $$\n")
    broken.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(broken))
    assert doctor._probe("pictures") == (None, "the process ended with code -11")


def test_doctor_on_this_machine(cli):
    """Kernels really run, in either precision; what else works depends on the machine."""
    found = {finding.subject: finding for finding in doctor.examine()}
    assert found["--arch cpu"] == doctor.Finding("--arch cpu", "works in f64 and f32", True, True)
    assert found["kernel launch"].good
    assert found["films"].value.startswith("ffmpeg ")
    doctor.judge(found.values())
