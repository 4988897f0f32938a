"""What becomes of a run that is stopped, disturbed or damaged: told in a sentence, and nothing earlier is lost."""

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import fake_run
import numpy as np
import pytest
from fake_run import OUTPUT, FakeSimulation, run
from fake_run import short as config

from taichi_slm.errors import ConfigError, InterruptedRunError, StoppedError, StorageError
from taichi_slm.output.history import read_history
from taichi_slm.output.lock import alone
from taichi_slm.output.snapshots import read_series
from taichi_slm.run import driver
from taichi_slm.run.checkpoint import Slots, latest_good
from taichi_slm.run.recorder import Recorder
from taichi_slm.run.run_folder import RunFolder


def begun(tmp_path, console, monkeypatch, name="run"):
    """A run that was stopped at 43 us of 100: its folder."""
    with monkeypatch.context() as patch:
        patch.setattr(FakeSimulation, "advance", stopping_at(0.43e-4))
        with pytest.raises(StoppedError):
            run(tmp_path, console, name=name)
    return RunFolder(tmp_path / name)


def stopping_at(moment, number=signal.SIGTERM):
    advance = FakeSimulation.advance

    def interrupted(sim, *until):
        if sim.time > moment:
            os.kill(os.getpid(), number)
        advance(sim, *until)

    return interrupted


def test_one_process_at_a_time_in_a_folder(tmp_path, console, fake, monkeypatch):
    """Two that resume the same run would write the same slots; the second is told, and harms nothing."""
    folder = begun(tmp_path, console, monkeypatch)
    before = {path: path.read_bytes() for path in folder.path.rglob("*") if path.is_file()}
    with alone(folder.path), pytest.raises(StorageError, match="another process is at work") as caught:
        driver.resume(folder.path, console=console)
    assert caught.value.exit_code == 4
    assert {path: path.read_bytes() for path in folder.path.rglob("*") if path.is_file()} == before
    driver.resume(folder.path, console=console)  # and now nobody is


def test_of_two_that_make_one_folder_one_is_refused(tmp_path, monkeypatch):
    """Both find it empty; the lock file is made by one of them."""
    (tmp_path / "run").mkdir()
    RunFolder.create(fake_run.loaded(config()), tmp_path / "run")
    monkeypatch.setattr(Path, "iterdir", lambda _: iter(()))  # what the other saw a moment before
    with pytest.raises(StorageError, match="never written over"):
        RunFolder.create(fake_run.loaded(config()), tmp_path / "run")


def test_a_damaged_slot_is_said(tmp_path, console, fake, monkeypatch):
    folder = begun(tmp_path, console, monkeypatch)
    good = latest_good(folder.checkpoints)
    data = bytearray(good.path.read_bytes())
    data[len(data) // 2] ^= 1
    good.path.write_bytes(data)
    driver.resume(folder.path, console=console)
    assert f"note: {good.path} is damaged and not used" in (tmp_path / "said.txt").read_text()
    both = begun(tmp_path, console, monkeypatch, "both")
    for path in both.checkpoints.glob("*.npz"):
        path.write_bytes(b"torn")
    with pytest.raises(StorageError, match=r"a\.npz and b\.npz there are damaged"):
        driver.resume(both.path, console=console)


def test_a_folder_taken_away_ends_the_run_and_does_not_come_back(tmp_path, console, fake, monkeypatch):
    advance = FakeSimulation.advance

    def vanish(sim, *until):
        advance(sim, *until)
        if sim.time > 0.43e-4:
            shutil.rmtree(tmp_path / "run", ignore_errors=True)

    monkeypatch.setattr(FakeSimulation, "advance", vanish)
    with pytest.raises(StorageError, match="does not exist"):
        run(tmp_path, console)
    assert not (tmp_path / "run").exists()


def test_a_changed_config_is_not_resumed(tmp_path, console, fake, monkeypatch):
    """Its particles would not be those of the checkpoint."""
    folder = begun(tmp_path, console, monkeypatch)
    folder.resolved.write_text(folder.resolved.read_text().replace("spacing: 2e-05", "spacing: 2.5e-05"))
    with pytest.raises(ConfigError, match="is not what the run was begun with"):
        driver.resume(folder.path, console=console)


def test_a_checkpoint_of_another_version_is_a_sentence(tmp_path, console, fake, monkeypatch):
    folder = begun(tmp_path, console, monkeypatch)
    slots = Slots(folder.checkpoints)
    slots.write({"time": np.zeros(1)}, {**latest_good(folder.checkpoints).meta, "step": 10**6})
    with pytest.raises(StorageError, match="does not fit this version"):
        driver.resume(folder.path, console=console)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 75), (signal.SIGINT, 130)])
