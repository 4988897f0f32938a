"""The one place where Taichi is imported, and it is loaded only when a kernel is built; and its threads.

Modules that define kernels write ``from taichi_slm.backend import direct, ti`` and use ``ti`` inside functions only, so
that importing them (for a stable time step, a docstring, a test of the imports) costs nothing.
"""

import contextlib
import ctypes
import functools
import importlib.util
import io
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from taichi_slm.compiler import compiler
from taichi_slm.errors import ConfigError


def _lazy(name: str) -> ModuleType:
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.find_spec(name)
    if spec is None or spec.loader is None:
        raise ModuleNotFoundError(f"{name} is not installed")
    spec.loader = importlib.util.LazyLoader(spec.loader)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
ti: Any = _lazy(compiler())


def start(arch: str = "cpu", precision: str = "f64", threads: int | None = None, debug: bool = False) -> None:
    """Initialise Taichi: once per simulation; all fields of an earlier one are gone.

    ``precision`` is that of the particle fields; accounts are always f64. Raises ConfigError for an ``arch`` that is
    not there.
    """
    options: dict[str, Any] = {
        "arch": getattr(ti, arch),
        "default_fp": getattr(ti, precision),
        "default_ip": ti.i32,
        "offline_cache": True,
        "random_seed": 0,  # part of the offline cache's key: fixed, or every start compiles anew
        "log_level": ti.ERROR,
        "debug": debug,
        "unrolling_limit": 0,  # no warning of the 50 lines that copy a checkpoint
    }
    if threads is not None:
        options["cpu_max_num_threads"] = threads
    if not debug:
        _short_places()
    _give_back_what_is_freed()
    before = _own_threads()
    with contextlib.redirect_stdout(io.StringIO()):  # Taichi prints a greeting, which is nobody's output
        ti.init(**options)
    # Taichi says so on stdout at most, and takes the CPU
    if ti.lang.impl.current_cfg().arch != options["arch"]:
        raise ConfigError(f"--arch {arch}: this machine cannot do that; taichi-slm doctor says what works")
    if arch == "cpu" and threads != 1:
        _spread(_own_threads() - before)


