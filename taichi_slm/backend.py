"""The one place where Taichi is imported, and it is loaded only when a kernel is built.

Modules that define kernels write ``from taichi_slm.backend import ti`` and use ``ti`` inside functions only, so
that importing them (for a stable time step, a docstring, a test of the imports) costs nothing.
"""

import contextlib
import importlib.util
import io
import os
import sys
from types import ModuleType
from typing import Any


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
ti: Any = _lazy("taichi")


def start(arch: str = "cpu", precision: str = "f64", threads: int | None = None, debug: bool = False) -> None:
    """Initialise Taichi: once per simulation; all fields of an earlier one are gone.

    ``precision`` is that of the particle fields; accounts are always f64.
    """
    options: dict[str, Any] = {
        "arch": getattr(ti, arch),
        "default_fp": getattr(ti, precision),
        "default_ip": ti.i32,
        "offline_cache": True,
        "random_seed": 0,  # part of the offline cache's key: fixed, or every start compiles anew
        "log_level": ti.ERROR,
        "debug": debug,
    }
    if threads is not None:
        options["cpu_max_num_threads"] = threads
    with contextlib.redirect_stdout(io.StringIO()):  # Taichi prints a greeting, which is nobody's output
        ti.init(**options)
