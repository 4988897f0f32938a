"""The same runs on a Dask cluster whose workers see the study's folder."""

import logging
import time
from collections.abc import Callable, Sequence
from typing import Any

from taichi_slm.errors import ConfigError
from taichi_slm.study.execute import LOOK_SECONDS, End, Job, Stop, StopFile, perform

CONNECT_SECONDS = 15


def require_dask() -> None:
    """Say what to install where Dask is not there."""
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise ConfigError("--scheduler needs Dask: pip install 'taichi-slm[cluster]'.") from None


def on_cluster(
    address: str, jobs: Sequence[Job], stop: Stop, ended: Callable[[End], None], look: Callable[[], None]
) -> None:
    """As ``on_this_machine``, by the workers of the scheduler at ``address``.

    A worker that dies loses nothing: another one takes its run up, waits until the process of the run has ended
    too, if that still lives, and goes on from where it got. A wish to stop reaches the workers as a file.
    """
    import distributed

    logging.getLogger("distributed").setLevel(logging.ERROR)
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else "no answer"
        raise ConfigError(f"--scheduler {address}: no Dask scheduler answers there: {reason}.") from None
    with client:
        stamp = time.time_ns()  # keys of this call alone: a scheduler remembers those of the last one
        waiting = {
            client.submit(perform, job, StopFile(stop.file), key=f"{job.name}-{stamp}", pure=False): job
            for job in jobs
        }
        while waiting and not stop.at_once():
            if stop.wanted():
                stop.file.touch()
            for future in [each for each in waiting if each.done()]:
                ended(_end(future, waiting.pop(future)))
            look()
            time.sleep(LOOK_SECONDS)


def _end(future: Any, job: Job) -> End:
    """What came of a task: the end of its run, or what the workers died of."""
    if future.status == "finished":
        end: End = future.result()
        return end
    error = future.exception() if future.status == "error" else None
    reason = f"{type(error).__name__}: {error}" if error else "lost by the scheduler"
    return End(job.name, "failed", 1, reason, begun=True)
