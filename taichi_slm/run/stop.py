"""How a run is asked to stop: Ctrl-C, SIGTERM, and what it leaves behind when it has not made a step yet."""

import shutil
import signal
import threading
from types import FrameType, TracebackType
from typing import Any

from taichi_slm.errors import InterruptedRunError, SlmError, StoppedError
from taichi_slm.output.atomic import write_json
from taichi_slm.run.run_folder import RunFolder

STATES: dict[type[Exception], str] = {StoppedError: "stopped", InterruptedRunError: "interrupted"}
"""What status.json calls a run that was stopped by one of these."""


class Leave(BaseException):
    """Out of the preparations, at once; no library's ``except Exception`` may keep it."""


class StopRequests:
    """Turns SIGINT and SIGTERM into a wish to stop; a second Ctrl-C leaves at once.

    The wish is granted at the next moment of the schedule or the next pause: a run that stops only where an
    unbroken one pauses too has the same bits when it is resumed. Before the run is ``heard``, while it is built and
    compiled, there is nothing to save and no pause to come: a ``Leave`` ends that at once.
    """

    def __init__(self, folder: RunFolder) -> None:
        self.folder = folder
        self.reason: str | None = None
        self.heard = False
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
        if kind is not Leave:
            return
        if not self.folder.provenance.is_file():
            shutil.rmtree(self.folder.path, ignore_errors=True)
            raise self.error("before the run began; nothing is left behind") from None
        stopped = self.error(f"before its first step; resume with: taichi-slm resume {self.folder.path}")
        if not self.folder.status.is_file():
            state = {"state": STATES[type(stopped)], "step": 0, "time_s": 0.0, "message": str(stopped)}
            write_json(self.folder.status, state)
        raise stopped from None

    def _ask(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT:
            if self._interrupted:
                raise InterruptedRunError(
                    "left at once on the second Ctrl-C; the last good checkpoint is untouched"
                )
            self._interrupted = True
        self.reason = self.reason or ("Ctrl-C" if number == signal.SIGINT else "SIGTERM")
        if not self.heard:
            raise Leave

    def error(self, what: str) -> SlmError:
        """What to raise once the run may be left; ``what``: in which state it is, and what to do."""
        kind = InterruptedRunError if self._interrupted else StoppedError
        return kind(f"stopped by {self.reason}, {what}")
