"""Which cases there are: every module of ``cases/`` that has a ``CASES``."""

import difflib
import importlib
import pkgutil
from collections.abc import Sequence
from functools import lru_cache

from taichi_slm.errors import ConfigError
from taichi_slm.verification import cases
from taichi_slm.verification.case import Case

GROUPS = {"paper": "Cases of the paper", "exact": "Exact answers", "measured": "Measured melt pools"}
TIERS = ("quick", "full", "long")


@lru_cache(maxsize=1)
def all_cases() -> tuple[Case, ...]:
    """Every case, by group, then by the name of its file."""
    found: list[Case] = []
    for module in pkgutil.iter_modules(cases.__path__):
        found += getattr(importlib.import_module(f"{cases.__name__}.{module.name}"), "CASES", ())
    return tuple(sorted(found, key=lambda case: list(GROUPS).index(case.group)))


def chosen(names: Sequence[str], longest: str = "long") -> tuple[Case, ...]:
    """The cases of those names, or all whose tier is at most ``longest``; a ConfigError for a name that is none."""
    if not names:
        return tuple(case for case in all_cases() if TIERS.index(case.tier) <= TIERS.index(longest))
    known = {case.name: case for case in all_cases()}
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            raise ConfigError(
                f"there is no case '{name}'"
                + (f"; did you mean '{near[0]}'?" if near else "")
                + " `taichi-slm verify --list` shows them all"
            )
    return tuple(known[name] for name in names)
