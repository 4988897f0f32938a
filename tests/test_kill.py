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

PROGRAM = """
import sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import fake_run
from taichi_slm.run import driver

class Slow(fake_run.FakeSimulation):  # a comet that takes its time, so that there is something to kill
    def advance(self, until):
        time.sleep(float(sys.argv[3]))
        super().advance(until)

driver._build = lambda config, *_: Slow(config)
output = {"history_interval": 1e-6, "snapshot_interval": 1e-6, "checkpoint_interval": 1e-6, "images": []}
out = Path(sys.argv[2])
if (out / "checkpoints").is_dir() and any((out / "checkpoints").glob("*.npz")):
    driver.resume(out)
else:
    parsed = fake_run.config(spacing=20e-6, length=200e-6, end=1e-4, output=output)
    driver.execute(fake_run.loaded(parsed), out)
"""


def start(out: Path, pause: float) -> subprocess.Popen:
    here = str(Path(__file__).parent)
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, here, str(out), str(pause)],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


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


@pytest.mark.parametrize("kills", [4, pytest.param(100, marks=pytest.mark.slow)])
def test_killed_and_resumed_is_the_unbroken_run(tmp_path, kills):
    rng = random.Random(kills)
    unbroken = start(tmp_path / "whole", 0.0)
    assert unbroken.wait(120) == 0, unbroken.stderr.read()
    out, done = tmp_path / "killed", 0
    folder, code = RunFolder(out), None
    while code != 0:
        last = done >= kills
        process = start(out, 0.0 if last else 0.02)  # 100 moments: two seconds, and an end
        if last:
            code = process.wait(120)
            assert code == 0, process.stderr.read().decode()
            break
        waiting = time.monotonic() + 30
        while not out.exists() and process.poll() is None and time.monotonic() < waiting:
            time.sleep(0.01)  # while Python starts there is nothing to lose
        time.sleep(rng.uniform(0.0, 0.6))
        process.send_signal(signal.SIGKILL)
        code = process.wait(30)
        done += 1
        whole_files(folder)
        if not any(folder.checkpoints.glob("*.npz")):
            shutil.rmtree(out, ignore_errors=True)  # before the first checkpoint there is nothing to resume
    assert done >= min(kills, 3)
    whole = RunFolder(tmp_path / "whole")
    assert folder.history.read_bytes() == whole.history.read_bytes()
    names = [path.name for _, path in read_series(whole.series)]
    assert [path.name for _, path in read_series(folder.series)] == names
    for name in names:
        assert (folder.snapshots / name).read_bytes() == (whole.snapshots / name).read_bytes()
    state, other = (json.loads(each.status.read_text())["state"] for each in (folder, whole))
    assert state == other == "done"
    assert all(path.suffix == ".vtu" for path in folder.snapshots.iterdir())  # no litter
