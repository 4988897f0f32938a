"""One run from config to closing lines: `execute` a new one, `resume` one that stopped."""

import contextlib
import shutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from taichi_slm.config.extent import particles_about
from taichi_slm.config.load import LoadedConfig
from taichi_slm.config.schema import Config
from taichi_slm.errors import (
    BlowUpError,
    ConfigError,
    SlmError,
    StorageError,
)
from taichi_slm.output.atomic import read_json, sweep, write_json
from taichi_slm.output.lock import alone
from taichi_slm.output.numbers import quantity
from taichi_slm.run.checkpoint import Checkpoint, examine, latest_good
from taichi_slm.run.estimate import available_memory, memory_bytes, size_text
from taichi_slm.run.pictures import Draughtsmen
from taichi_slm.run.progress import Progress, clock
from taichi_slm.run.recorder import Recorder
from taichi_slm.run.run_folder import (
    RunFolder,
    package_version,
    provenance,
    source_hash,
)
from taichi_slm.run.stop import STATES, StopRequests
from taichi_slm.run.summary import closing_lines, summarise

if TYPE_CHECKING:
    from taichi_slm.run.simulation import Simulation

MEMORY_MARGIN = 1.15  # the peaks of scenes of 18,000 to 257,000 particles are 0.99 to 1.11 of the estimate


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
    _room(loaded.config)
    folder = RunFolder.create(loaded, out)
    with alone(folder.path), Draughtsmen(folder, loaded.config, threads) as draughtsmen:
        with StopRequests(folder) as requests:
            _say(console, f"run {folder.path}")
            try:
                sim = _build(loaded.config, arch, precision, threads)
            except ConfigError:  # asked for what this machine lacks: nothing is left behind
                shutil.rmtree(folder.path, ignore_errors=True)
                raise
            facts = provenance(
                loaded.config,
                loaded.resolved_text,
                loaded.path,
                sim.scene.materials,
                arch,
                precision,
                threads,
            )
            write_json(folder.provenance, facts)
            recorder = _march(sim, folder, console, began, None, requests)
        return _conclude(recorder, console, draughtsmen)


def resume(path: Path, threads: int | None = None, console: Console | None = None) -> Path:
    """Continue the run in ``path`` from its last good checkpoint, or from its start if it ended before the first."""
    began = time.perf_counter()
    console = console or Console()
    folder = RunFolder.open(path)
    with alone(path):
        facts = read_json(folder.provenance)
        threads = threads if threads is not None else facts.get("threads")
        if folder.status.is_file() and read_json(folder.status).get("state") == "done":
            raise StorageError(f"{path} has run to its end: there is nothing to resume")
        sweep(path)
        checkpoint, damaged = examine(folder.checkpoints)
        for slot in damaged:
            _say(console, f"note: {slot} is damaged and not used")
        if damaged:
            checkpoint = checkpoint or latest_good(folder.checkpoints)
        config = folder.resolved_config(facts)
        with Draughtsmen(folder, config, threads) as draughtsmen:
            with StopRequests(folder) as requests:
                sim = _build(config, facts.get("arch", "cpu"), facts.get("precision", "f64"), threads)
                if facts.get("git") != source_hash():
                    _say(console, f"note: the run was begun by {facts.get('git')}, this is {source_hash()}")
                step, moment = (checkpoint.step, checkpoint.meta["time_s"]) if checkpoint else (0, 0.0)
                facts.setdefault("resumed", []).append(
                    {"step": step, "git": source_hash(), "version": package_version(), "argv": sys.argv}
                )
                write_json(folder.provenance, facts)
                folder.stop.unlink(missing_ok=True)
                _say(console, f"resume {path} from step {step:,}, {quantity(moment, 's')}")
                recorder = _march(sim, folder, console, began, checkpoint, requests)
            return _conclude(recorder, console, draughtsmen)


