"""A run from folder to summary, with a closed form for a solver: stop, kill, resume, blow up."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import fake_run
import numpy as np
import pytest
from fake_run import FakeSimulation, run
from fake_run import short as config

from taichi_slm.errors import BlowUpError, InterruptedRunError, StoppedError, StorageError
from taichi_slm.output.history import COLUMNS, read_history
from taichi_slm.output.numbers import quantity
from taichi_slm.output.snapshots import read_series, read_snapshot
from taichi_slm.run import driver
from taichi_slm.run.checkpoint import Slots, find_latest, latest_good
from taichi_slm.run.pictures import Draughtsmen
from taichi_slm.run.progress import clock
from taichi_slm.run.run_folder import RunFolder
from taichi_slm.run.schedule import Every, earliest
from taichi_slm.run.summary import doubts

# --------------------------------------------------------------------------- schedule


def test_moments_do_not_drift_and_coincide():
    rows, pictures = Every(1e-3 / 400), Every(1e-3 / 40)
    moments, now = [], 0.0
    while now < 1e-3:
        both = rows.due(now), pictures.due(now)
        assert both[0] or both[1]
        moments.append(now)
        now = earliest([rows, pictures], 1e-3)
    assert len(moments) == 400
    assert moments[10] == pytest.approx(1e-3 / 40, rel=1e-12)


def test_resumed_schedule_starts_after_the_checkpoint():
    assert Every(0.1, after=0.3).next == pytest.approx(0.4)
    assert Every(0.1, after=0.35).next == pytest.approx(0.4)
    assert Every(0.1).due(0.0)


# --------------------------------------------------------------------------- checkpoints


def test_slots_alternate_and_survive_damage(tmp_path):
    slots = Slots(tmp_path)
    for step in (1, 2, 3):
        slots.write({"x": np.full(1000, step)}, {"step": step, "time_s": 0.1 * step})
    good = latest_good(tmp_path)
    assert (good.step, good.path.name) == (3, "a.npz")
    data = bytearray(good.path.read_bytes())
    for place in range(200, len(data) - 200, 997):  # one bit anywhere
        flipped = data.copy()
        flipped[place] ^= 4
        good.path.write_bytes(flipped)
        assert latest_good(tmp_path).step == 2
    good.path.write_bytes(data[: len(data) // 2])
    assert latest_good(tmp_path).step == 2
    assert Slots(tmp_path).write({"x": np.zeros(1)}, {"step": 4}).name == "a.npz"  # never over the good one


def test_no_good_checkpoint(tmp_path):
    assert find_latest(tmp_path) is None
    with pytest.raises(StorageError, match="there is none"):
        latest_good(tmp_path)
    (tmp_path / "a.npz").write_bytes(b"rubbish")
    with pytest.raises(StorageError, match="damaged"):
        latest_good(tmp_path)


# --------------------------------------------------------------------------- folder


def test_a_folder_is_never_written_over(tmp_path):
    loaded = fake_run.loaded(config())
    RunFolder.create(loaded, tmp_path / "run")
    with pytest.raises(StorageError, match="taichi-slm resume") as caught:
        RunFolder.create(loaded, tmp_path / "run")
    assert caught.value.exit_code == 4


def test_names_of_runs_at_the_same_second(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folders = {RunFolder.create(fake_run.loaded(config())).path for _ in range(3)}
    assert len(folders) == 3
    assert all(folder.parent == Path("runs") and folder.name.startswith("comet-2") for folder in folders)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_place(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(StorageError, match="no permission"):
        RunFolder.create(fake_run.loaded(config()), tmp_path / "run")


def test_a_place_that_is_a_file(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StorageError):
        RunFolder.create(fake_run.loaded(config()), tmp_path / "file" / "run")
    with pytest.raises(StorageError):
        RunFolder.create(fake_run.loaded(config()), tmp_path / "file")


def test_not_a_run(tmp_path):
    with pytest.raises(StorageError, match="not a run folder"):
        driver.resume(tmp_path)


# --------------------------------------------------------------------------- a whole run


def test_a_run_leaves_what_is_promised(tmp_path, console, fake):
    folder = RunFolder(run(tmp_path, console))
    assert folder.config.read_text() == "title: as given\n"
    history = read_history(folder.history)
    assert tuple(history)[: len(COLUMNS)] == COLUMNS
    assert len(history["step"]) == 401
    assert history["time_s"][-1] == 1e-4
    series = read_series(folder.series)
    assert len(series) == 41
    assert read_snapshot(series[-1][1]).time == series[-1][0] == 1e-4
    summary = json.loads(folder.summary.read_text())
    assert list(summary) == [
        "status", "particles", "dimension", "steps", "simulated_time_s", "wall_time_s", "solver_time_s",
        "compile_time_s", "particle_steps", "peak_memory_bytes", "max_temperature_K", "max_speed_m_s",
        "melt_pool", "energy", "mass", "momentum", "doubts",
    ]  # fmt: skip
    assert list(summary["melt_pool"]) == ["length_m", "width_m", "depth_m", "track"]
    assert summary["melt_pool"]["depth_m"] == history["melt_depth_m"].max()
    energy = summary["energy"]
    assert energy["absorbed_J"] == pytest.approx(energy["stored_J"] + energy["lost_J"])
    assert summary["status"] == json.loads(folder.status.read_text())["state"] == "done"
    facts = json.loads(folder.provenance.read_text())
    assert {"version", "git", "packages", "machine", "argv", "seed", "config_sha256"} <= set(facts)
    said = (tmp_path / "said.txt").read_text()
    assert "compiling kernels" in said
    last = [line.split()[0] for line in said.splitlines()[-5:]]
    assert last == ["energy", "mass", "cost", "pictures", "next"]
    assert 20 < len(said.splitlines()) < 40


def test_same_bits_from_half_and_resume(tmp_path, console, fake, monkeypatch):
    whole = RunFolder(run(tmp_path, console, name="whole"))
    advance = FakeSimulation.advance

    def interrupted(sim, *until):
        if sim.time > 0.43e-4:
            os.kill(os.getpid(), signal.SIGTERM)
        advance(sim, *until)

    monkeypatch.setattr(FakeSimulation, "advance", interrupted)
    with pytest.raises(StoppedError, match="taichi-slm resume") as caught:
        run(tmp_path, console, name="half")
    assert caught.value.exit_code == 75
    monkeypatch.setattr(FakeSimulation, "advance", advance)
    half = RunFolder(tmp_path / "half")
    assert json.loads(half.status.read_text())["state"] == "stopped"
    driver.resume(half.path, console=console)
    assert half.history.read_bytes() == whole.history.read_bytes()
    names = [path.name for _, path in read_series(whole.series)]
    assert [path.name for _, path in read_series(half.series)] == names
    for name in names:
        assert (half.snapshots / name).read_bytes() == (whole.snapshots / name).read_bytes()
    with pytest.raises(StorageError, match="nothing to resume"):
        driver.resume(half.path, console=console)


def test_resume_from_an_older_checkpoint_cuts_the_files_back(tmp_path, console, fake):
    folder = RunFolder(run(tmp_path, console))
    before = folder.history.read_bytes()
    slots = sorted(folder.checkpoints.glob("*.npz"), key=lambda path: find_latest(path.parent).path == path)
    slots[-1].write_bytes(b"torn")  # the newest one
    folder.status.write_text('{"state": "running"}')  # as after kill -9
    driver.resume(folder.path, console=console)
    assert folder.history.read_bytes() == before
    assert len(list(folder.snapshots.glob("*.vtu"))) == 41


def test_ctrl_c(tmp_path, console, fake, monkeypatch):
    advance, pressed = FakeSimulation.advance, []

    def interrupted(sim, *until):
        advance(sim, *until)
        if sim.time > 2e-5 and not pressed:  # it is heard at the next pause
            pressed.append(sim.time)
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(FakeSimulation, "advance", interrupted)
    before = signal.getsignal(signal.SIGINT)  # a shell has those ignore it that it starts behind the scenes
    with pytest.raises(InterruptedRunError, match="checkpoint written") as caught:
        run(tmp_path, console)
    assert caught.value.exit_code == 130
    assert signal.getsignal(signal.SIGINT) is before
    status = json.loads((tmp_path / "run/status.json").read_text())
    assert status["state"] == "interrupted"
    assert (tmp_path / "run" / status["last_good_checkpoint"]).is_file()


def test_wall_limit_and_stop_file(tmp_path, console, fake, monkeypatch):
    with pytest.raises(StoppedError, match="wall limit"):
        run(tmp_path, console, config(time={"wall_limit": 1e-9}))
    advance = FakeSimulation.advance

    def ask(sim, *until):
        (tmp_path / "stopped/STOP").touch()
        advance(sim, *until)

    monkeypatch.setattr(FakeSimulation, "advance", ask)
    with pytest.raises(StoppedError, match="STOP"):
        run(tmp_path, console, name="stopped")
    monkeypatch.setattr(FakeSimulation, "advance", advance)
    driver.resume(tmp_path / "stopped", console=console)


def test_blow_up(tmp_path, console, fake, monkeypatch):
    advance = FakeSimulation.advance

    def explode(sim, *until):
        advance(sim, *until)
        if sim.time > 5e-5:
            sim.scene.position[3] = np.nan
            raise BlowUpError("momentum: particle 3 is nowhere")

    monkeypatch.setattr(FakeSimulation, "advance", explode)
    with pytest.raises(BlowUpError, match="particle 3"):
        run(tmp_path, console)
    folder = RunFolder(tmp_path / "run")
    crash = read_snapshot(next(folder.crash.glob("*.vtu")))
    assert np.isnan(crash.arrays["position"][3]).all()
    assert json.loads(folder.status.read_text())["message"].startswith("momentum")
    assert json.loads(folder.summary.read_text())["status"] == "failed"
    assert latest_good(folder.checkpoints).meta["time_s"] < 5e-5


def test_a_step_of_nothing_is_not_an_endless_run(tmp_path, console, fake, monkeypatch):
    monkeypatch.setattr(FakeSimulation, "advance", lambda sim, *until: None)
    with pytest.raises(BlowUpError, match="collapsed"):
        run(tmp_path, console)


def test_disk_full_in_the_middle(tmp_path, console, fake, monkeypatch):
    def full(*_):
        raise StorageError("cannot write: the disk is full")

    monkeypatch.setattr("taichi_slm.run.recorder.Recorder.write_checkpoint", full)
    with pytest.raises(StorageError, match="disk is full"):
        run(tmp_path, console)


def test_kill_at_any_moment_leaves_a_good_checkpoint(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import fake_run\n"
        "from pathlib import Path\n"
        "from taichi_slm.run import driver\n"
        "driver._build = lambda config, *_: fake_run.FakeSimulation(config)\n"
        "output = {'history_interval': 1e-2, 'snapshot_interval': 1e-2, 'checkpoint_interval': 1e-7}\n"
        "parsed = fake_run.config(spacing=20e-6, length=200e-6, end=1.0, output=output)\n"
        "driver.execute(fake_run.loaded(parsed), Path(sys.argv[2]))\n"
    )
    out = tmp_path / "run"
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(Path(__file__).parent), str(out)], stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while find_latest(out / "checkpoints") is None and time.monotonic() < deadline:
        time.sleep(0.02)
    time.sleep(0.1)
    process.kill()
    process.wait()
    assert latest_good(out / "checkpoints").step >= 0
    json.loads((out / "status.json").read_text())


# --------------------------------------------------------------------------- what is said


def test_missing_gl_names_the_package(tmp_path, monkeypatch):
    (tmp_path / "pyvista.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with Draughtsmen(RunFolder(tmp_path), fake_run.config()) as draughtsmen:
        line = draughtsmen.draw()
    assert "libegl1" in line
    assert "libGL.so.1" in line


def test_who_would_draw_ends_with_a_run_that_is_killed(tmp_path):
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "import fake_run\n"
        "from taichi_slm.run.pictures import Draughtsmen\n"
        "from taichi_slm.run.run_folder import RunFolder\n"
        "with Draughtsmen(RunFolder(Path(sys.argv[1])), fake_run.config(), 2) as draughtsmen:\n"
        "    print(*(each.pid for each in draughtsmen._processes), flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True,
                          check=False, env=os.environ | {"PYTHONPATH": str(Path(__file__).parent)})  # fmt: skip
    left = [int(each) for each in done.stdout.split()]
    assert len(left) == 2
    deadline = time.monotonic() + 60  # they load for a second or two before they see that nobody is there
    while left and time.monotonic() < deadline:
        time.sleep(0.1)
        left = [each for each in left if Path(f"/proc/{each}/cmdline").exists()
                and b"taichi_slm.render" in Path(f"/proc/{each}/cmdline").read_bytes()]  # fmt: skip
    assert not left


def test_a_run_says_what_it_clipped_removed_or_lost():
    row = {"surface_evaluations": 1000, "curvature_clips": 40, "singular_gradients": 9, "packing_brackets": 400,
           "removed": 4, "energy_error": 1e-6}  # fmt: skip
    assert doubts(row, 10_000, 96) == []
    row |= {"curvature_clips": 60, "removed": 12, "energy_error": 0.02}
    assert doubts(row, 10_000, 88) == [
        "6% of the curvatures were clipped: a finer spacing may help (harmless: 5%)",
        "12% of the molten particles left or were alone, and were removed (harmless: 5%)",
        "2.0% of the energy is not accounted for (harmless: 0.1%)",
    ]
    assert doubts({"removed": 0, "energy_error": 0.0}, 0, 0) == []  # nothing melted, nothing was computed


def test_numbers_for_people():
    assert quantity(1.234e-5, "m") == "12.3 um"
    assert quantity(0.0, "s") == "0 s"
    assert quantity(None, "m") == "-"
    assert quantity(9.9999e-4, "s") == "1 ms"
    assert (clock(12.3), clock(185), clock(3723), clock(None)) == ("12 s", "3:05", "1:02:03", "-")