def _give_back_what_is_freed() -> None:
    """Let the C library return the memory of arrays above 4 MB to the system when they are freed.

    By itself glibc keeps what is below 32 MB: 90 bytes a particle of a scene of a million. Others have no such switch.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, 4 << 20)


def _short_places() -> None:
    """Let Taichi keep file and line of what it reads in a kernel, without a drawing of the line.

    It draws every expression, marked and folded to 80 columns, in case that the kernel does not compile. That is a
    fifth of the time of a start. With ``debug`` it does.
    """
    if compiler() == "taichi":
        ti.lang.ast.ast_transformer_utils.ASTTransformerContext.get_pos_info = _place


def _place(context: Any, node: Any) -> str:
    return (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:\n'
        f"{context.src[node.lineno - 1]}\n"
    )


def _own_threads() -> set[int]:
    tasks = Path("/proc/self/task")
    return {int(task.name) for task in tasks.iterdir()} if tasks.is_dir() else set()


def _spread(threads: set[int]) -> None:
    """Give each of Taichi's new threads a processor of its own.

    They sleep between the loops of microseconds that they are woken for, and Linux wakes them where they slept: often
    two on one processor, beside an idle one, until its next balance some milliseconds later.
    """
    if not hasattr(os, "sched_setaffinity"):
        return
    processors = sorted(os.sched_getaffinity(0))
    for number, thread in enumerate(sorted(threads)):
        with contextlib.suppress(OSError):  # it may have ended
            os.sched_setaffinity(thread, {processors[number % len(processors)]})


ON_DEMAND_FROM = 400_000  # particles; below, all of a scene's memory is at most 1 GB, and a step 20 % faster
M_MMAP_THRESHOLD = -3  # of glibc's malloc.h
BLOCK = 64  # particles of a block


class Blocks:
    """Fields of ``count`` particles that take memory by blocks, each when something is first written to it.

    An element that has none reads as zero. In a small scene, and on a device without sparse fields, they are ordinary
    fields; otherwise they are longer than ``count``, by less than a block. Make all before the first kernel runs.
    """

    def __init__(self, count: int):
        self._count = count
        arch = ti.lang.impl.current_cfg().arch
        can = ti.lang.misc.is_extension_supported(arch, ti.extension.sparse)
        self._root = ti.root.pointer(ti.i, -(-count // BLOCK)) if can and count >= ON_DEMAND_FROM else None

    def field(self, kind: Any, width: int | None = None) -> Any:
        """A field of ``kind``, shape [n], or [n, ``width``]."""
        if self._root is None:
            return ti.field(kind, shape=self._count if width is None else (self._count, width))
        made, block = ti.field(kind), self._root.dense(ti.i, BLOCK)
        (block if width is None else block.dense(ti.j, width)).place(made)
        return made

    def vectors(self, dimension: int, kind: Any) -> Any:
        """A field of vectors, shape [n]."""
        if self._root is None:
            return ti.Vector.field(dimension, kind, shape=self._count)
        made = ti.Vector.field(dimension, kind)
        self._root.dense(ti.i, BLOCK).place(made)
        return made


@dataclass(frozen=True)
class Schedule:
    """Which loops run on one thread. On a GPU none does; on a CPU waking the others costs some 30 us a loop.

    ``ordered``: the device is a CPU, whose reductions run in one fixed order; ``one_thread``: nothing is parallel.
    ``serial_below``: rows from which a loop over neighbours pays for a second thread.
    """

    ordered: bool
    one_thread: bool
    serial_below: int

    def alone(self, rows: int) -> bool:
        """Whether a loop over the neighbours of ``rows`` particles runs on one thread."""
        return self.one_thread or (self.ordered and rows < self.serial_below)

    def plain(self, rows: int) -> bool:
        """The same for a loop without an inner one, whose rows cost a tenth."""
        return self.alone(rows // 10)


def direct(kernel: Any) -> Callable[..., None]:
    """The Taichi ``kernel`` with a launch of 3 us instead of 19: put ``@direct`` over ``@ti.kernel``.

    Taichi looks up anew at every launch what it compiled for these template arguments, and checks the others one by
    one. Here that is done once for every set of template arguments: the first launch is Taichi's own, the later ones
    hand the numbers over and start what the first one compiled. Arguments: numbers, templates and contiguous numpy
    arrays, by position; no result. A kernel with any other, every kernel with ``debug``, and those of quadrants,
    whose own launch is short, are launched as ever.
    """
    return _launcher(kernel, contextlib.nullcontext)


def handed_out(kernel: Any) -> Callable[..., None]:
    """`direct` for a loop over neighbours: a thread that has done its rows takes some of those that are left.

    Taichi gives every thread one run of at least 512 rows, so that a loop ends when the slower processor does, and a
    short loop has one. Here a row is a call, for 5 ns more of its time, which is a tenth of a plain loop's and little
    beside neighbours. Sums over rows would depend on who made which: such loops stay plain.
    """
    return _launcher(kernel, _by_row)


@contextlib.contextmanager
def _by_row() -> Iterator[None]:
    """What is compiled in here hands out its rows."""
    options = ti.lang.impl.current_cfg()
    before = options.make_cpu_multithreading_loop, options.random_seed
    # the seed, which no kernel reads, tells the two forms apart in the offline cache: the other option does not
    options.make_cpu_multithreading_loop, options.random_seed = False, 1
    try:
        yield
    finally:
        options.make_cpu_multithreading_loop, options.random_seed = before


def _launcher(kernel: Any, compiling: Callable[[], Any]) -> Callable[..., None]:
    """``kernel``, launched as `direct` says; its first launch for each set of templates happens in ``compiling``."""
    if compiler() != "taichi":
        return _in(compiling, kernel)
    runtime = ti.lang.impl.get_runtime
    sorts = [_sort_of(argument.annotation) for argument in kernel._primal.arguments]
    if None in sorts or kernel._primal.return_type is not None:
        return _in(compiling, kernel)
    templates = [index for index, sort in enumerate(sorts) if sort == "template"]
    values = [index for index, sort in enumerate(sorts) if sort != "template"]
    handed = [(index, (place,), sorts[index]) for place, index in enumerate(values)]
    # by template arguments: program, its kernel, code
    compiled: dict[tuple[Any, ...], tuple[Any, Any, Any]] = {}

    @functools.wraps(kernel)
    def launch(*arguments: Any) -> None:
        key = tuple([arguments[index] for index in templates])
        program, lowered, code = compiled.get(key, (None, None, None))
        # the first launch, or the first after a later ti.init
        if program is not runtime().prog or len(arguments) != len(sorts):
            with compiling():
                kernel(*arguments)
                if not ti.lang.impl.current_cfg().debug:
                    compiled[key] = _compiled(kernel._primal, arguments)
            return
        context = lowered.make_launch_context()
        for index, place, sort in handed:
            value = arguments[index]
            if sort == "integer":
                context.set_arg_int(place, value)
            elif sort == "real":
                context.set_arg_float(place, value)
            else:
                assert value.flags.c_contiguous
                data, size, shape = value.ctypes.data, value.nbytes, value.shape
                context.set_arg_external_array_with_shape(place, data, size, shape, 0)
        program.launch_kernel(code, context)

    return launch


def _in(compiling: Callable[[], Any], kernel: Any) -> Callable[..., None]:
    """Every launch happens in ``compiling``: nobody says which one compiles."""

    @functools.wraps(kernel)
    def launch(*arguments: Any) -> None:
        with compiling():
            kernel(*arguments)

    return kernel if compiling is contextlib.nullcontext else launch


def _sort_of(annotation: Any) -> str | None:
    """What an argument of a kernel is to `direct`; None: something that it does not know."""
    types = ti.types.primitive_types
    if id(annotation) in types.real_type_ids:
        return "real"
    if id(annotation) in types.integer_type_ids:
        return "integer"
    if isinstance(annotation, ti.types.ndarray_type.NdarrayType):
        return "array"
    return "template" if isinstance(annotation, ti.template) else None


def _compiled(primal: Any, arguments: tuple[Any, ...]) -> tuple[Any, Any, Any]:
    """The program, and what it holds of the kernel ``primal`` for the templates among ``arguments``."""
    program = ti.lang.impl.get_runtime().prog
    lowered = primal.compiled_kernels[primal.ensure_compiled(*arguments)]
    return program, lowered, program.compile_kernel(program.config(), program.get_device_caps(), lowered)
