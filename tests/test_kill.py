"""kill -9, again and again: every file with a final name is whole, and what is resumed becomes the unbroken run."""

import json
import random
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from taichi_slm.output.snapshots import read_series, read_snapshot
from taichi_slm.run.checkpoint import latest_good
from taichi_slm.run.run_folder import RunFolder

BEGIN = """
import os, signal, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import fake_run
from taichi_slm.run import driver
out = Path(sys.argv[2])
resumed = (out / "checkpoints").is_dir() and any((out / "checkpoints").glob("*.npz"))

class Slow:  # takes its time, so that there is something to kill
    def advance(self, *until):
        time.sleep(float(sys.argv[3]))
        super().advance(*until)
"""

COMET = (
    BEGIN
    + """
class SlowComet(Slow, fake_run.FakeSimulation):
    pass

driver._build = lambda config, *_: SlowComet(config)
output = {"history_interval": 1e-6, "snapshot_interval": 1e-6, "checkpoint_interval": 1e-6, "images": []}
if resumed:
    driver.resume(out)
else:
    parsed = fake_run.config(spacing=20e-6, length=200e-6, end=1e-4, output=output)
    driver.execute(fake_run.loaded(parsed), out)
"""
)

MELT = (
    BEGIN
    + """
import conftest
from taichi_slm.config.schema import Config
from taichi_slm.run.simulation import Simulation

class SlowMelt(Slow, Simulation):
    pass

driver._build = lambda config, arch, precision, threads: SlowMelt(config, None, arch, precision, threads)
output = {"history_interval": 5e-7, "snapshot_interval": 2e-6, "checkpoint_interval": 1e-6, "images": []}
if resumed:
    driver.resume(out)
else:
    parsed = Config.model_validate({**conftest.TRACK, "output": output, "time": {"end": 24e-6}})
    driver.execute(fake_run.loaded(parsed), out, threads=1)
"""
)

DYING = (
    BEGIN
    + """
from taichi_slm.output import atomic, history

end, step, left = 4e-6, 1e-6, int(sys.argv[3])  # touches of the disk until the kill; 0: none

def touch(*_):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    print("touch", flush=True)

class Half:  # a file that has half of what it is given when the kill comes
    def __init__(self, file):
        self.file = file
    def __getattr__(self, name):
        return getattr(self.file, name)
    def __enter__(self):
        return self
    def __exit__(self, *_):
        self.file.close()
    def write(self, data):
        half = len(data) // 2
        if left == 1:
            self.file.write(data[:half])
            self.file.flush()
        touch()
        return self.file.write(data)

class Os:
    def __getattr__(self, name):
        return getattr(os, name)
    def fsync(self, descriptor):
        touch()
        os.fsync(descriptor)
    def replace(self, old, new):
        touch()
        os.replace(old, new)
        touch()

atomic.os = Os()
atomic.open = history.open = lambda *way, **how: Half(open(*way, **how))
driver._build = lambda config, *_: fake_run.FakeSimulation(config)
output = {"history_interval": step, "snapshot_interval": step, "checkpoint_interval": step, "images": []}
if resumed:
    driver.resume(out)
else:
    parsed = fake_run.config(spacing=20e-6, length=200e-6, end=end, output=output)
    driver.execute(fake_run.loaded(parsed), out)
"""
)


