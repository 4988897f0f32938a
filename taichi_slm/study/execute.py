"""The runs of a study as processes of the ordinary command `run`; what is done is never done again."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO

from taichi_slm.errors import BlowUpError, InterruptedRunError, StoppedError, StorageError
from taichi_slm.output.atomic import make_folder, storage_error
from taichi_slm.output.lock import take
from taichi_slm.run.checkpoint import find_latest
from taichi_slm.run.run_folder import RunFolder, read_json
from taichi_slm.study.folder import StudyFolder

LOOK_SECONDS = 0.2  # between two looks at a process
PROGRAM = (sys.executable, "-m", "taichi_slm.cli")
STOPPED = (StoppedError.exit_code, InterruptedRunError.exit_code)


@dataclass(frozen=True)
class Job:
    """One run to be done, in words that travel to another machine."""

    study: Path  # absolute
    name: str
    threads: int
    arch: str
    precision: str
    retry: bool = False  # once more, although it left the physical


@dataclass(frozen=True)
class End:
    """How a run ended: done, failed, or stopped (it goes on another time)."""

    name: str
    state: str
    exit_code: int = 0
    sentence: str = ""
    seconds: float = 0.0  # of wall time, now; 0 where nothing was left to do
    begun: bool = False


def standing(folder: RunFolder) -> str:
    """Where a run stands, by its folder alone: missing, done, failed (for good), resumable, or hopeless."""
    try:
        if not folder.path.is_dir() or not any(folder.path.iterdir()):
            return "missing"
        status = read_json(folder.status) if folder.status.is_file() else {}
    except (OSError, StorageError):
        status = {}
    if status.get("state") == "done" and folder.summary.is_file():
        return "done"
    if status.get("state") == "failed" and folder.crash.is_dir():
        return "failed"
    whole = folder.resolved.is_file() and folder.provenance.is_file()
    return "resumable" if whole and find_latest(folder.checkpoints) else "hopeless"


def perform(job: Job, stop: "Stop | StopFile | None" = None) -> End:
    """Bring one run to its end in a process of its own; wherever it stands, and only if nobody else is at it."""
    study = StudyFolder(job.study)
    folder = study.run(job.name)
    with _alone(study.log(job.name), stop) as log:
        if log is None:
            return End(job.name, "stopped", StoppedError.exit_code, "not begun")
        state = standing(folder)
        if state == "done":
            return End(job.name, "done")
        if state == "failed" and not job.retry:
            return End(job.name, "failed", BlowUpError.exit_code, _message(folder))
        if state in ("failed", "hopeless"):
            _set_aside(study, job.name)
        began = time.perf_counter()
        log.seek(0, os.SEEK_END)
        said_before = log.tell()
        process = subprocess.Popen(
            _command(job, study, resume=state == "resumable"),
            stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
            env=os.environ | {"VTK_SMP_MAX_THREADS": str(job.threads), "OMP_NUM_THREADS": str(job.threads)},
        )  # fmt: skip
        code = _wait(process, stop)
        sentence = "" if code == 0 else _last_words(study.log(job.name), said_before, code)
    ended = "done" if code == 0 else "stopped" if code in STOPPED or _asked(stop) else "failed"
    if code and standing(folder) == "done":
        ended, sentence = "done", f"but its pictures may be missing: taichi-slm render {folder.path}"
    return End(job.name, ended, code, sentence, time.perf_counter() - began, begun=True)


def _command(job: Job, study: StudyFolder, resume: bool) -> list[str]:
    threads = ["--threads", str(job.threads)]
    folder = str(study.run(job.name).path)
    if resume:
        return [*PROGRAM, "resume", folder, *threads]
    scene = str(study.scene(job.name))
    machine = ["--arch", job.arch, "--precision", job.precision]
    return [*PROGRAM, "run", scene, "--out", folder, *machine, *threads]


@contextlib.contextmanager
def _alone(path: Path, stop: "Stop | StopFile | None") -> Iterator[BinaryIO | None]:
    """The log of a run, open, once nobody else holds it; None if asked to stop while waiting.

    The lock goes with the open file to the process of the run: should this one die, that one still holds it.
    """
    try:
        with open(path, "ab") as log:
            while not _asked(stop):
                if take(log):
                    yield log
                    return
                time.sleep(LOOK_SECONDS)
            yield None
    except OSError as error:
        raise storage_error("write", path, error) from error


def _set_aside(study: StudyFolder, name: str) -> None:
    make_folder(study.set_aside)
    for attempt in range(1, 10_000):
        target = study.set_aside / f"{name}.{attempt}"
        if not target.exists():
            try:
                study.run(name).path.rename(target)
            except OSError as error:
                raise storage_error("move away", study.run(name).path, error) from error
            return


def _wait(process: "subprocess.Popen[bytes]", stop: "Stop | StopFile | None") -> int:
    """The exit code of ``process``, which is asked to stop when everything is."""
    told = False
    while True:
        try:
            return process.wait(LOOK_SECONDS)
        except subprocess.TimeoutExpired:
            pass
        if stop is not None and stop.at_once():
            process.kill()
        elif _asked(stop) and not told:
            process.terminate()
            told = True


def _asked(stop: "Stop | StopFile | None") -> bool:
    return stop is not None and stop.wanted()


def _message(folder: RunFolder) -> str:
    try:
        return str(read_json(folder.status).get("message") or "it left the physical")
    except StorageError as error:
        return str(error)


def _last_words(log: Path, start: int, code: int) -> str:
    """The last line that a run printed."""
    try:
        lines = log.read_bytes()[start:].decode("utf-8", "replace").strip().splitlines()
    except OSError:
        lines = []
    died = f"killed by signal {-code}" if code < 0 else ""
    return (
        ": ".join(part for part in (died, lines[-1].strip() if lines else "") if part) or f"exit code {code}"
    )


@dataclass(frozen=True)
class StopFile:
    """A wish to stop as a file, which other machines see."""

    path: Path

    def wanted(self) -> bool:
        """Whether to checkpoint and leave."""
        return self.path.exists()

    def at_once(self) -> bool:
        """Never: a file cannot be in a hurry."""
        return False


class Stop:
    """A wish to stop: Ctrl-C, SIGTERM, SIGHUP or ``file``; a second Ctrl-C means at once."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.asked, self._now = threading.Event(), threading.Event()
        self.interrupted = False
        self._previous: dict[int, Any] = {}

    def wanted(self) -> bool:
        """Whether to checkpoint and leave."""
        return self.asked.is_set() or self.file.exists()

    def at_once(self) -> bool:
        """Whether not even to checkpoint."""
        return self._now.is_set()

    def __enter__(self) -> "Stop":
        if threading.current_thread() is threading.main_thread():  # elsewhere Python forbids handlers
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):
                if number := getattr(signal, name, None):
                    self._previous[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _ask(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT:
            if self.interrupted:
                self._now.set()
            self.interrupted = True
        self.asked.set()


def on_this_machine(
    jobs: Sequence[Job], at_a_time: int, stop: Stop, ended: Callable[[End], None], look: Callable[[], None]
) -> None:
    """Do ``jobs``, so many at a time; call ``ended`` with each end and ``look`` a few times a second."""
    with ThreadPoolExecutor(at_a_time) as pool:
        waiting: set[Future[End]] = {pool.submit(perform, job, stop) for job in jobs}
        try:
            while waiting:
                finished, waiting = wait(waiting, LOOK_SECONDS, FIRST_COMPLETED)
                for future in finished:
                    ended(future.result())
                look()
        except BaseException:
            stop.asked.set()  # the others checkpoint and leave, too
            raise


def cores() -> int:
    """CPU cores that this process may use: what Slurm or taskset leave of the machine."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