def test_stopped_before_its_first_step(tmp_path, console, fake, monkeypatch, number, code):
    """While kernels compile: at once, and resumed from the start."""
    whole = RunFolder(run(tmp_path, console, name="whole"))

    def hang(_):
        os.kill(os.getpid(), number)
        pytest.fail("the signal was not heard")

    with monkeypatch.context() as patch:
        patch.setattr(FakeSimulation, "compile", hang)
        with pytest.raises((StoppedError, InterruptedRunError), match="taichi-slm resume") as caught:
            run(tmp_path, console)
    assert caught.value.exit_code == code
    folder = RunFolder(tmp_path / "run")
    assert json.loads(folder.status.read_text())["state"] in ("stopped", "interrupted")
    folder.history.write_text("step,time_s\n0,0.0\n")  # as if it had been killed after its first row
    driver.resume(folder.path, console=console)
    assert folder.history.read_bytes() == whole.history.read_bytes()


def test_stopped_while_the_scene_is_built_leaves_nothing(tmp_path, console, monkeypatch):
    monkeypatch.setattr(driver, "_build", lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    with pytest.raises(StoppedError, match="nothing is left behind"):
        run(tmp_path, console)
    assert not (tmp_path / "run").exists()


def test_a_large_run_pauses_more_often(tmp_path, fake, console):
    """100 steps of a million moving particles would be minutes; the pause depends on the state alone."""
    sim = FakeSimulation(config())
    recorder = Recorder(sim, RunFolder.create(fake_run.loaded(config()), tmp_path / "run"), 0.0)
    sim.steps = 1234
    assert recorder.next_pause() == 1300
    sim.moving = 10**6
    assert recorder.next_pause() == 1236
    sim.moving = 10**9
    assert recorder.next_pause() == 1235
    recorder.close()


def saved(tmp_path, console, monkeypatch, **output):
    """The steps at which a run of 1000 steps wrote checkpoints."""
    steps = []
    write = Slots.write
    monkeypatch.setattr(
        Slots, "write", lambda slots, arrays, meta: steps.append(meta["step"]) or write(slots, arrays, meta)
    )
    run(
        tmp_path,
        console,
        fake_run.config(spacing=20e-6, length=200e-6, end=1e-4, output={**OUTPUT, **output}),
    )
    return steps


def test_checkpoints_by_time(tmp_path, console, fake, monkeypatch):
    # rows every 0.25 us cut each third step of 0.1 us in half: 12 steps in 1 us
    assert saved(tmp_path, console, monkeypatch, checkpoint_interval=3e-5) == [0, 360, 720, 1080]


def test_checkpoints_by_steps(tmp_path, console, fake, monkeypatch):
    """Steps of 0.1 us; nothing else is due but at the beginning and the end."""
    found = saved(tmp_path, console, monkeypatch, checkpoint_interval=1.0, history_interval=1.0,
                  snapshot_interval=1.0, checkpoint_steps=30)  # fmt: skip
    assert found[:4] == [0, 30, 60, 90]
    assert np.diff(found).max() == 30


def test_checkpoints_by_wall_clock(tmp_path, console, fake, monkeypatch):
    found = saved(tmp_path, console, monkeypatch, checkpoint_interval=1.0, history_interval=1.0,
                  snapshot_interval=1.0, checkpoint_wall=1e-9)  # fmt: skip
    assert found == [*range(0, 1001, 100)]  # whenever the run pauses


def test_the_wall_limit_counts_from_the_start_of_the_process(tmp_path, console, fake, monkeypatch):
    """A batch system counts compiling, too."""
    monkeypatch.setattr(FakeSimulation, "compile", lambda sim: time.sleep(0.3))
    with pytest.raises(StoppedError, match="wall limit"):
        run(tmp_path, console, config(time={"wall_limit": 0.3}))
    assert read_history(tmp_path / "run/history.csv")["step"][-1] < 100


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems forbid some of these bytes")
def test_names_with_spaces_and_umlauts(tmp_path, console, fake, monkeypatch):
    place = tmp_path / "Müller & Söhne; $(touch x)" / "é 'run\" #1"
    place.mkdir(parents=True)
    folder = begun(place, console, monkeypatch, "läuft hier")
    driver.resume(folder.path, console=console)
    assert len(read_series(folder.series)) == 41
    assert all(path.is_file() for _, path in read_series(folder.series))


def test_a_scene_that_memory_cannot_hold_is_refused_before_it_is_begun(tmp_path, console, fake, monkeypatch):
    """Built, it would be killed by the system, without a word."""
    monkeypatch.setattr(driver, "available_memory", lambda: 24e9)
    too_fine = fake_run.config(spacing=0.01e-6, length=200e-6)  # 2e8 particles at 300 bytes and more
    with pytest.raises(StorageError, match=r"about \d+ GB needed, 24 GB free") as caught:
        run(tmp_path, console, too_fine)
    assert caught.value.exit_code == 4
    assert not (tmp_path / "run").exists()
    needed = driver.memory_bytes(fake_run.config(), round(driver.particles_about(fake_run.config())))
    monkeypatch.setattr(
        driver, "available_memory", lambda: 1.1 * needed
    )  # peaks are up to 12 % above the estimate
    with pytest.raises(StorageError, match="not enough memory"):
        run(tmp_path, console)
    monkeypatch.setattr(driver, "available_memory", lambda: 1.2 * needed)
    run(tmp_path, console)