def start(program: str, out: Path, *words: object) -> subprocess.Popen:
    here = str(Path(__file__).parent)
    return subprocess.Popen(
        [sys.executable, "-c", program, here, str(out), *(str(word) for word in words)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def to_its_end(program: str, out: Path, *words: object) -> str:
    """What the program printed; it must end well."""
    said, complaint = start(program, out, *words).communicate(timeout=180)
    assert RunFolder(out).summary.is_file(), complaint.decode()
    return said.decode()


def whole_files(folder: RunFolder) -> None:
    """What has its final name can be read to its end; the series names only what is there."""
    for path in folder.snapshots.glob("*.vtu"):
        assert len(read_snapshot(path).arrays["position"])
    for path in folder.path.glob("*.json"):
        json.loads(path.read_text(encoding="utf-8"))
    if folder.series.is_file():
        ElementTree.parse(folder.series)
        assert all(path.is_file() for _, path in read_series(folder.series))
    if folder.checkpoints.is_dir() and any(folder.checkpoints.glob("*.npz")):
        assert latest_good(folder.checkpoints).step >= 0
    if folder.history.is_file():
        assert folder.history.read_text(encoding="utf-8").count("step,time_s") <= 1


def same_files(killed: Path, unbroken: Path) -> None:
    """History and snapshots byte by byte, both done, and no litter."""
    folder, whole = RunFolder(killed), RunFolder(unbroken)
    assert folder.history.read_bytes() == whole.history.read_bytes()
    names = [path.name for _, path in read_series(whole.series)]
    assert [path.name for _, path in read_series(folder.series)] == names
    for name in names:
        assert (folder.snapshots / name).read_bytes() == (whole.snapshots / name).read_bytes()
    state, other = (json.loads(each.status.read_text())["state"] for each in (folder, whole))
    assert state == other == "done"
    assert not list(killed.rglob(".*.tmp"))


def clear_if_nothing_to_resume(out: Path) -> None:
    """Before the first checkpoint there is nothing to resume: the run is begun anew."""
    if not any(RunFolder(out).checkpoints.glob("*.npz")):
        shutil.rmtree(out, ignore_errors=True)


def kill_again_and_again(
    program: str, out: Path, kills: int, longest: float, slow: tuple, quick: tuple
) -> int:
    """Kill at random instants of ``longest`` seconds, then let it come to its end; returns how often."""
    rng = random.Random(kills)
    for done in range(kills):
        process = start(program, out, *slow)
        waiting = time.monotonic() + 30
        while not out.exists() and process.poll() is None and time.monotonic() < waiting:
            time.sleep(0.01)  # while Python starts there is nothing to lose
        time.sleep(rng.uniform(0.0, longest))
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=30)
        if process.returncode == 0:  # it was faster
            return done
        whole_files(RunFolder(out))
        clear_if_nothing_to_resume(out)
    to_its_end(program, out, *quick)
    return kills


@pytest.mark.parametrize("kills", [4, pytest.param(200, marks=pytest.mark.slow)])
def test_killed_and_resumed_is_the_unbroken_run(tmp_path, kills):
    to_its_end(COMET, tmp_path / "whole", 0.0)
    # 100 moments of 20 ms: two seconds, and an end
    done = kill_again_and_again(COMET, tmp_path / "killed", kills, 0.6, (0.02,), (0.0,))
    assert done >= min(kills, 3)
    same_files(tmp_path / "killed", tmp_path / "whole")


@pytest.mark.slow
def test_the_true_solver_killed_and_resumed_is_the_unbroken_run(tmp_path):
    """A melting track, ten kills while it compiles and melts; the same bits at the end."""
    to_its_end(MELT, tmp_path / "whole", 0.0)
    # 48 moments of 0.2 s: ten seconds at least, more than the first two kills together give it
    done = kill_again_and_again(MELT, tmp_path / "killed", 10, 8.0, (0.2,), (0.0,))
    assert done >= 2
    same_files(tmp_path / "killed", tmp_path / "whole")


@pytest.mark.parametrize("every", [20, pytest.param(1, marks=pytest.mark.slow)])
def test_killed_inside_every_write(tmp_path, every):
    """Half a file written, before and after its sync, before and after its renaming."""
    touches = to_its_end(DYING, tmp_path / "whole", 0).count("touch")
    assert touches > 80
    for number in range(1, touches + 1, every):
        out = tmp_path / f"killed_{number}"
        process = start(DYING, out, number)
        process.communicate(timeout=60)
        assert process.returncode == -signal.SIGKILL
        whole_files(RunFolder(out))
        clear_if_nothing_to_resume(out)
        to_its_end(DYING, out, 0)
        same_files(out, tmp_path / "whole")
        shutil.rmtree(out)
