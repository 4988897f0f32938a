"""When something is due: every interval of simulated time, counted from zero, so that nothing drifts."""

import math

TOLERANCE = 1e-9
"""Moments closer than this fraction of an interval are the same moment."""


class Every:
    """Due at 0, ``interval``, 2 ``interval``, ... [s]; each moment is a product, never a sum."""

    def __init__(self, interval: float, after: float | None = None) -> None:
        """Start at time 0, or with the first moment later than ``after`` [s], for a resumed run."""
        self.interval = interval
        self._count = 0 if after is None else math.floor(after / interval + TOLERANCE) + 1

    @property
    def next(self) -> float:
        """The next moment [s]."""
        return self._count * self.interval

    def due(self, time: float) -> bool:
        """Whether ``time`` [s] has reached the next moment; if so, the one after it becomes the next."""
        if time < self.next - TOLERANCE * self.interval:
            return False
        self._count = math.floor(time / self.interval + TOLERANCE) + 1
        return True


def earliest(schedules: list[Every], end: float) -> float:
    """The moment [s] at which the first of ``schedules`` is due, not after ``end`` [s]."""
    moment = min(schedule.next for schedule in schedules)
    slack = TOLERANCE * min(schedule.interval for schedule in schedules)
    return end if moment > end - slack else moment