def _room(config: Config) -> None:
    """Refuse what this machine cannot hold before it is begun: a system out of memory kills, and says nothing."""
    needed = memory_bytes(config, round(particles_about(config)), cold=True)
    free = available_memory()
    if free is not None and MEMORY_MARGIN * needed > free:
        raise StorageError(
            f"not enough memory for this scene: about {size_text(needed)} needed, {size_text(free)} free on this "
            "machine; use a larger spacing or a smaller scene"
        )


def _build(config: Config, arch: str, precision: str, threads: int | None) -> "Simulation":
    from taichi_slm.run.simulation import Simulation  # Taichi starts here, and not for `--help`

    try:
        return Simulation(config, arch=arch, precision=precision, threads=threads)
    except MemoryError as error:
        raise StorageError(
            "not enough memory for this scene: use a larger spacing or a smaller plate"
        ) from error


def _march(
    sim: "Simulation",
    folder: RunFolder,
    console: Console,
    began: float,
    resumed: Checkpoint | None,
    requests: StopRequests,
) -> Recorder:
    """Compile, and step to the end."""
    _say(console, f"{sim.scene.count:,} particles; compiling kernels ...")
    sim.compile()
    _say(console, f"compiled in {sim.compile_time_s:.1f} s")
    if resumed:
        _restore(sim, resumed)
    recorder = Recorder(sim, folder, began, resumed)
    requests.heard = True
    try:
        with Progress(sim.config.title or folder.path.name, sim.config.time.end, console) as progress:
            _loop(sim, recorder, progress, requests)
    except Exception as error:
        with contextlib.suppress(StorageError):  # the first error is the one to report
            _leave(recorder, error)
        raise
    finally:
        recorder.close()
    return recorder


def _restore(sim: "Simulation", resumed: Checkpoint) -> None:
    try:
        sim.restore(resumed.arrays)
    except (KeyError, ValueError) as error:
        raise StorageError(
            f"{resumed.path} does not fit this version of taichi-slm ({error}): resume with the version that "
            "provenance.json names"
        ) from error


def _conclude(recorder: Recorder, console: Console, draughtsmen: Draughtsmen) -> Path:
    """Summary, closing lines, pictures."""
    folder = recorder.folder
    summary = summarise(recorder, "done")
    write_json(folder.summary, summary)
    recorder.write_status("done")
    for line in closing_lines(recorder, summary):
        _say(console, line)
    _say(console, draughtsmen.draw())
    _say(console, f"next       paraview {folder.series}    or    taichi-slm render {folder.path}")
    return folder.path


def _loop(sim: "Simulation", recorder: Recorder, progress: Progress, requests: StopRequests) -> None:
    limit = sim.config.time.wall_limit  # of this process, building and compiling included
    if sim.steps == 0 and (row := recorder.record(paused=True)):
        progress.update(row)
    while not sim.finished:
        before, pause = sim.steps, recorder.next_pause()
        sim.advance(recorder.next_moment(), pause)
        if not sim.finished and requests.reason is None and sim.steps == before:
            raise BlowUpError(f"the time step collapsed: no step was made at {quantity(sim.time, 's')}")
        paused = sim.steps >= pause
        row = recorder.record(paused)
        if row:
            progress.update(row)
        if not paused:
            continue
        if recorder.folder.stop.exists():
            requests.reason = requests.reason or "the file STOP"
        if limit is not None and time.perf_counter() - recorder.began > limit:
            requests.reason = requests.reason or f"the wall limit of {clock(limit)}"
        if requests.reason and not sim.finished:
            recorder.write_checkpoint()
            raise requests.error(f"checkpoint written; resume with: taichi-slm resume {recorder.folder.path}")
    row = recorder.record_last()
    if row:
        progress.update(row)


def _leave(recorder: Recorder, error: Exception) -> None:
    """Write what is known of a run that ends before its end; the last good checkpoint stays as it is."""
    state = STATES.get(type(error), "failed")
    recorder.write_status(state, str(error))
    if isinstance(error, BlowUpError):
        recorder.write_crash()
    if isinstance(error, SlmError):
        write_json(recorder.folder.summary, summarise(recorder, state))


def _say(console: Console, text: str) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True)
