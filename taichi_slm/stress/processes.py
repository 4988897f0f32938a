"""Searches in processes of their own, side by side; a line for every run as it ends."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from taichi_slm.benchmark.measure import in_its_own_process


def side_by_side(
    function: str, plan: Mapping[str, Mapping[str, Any]], jobs: int, tell: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """The results of ``function`` for every set of arguments in ``plan``, in its order; ``jobs`` at a time."""

    def one(name: str) -> dict[str, Any]:
        return in_its_own_process(function, tell=lambda line: tell(f"{name}: {line}"), **plan[name])

    with ThreadPoolExecutor(jobs) as pool:
        return dict(zip(plan, pool.map(one, plan), strict=True))
