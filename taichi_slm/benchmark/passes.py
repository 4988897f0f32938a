"""A clock on every pass of a running simulation: launches, rows, seconds."""

import inspect
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from taichi_slm.backend import ti
from taichi_slm.run.simulation import Simulation

# first arguments that say over how many rows a pass runs
_COUNTS_ROWS = ("mobile", "flow", "hot", "count")


@dataclass
class Pass:
    """What was seen of one pass; ``rows`` is None for one that does not run over the rows of the lists."""

    seconds: list[float] = field(default_factory=list)
    rows: list[int] | None = None


class Watch:
    """The passes of ``sim``, found by looking at its parts: a new pass is seen without being named here."""

    def __init__(self, sim: Simulation):
        flow = sim.flow_step.flow if sim.flow_step is not None else None
        self._parts = {"cells": sim.activity.cells, "lists": sim.rows, "ejection": sim.activity.ejection,
                       "flow": flow, "surface": sim.surface, "heat": sim.heat, "laser": sim.bins,
                       "surroundings": sim.heat.surroundings if sim.heat is not None else None,
                       "accounts": sim.accounts.survey}  # fmt: skip
        self.passes: dict[str, Pass] = {}

    def kernels(self) -> Iterator[tuple[str, Any, str, Callable[..., Any]]]:
        """Name of the pass, its owner, the attribute and the kernel."""
        for part, owner in self._parts.items():
            for attribute, value in vars(owner).items() if owner is not None else ():
                if getattr(value, "_is_wrapped_kernel", False):
                    yield f"{part}: {attribute.strip('_')}", owner, attribute, value

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Time every launch in here; each waits for its end."""
        found = list(self.kernels())
        for name, owner, attribute, kernel in found:
            setattr(owner, attribute, self._timed(name, kernel))
        try:
            yield
        finally:
            for _, owner, attribute, kernel in found:
                setattr(owner, attribute, kernel)

    def _timed(self, name: str, kernel: Callable[..., Any]) -> Callable[..., Any]:
        seen = self.passes.setdefault(name, Pass())
        first = next(iter(inspect.signature(kernel).parameters), "")
        if first in _COUNTS_ROWS and seen.rows is None:
            seen.rows = []

        def timed(*arguments: Any) -> Any:
            began = time.perf_counter()
            result = kernel(*arguments)
            ti.sync()
            seen.seconds.append(time.perf_counter() - began)
            if seen.rows is not None:
                seen.rows.append(int(arguments[0]))
            return result

        return timed
