"""One run from config to closing lines: `execute` a new one, `resume` one that stopped."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

from rich.console import Console

from taichi_slm.config.load import LoadedConfig, load_config
from taichi_slm.config.schema import Config
from taichi_slm.errors import (
    BlowUpError,
    ConfigError,
    InterruptedRunError,
    SlmError,
    StoppedError,
    StorageError,
)
from taichi_slm.output.atomic import read_json, sweep, write_json
from taichi_slm.output.numbers import quantity
from taichi_slm.run.checkpoint import Checkpoint, latest_good
from taichi_slm.run.progress import Progress, clock
from taichi_slm.run.recorder import Recorder
from taichi_slm.run.run_folder import (
    RunFolder,
    package_version,
    provenance,
    source_hash,
)
from taichi_slm.run.summary import closing_lines, summarise

if TYPE_CHECKING:
    from taichi_slm.run.simulation import Simulation

RENDER_SECONDS = 1800
GL_PACKAGES = "libgl1 libegl1"


def execute(
    loaded: LoadedConfig,
    out: Path | None = None,
    arch: str = "cpu",
    precision: str = "f64",
    threads: int | None = None,
    console: Console | None = None,
) -> Path:
    """Run ``loaded`` in a new folder (``out``, or runs/NAME-UTCSTAMP/) and return the folder."""
    began = time.perf_counter()
    console = console or Console()
    folder = RunFolder.create(loaded, out)
    _say(console, f"run {folder.path}")
    try:
        sim = _build(loaded.config, arch, precision, threads)
    except ConfigError:  # asked for what this machine lacks: nothing was begun, and nothing is left behind
        shutil.rmtree(folder.path, ignore_errors=True)
        raise
    facts = provenance(
        loaded.config, loaded.resolved_text, loaded.path, sim.scene.materials, arch, precision, threads
    )
    write_json(folder.provenance, facts)
    return _drive(sim, folder, console, began, None, threads)


def resume(path: Path, threads: int | None = None, console: Console | None = None) -> Path:
    """Continue the run in ``path`` from its last good checkpoint."""
    began = time.perf_counter()
    console = console or Console()
    folder = RunFolder.open(path)
    facts = read_json(folder.provenance)
    if folder.status.is_file() and read_json(folder.status).get("state") == "done":
        raise StorageError(f"{path} has run to its end: there is nothing to resume")
    sweep(path)
    checkpoint = latest_good(folder.checkpoints)
    threads = threads if threads is not None else facts.get("threads")
    config = load_config(folder.resolved).config
    sim = _build(config, facts.get("arch", "cpu"), facts.get("precision", "f64"), threads)
    if facts.get("git") != source_hash():
        _say(console, f"note: the run was begun by {facts.get('git')}, this is {source_hash()}")
    facts.setdefault("resumed", []).append(
        {"step": checkpoint.step, "git": source_hash(), "version": package_version(), "argv": sys.argv}
    )
    write_json(folder.provenance, facts)
    folder.stop.unlink(missing_ok=True)
    _say(console, f"resume {path} from step {checkpoint.step:,}, {quantity(checkpoint.meta['time_s'], 's')}")
    return _drive(sim, folder, console, began, checkpoint, threads)


def _build(config: Config, arch: str, precision: str, threads: int | None) -> "Simulation":
    from taichi_slm.run.simulation import Simulation  # Taichi starts here, and not for `--help`

    try:
        return Simulation(config, arch=arch, precision=precision, threads=threads)
    except MemoryError as error:
        raise StorageError(
            "not enough memory for this scene: use a larger spacing or a smaller plate"
        ) from error


def _drive(
    sim: "Simulation", folder: RunFolder, console: Console, began: float, resumed: Checkpoint | None,
    threads: int | None,
) -> Path:  # fmt: skip
    with StopRequests() as requests:
        _say(console, f"{sim.scene.count:,} particles; compiling kernels ...")
        sim.compile()
        _say(console, f"compiled in {sim.compile_time_s:.1f} s")
        if resumed:
            sim.restore(resumed.arrays)
        recorder = Recorder(sim, folder, began, resumed)
        try:
            with Progress(sim.config.title or folder.path.name, sim.config.time.end, console) as progress:
                _loop(sim, recorder, progress, requests)
        except Exception as error:
            with contextlib.suppress(StorageError):  # the first error is the one to report
                _leave(recorder, error)
            raise
        finally:
            recorder.close()
    summary = summarise(recorder, "done")
    write_json(folder.summary, summary)
    recorder.write_status("done")
    for line in closing_lines(recorder, summary):
        _say(console, line)
    _say(console, render(folder, sim.config, threads))
    _say(console, f"next       paraview {folder.series}    or    taichi-slm render {folder.path}")
    return folder.path


def _loop(sim: "Simulation", recorder: Recorder, progress: Progress, requests: "StopRequests") -> None:
    limit = sim.config.time.wall_limit
    began = time.perf_counter()
    if sim.steps == 0 and (row := recorder.record()):
        progress.update(row)
    while not sim.finished:
        before = sim.steps
        sim.advance(recorder.next_moment(), recorder.next_pause())
        if not sim.finished and requests.reason is None and sim.steps == before:
            raise BlowUpError(f"the time step collapsed: no step was made at {quantity(sim.time, 's')}")
        row = recorder.record()
        if row:
            progress.update(row)
        if recorder.folder.stop.exists():
            requests.reason = requests.reason or "the file STOP"
        if limit is not None and time.perf_counter() - began > limit:
            requests.reason = requests.reason or f"the wall limit of {clock(limit)}"
        if requests.reason and not sim.finished:
            recorder.write_checkpoint()
            raise requests.error(f"resume with: taichi-slm resume {recorder.folder.path}")
    row = recorder.record_last()
    if row:
        progress.update(row)


def _leave(recorder: Recorder, error: Exception) -> None:
    """Write what is known of a run that ends before its end; the last good checkpoint stays as it is."""
    states: dict[type[Exception], str] = {StoppedError: "stopped", InterruptedRunError: "interrupted"}
    state = states.get(type(error), "failed")
    recorder.write_status(state, str(error))
    if isinstance(error, BlowUpError):
        recorder.write_crash()
    if isinstance(error, SlmError):
        write_json(recorder.folder.summary, summarise(recorder, state))


class StopRequests:
    """Turns SIGINT and SIGTERM into a wish to stop; a second Ctrl-C leaves at once.

    The wish is granted at the next moment of the schedule or the next hundredth step: a run that stops only where an
    unbroken one pauses too has the same bits when it is resumed.
    """

    def __init__(self) -> None:
        self.reason: str | None = None
        self._interrupted = False
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> "StopRequests":
        if threading.current_thread() is threading.main_thread():  # elsewhere Python forbids handlers
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._ask)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _ask(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT:
            if self._interrupted:
                raise InterruptedRunError(
                    "left at once on the second Ctrl-C; the last good checkpoint is untouched"
                )
            self._interrupted = True
        self.reason = self.reason or ("Ctrl-C" if number == signal.SIGINT else "SIGTERM")

    def error(self, advice: str) -> SlmError:
        """What to raise once the checkpoint is written."""
        kind = InterruptedRunError if self._interrupted else StoppedError
        return kind(f"stopped by {self.reason}, checkpoint written; {advice}")


def render(folder: RunFolder, config: Config, threads: int | None = None) -> str:
    """Make the pictures in processes of their own, so that a missing GL never takes a run with it.

    One process draws on one core: there are as many as ``threads`` (None: as many as cores). Returns the line to print.
    """
    if not config.output.images or config.output.images_at_most == 0:
        return "pictures   none asked for"
    began = time.perf_counter()
    shares = min(threads or os.cpu_count() or 1, config.output.images_at_most)

    def draw(share: int) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "taichi_slm.render", str(folder.path), str(share), str(shares)]
        return subprocess.run(command, capture_output=True, text=True, timeout=RENDER_SECONDS, check=False)

    try:
        with ThreadPoolExecutor(shares) as pool:
            everyone = list(pool.map(draw, range(shares)))
    except (OSError, subprocess.SubprocessError) as error:
        return f"pictures   none: {error}"
    done = max(everyone, key=lambda process: abs(process.returncode))  # one that failed, if there is one
    if done.returncode == 0:
        count = len(list(folder.renders.glob("*.png")))
        return f"pictures   {count} in {folder.renders} ({time.perf_counter() - began:.0f} s)"
    said = (done.stderr or done.stdout).strip().splitlines()
    reason = said[-1] if said else f"code {done.returncode}"
    return (
        f"pictures   none: rendering failed ({reason}). On a machine without OpenGL install it "
        f"(Debian: apt install {GL_PACKAGES}), then: taichi-slm render {folder.path}"
    )


def _say(console: Console, text: str) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True)
