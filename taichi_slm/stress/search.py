"""The largest stable multiple: doubling outward from a first guess, then bisection on a logarithmic scale."""

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Bracket:
    """Between ``stable`` and ``unstable`` lies the edge; None where no such multiple was found within the bounds."""

    stable: float | None
    unstable: float | None
    runs: int

    @property
    def width(self) -> float:
        """Unstable over stable, less one; infinite on an open side."""
        return self.unstable / self.stable - 1.0 if self.stable and self.unstable else math.inf


def largest_stable(
    stable: Callable[[float], bool],
    first: float = 1.0,
    lowest: float = 1 / 16,
    highest: float = 8.0,
    bisections: int = 3,
) -> Bracket:
    """Bracket the edge of ``stable(multiple)``, which is taken to hold below it and not above.

    From ``first`` the multiple is doubled while it is stable, or halved until it is; then the bracket of the two is
    halved ``bisections`` times, on a logarithmic scale: 2^(1/8), 9 %, after three.
    """
    below: float | None = None
    above: float | None = None
    runs, multiple = 0, first
    while (below is None or above is None) and lowest * (1 - 1e-9) <= multiple <= highest * (1 + 1e-9):
        runs += 1
        if stable(multiple):
            below, multiple = multiple, 2.0 * multiple if above is None else multiple
        else:
            above, multiple = multiple, 0.5 * multiple if below is None else multiple
    if below is None or above is None:
        return Bracket(below, above, runs)
    for _ in range(bisections):
        middle = math.sqrt(below * above)
        runs += 1
        if stable(middle):
            below = middle
        else:
            above = middle
    return Bracket(below, above, runs)
