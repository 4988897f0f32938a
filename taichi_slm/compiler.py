"""Who compiles the kernels: Taichi, or quadrants, a fork with the same language and a newer LLVM."""

import importlib.util
import os

from taichi_slm.errors import ConfigError

COMPILERS = ("taichi", "quadrants")
VARIABLE = "TAICHI_SLM_KERNELS"


def compiler() -> str:
    """The package that the environment variable TAICHI_SLM_KERNELS names. Raises ConfigError."""
    name = os.environ.get(VARIABLE, "") or COMPILERS[0]
    if name not in COMPILERS:
        raise ConfigError(f"{VARIABLE} is {name}; it may be {' or '.join(COMPILERS)}")
    if name not in installed():
        raise ConfigError(f'{VARIABLE} is {name}, which is not installed: pip install ".[{name}]"')
    return name


def installed() -> list[str]:
    """Those of ``COMPILERS`` that are there."""
    return [name for name in COMPILERS if importlib.util.find_spec(name) is not None]
