"""A study from its file to its table."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from taichi_slm.errors import (
    BlowUpError,
    ConfigError,
    InterruptedRunError,
    SlmError,
    StoppedError,
    StorageError,
)
from taichi_slm.output.atomic import write_json
from taichi_slm.study.collect import collect
from taichi_slm.study.execute import End, Job, Stop, cores, on_this_machine
from taichi_slm.study.folder import StudyFolder, write_if_new
from taichi_slm.study.plan import Plan, with_only
from taichi_slm.study.view import View


def conduct(
    plan: Plan,
    out: Path | None = None,
    jobs: int | None = None,
    threads: int | None = None,
    only: int | None = None,
    retry: bool = False,
    scheduler: str | None = None,
    console: Console | None = None,
) -> Path:
    """Do what is missing of ``plan`` in the folder ``out`` (studies/NAME); table and pictures; the folder.

    ``jobs`` runs at a time, of ``threads`` each: by default as many as cores, which share them. ``only`` is the
    number of the one run to do, without a table. ``scheduler`` is the address of a Dask scheduler.
    Raises what the first failure was, once all else is done.
    """
    console = console or Console()
    chosen = with_only(plan, only)
    folder = StudyFolder.prepare(out or Path("studies") / plan.name)
    if scheduler is not None:
        from taichi_slm.study.cluster import on_cluster, require_dask

        require_dask()
    _write(plan, chosen, folder)
    if only is None:
        folder.stop.unlink(missing_ok=True)
    count = min(jobs or cores(), len(chosen.runs))
    each = threads or (1 if scheduler else max(1, cores() // count))
    names = [run.name for run in chosen.runs]
    todo = [Job(folder.path.resolve(), name, each, plan.arch, plan.precision, retry) for name in names]
    with Stop(folder.stop) as stop, View(plan.title, folder, names, console) as view:
        where = f"on {scheduler}" if scheduler else f"{count} at a time"
        view.say(f"study {folder.path}: {len(names)} runs, {where}, {each} thread(s) each")
        if scheduler is not None:
            on_cluster(scheduler, todo, stop, view.ended, view.look)
        else:
            on_this_machine(todo, count, stop, view.ended, view.look)
    ends = [view.ends[name] for name in names if name in view.ends]
    if only is None:
        for line in collect(plan, folder, {end.name: end for end in ends}):
            view.say(line)
    _judge(ends, len(names), folder, stop.interrupted)
    return folder.path


def _write(plan: Plan, chosen: Plan, folder: StudyFolder) -> None:
    write_if_new(folder.given, plan.text)
    if not folder.plan.is_file() or len(chosen.runs) == len(plan.runs):
        write_json(folder.plan, plan.as_json())
    for run in chosen.runs:
        write_if_new(folder.scene(run.name), run.scene)


def _judge(ends: Sequence[End], count: int, folder: StudyFolder, interrupted: bool) -> None:
    """Raise what is to be said at the end, if not everything is done."""
    failed = [end for end in ends if end.state == "failed"]
    done = sum(end.state == "done" for end in ends)
    if done + len(failed) < count:
        kind = InterruptedRunError if interrupted else StoppedError
        raise kind(
            f"stopped with {done} of {count} runs done; the same command does the rest, in {folder.path}"
        )
    if failed:
        lines = [f"  {end.name}: {end.sentence}" for end in failed[:20]]
        lines += [f"  and {len(failed) - 20} more"] if len(failed) > 20 else []
        text = "\n".join(
            [f"{len(failed)} of {count} runs failed; what they printed is in {folder.logs}:", *lines]
        )
        raise _kind(failed[0].exit_code)(text)


def _kind(code: int) -> type[SlmError]:
    """The error of an exit code; that of a run which died otherwise is 1."""
    kinds: tuple[type[SlmError], ...] = (ConfigError, BlowUpError, StorageError)
    return next((kind for kind in kinds if kind.exit_code == code), SlmError)
