"""Laser melting of metal powder with smoothed particle hydrodynamics on Taichi.

``from taichi_slm import Simulation, load_config`` is the whole interface of a notebook; both are loaded when
they are first asked for, so that importing the package costs nothing.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichi_slm.config.load import load_config
    from taichi_slm.run.simulation import Simulation

__all__ = ["Simulation", "__version__", "load_config"]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("taichi-slm")
        except PackageNotFoundError:  # a checkout that was never installed
            return "0+unknown"
    if name == "load_config":
        from taichi_slm.config.load import load_config

        return load_config
    if name == "Simulation":
        from taichi_slm.run.simulation import Simulation

        return Simulation
    raise AttributeError(f"module 'taichi_slm' has no attribute '{name}'")
