"""Where the beam is and how much power it has, at any time and on average over any step."""

from bisect import bisect_right
from collections import OrderedDict
from math import dist, inf, ulp

import numpy as np
from numpy.typing import NDArray

from taichi_slm.config.schema import Laser, Move
from taichi_slm.errors import ConfigError

Array = NDArray[np.float64]


class BeamPath:
    """The path of a laser: segments, run ``passes`` times from ``start`` on, times a train of pulses.

    All times in s since the start of the simulation. Position is a tuple (x,) in 2-D, (x, y) in 3-D [m].
    Power is the full beam's, before the absorptivity. Every call costs O(log n) in the number of segments
    and does not depend on the number of passes or pulses; only where pulses meet segments of different
    power is the table of one pass (and, for an interval over several passes, of all) made once and kept.
    """

    def __init__(self, laser: Laser, dimension: int):
        self.power = float(laser.power)  # [W]
        self.start = float(laser.start)
        self.passes = laser.passes
        points, durations, fractions = [], [], []
        for number, part in enumerate(laser.path):
            ends = (part.start, part.end) if isinstance(part, Move) else (part.at, part.at)
            if any(len(point) != dimension - 1 for point in ends):
                raise ConfigError(
                    f"laser.path.{number}: a point of a {dimension}-D scene has {dimension - 1} coordinate(s)"
                )
            points.append(ends)
            durations.append(dist(*ends) / part.speed if isinstance(part, Move) else part.duration)
            fractions.append(part.power_fraction)
        self._points = np.asarray(points, dtype=np.float64)  # [n, 2, dimension - 1]
        self._fraction = np.asarray(fractions, dtype=np.float64)
        self._begin = np.concatenate(
            ([0.0], np.cumsum(durations))
        )  # of each segment within a pass, and its end
        self._times: list[float] = self._begin.tolist()
        self._pass = self._times[-1]
        if self._pass <= 0.0:
            raise ConfigError(
                "laser.path: the beam goes nowhere and stays nowhere; give a path that takes time"
            )
        self._duration = self._pass * self.passes
        self.end = self.start + self._duration  # when the whole path is over
        self._on: float = inf
        self._period: float = inf
        if laser.pulse and laser.pulse.off > 0.0:
            self._on, self._period = laser.pulse.on, laser.pulse.on + laser.pulse.off
        self._uniform = bool((self._fraction == self._fraction[0]).all())
        self._energy = np.concatenate(([0.0], np.cumsum(self._fraction * np.diff(self._begin))))
        self._rounding = 8.0 * ulp(max(abs(self.start), self.end))
        self._tables: OrderedDict[int, Array] = OrderedDict()
        self._passes_before: Array | None = None

    def position(self, t: float) -> tuple[float, ...]:
        """Centre of the beam [m]; before the start the first point, after the end the last."""
        tau = t - self.start
        if tau >= self._duration:
            return tuple(self._points[-1, 1].tolist())
        _, local = self._split(max(tau, 0.0))
        k = self._segment(local)
        begin, end = self._points[k]
        span = self._times[k + 1] - self._times[k]
        s = min(max((local - self._times[k]) / span, 0.0), 1.0) if span > 0.0 else 1.0
        return tuple((begin + s * (end - begin)).tolist())

    def power_fraction(self, t: float) -> float:
        """Power at the instant ``t`` over the laser's power."""
        tau = t - self.start
        if not 0.0 <= tau < self._duration:
            return 0.0
        if tau - self._pulses(tau) * self._period >= self._on:
            return 0.0
        return float(self._fraction[self._segment(self._split(tau)[1])])

    def mean_power_fraction(self, t0: float, t1: float) -> float:
        """Exact mean power over [t0, t1], over the laser's power; the value at t0 where t1 = t0."""
        return self._integral(t0, t1) / (t1 - t0) if t1 > t0 else self.power_fraction(t0)

    def energy(self, t0: float, t1: float) -> float:
        """Energy that the beam brings in [t0, t1] [J], before the absorptivity."""
        return self.power * self._integral(t0, t1)

    def on_during(self, t0: float, t1: float) -> bool:
        """Whether the beam has power at any time in [t0, t1]."""
        return self.power > 0.0 and self._integral(t0, t1) > self._rounding * float(self._fraction.max())

    def next_event(self, t: float) -> float:
        """Next time after ``t`` at which power or direction may jump: segment ends, pulse edges; or inf."""
        if t < self.start - self._rounding:
            return self.start
        if t >= self.end - self._rounding:
            return inf
        tau = max(t - self.start, 0.0)
        after = tau + self._rounding
        number, local = self._split(tau)
        k = bisect_right(self._times, local + self._rounding)
        candidates = [self._duration, (number + 1) * self._pass]
        if k < len(self._times):
            candidates.append(number * self._pass + self._times[k])
        elif number + 1 < self.passes:  # at the very end of a pass: its successor's first segment
            candidates.append((number + 1) * self._pass + self._times[bisect_right(self._times, 0.0)])
        if self._period < inf:
            n = self._pulses(tau)
            candidates += [
                n * self._period + self._on,
                (n + 1) * self._period,
                (n + 1) * self._period + self._on,
            ]
        following = min((time for time in candidates if time > after), default=self._duration)
        return self.start + min(following, self._duration)

    def _split(self, tau: float) -> tuple[int, float]:
        """Number of the pass, and the time within it, at tau since the start."""
        number = min(int(tau // self._pass), self.passes - 1)
        return number, min(max(tau - number * self._pass, 0.0), self._pass)

    def _segment(self, local: float) -> int:
        return min(bisect_right(self._times, local), len(self._fraction)) - 1

    def _pulses(self, tau: float) -> int:
        """Number of whole pulse periods before tau."""
        return int(tau // self._period) if self._period < inf else 0

    def _integral(self, t0: float, t1: float) -> float:
        """Time integral of the power fraction over [t0, t1] [s]."""
        tau0, tau1 = (min(max(t - self.start, 0.0), self._duration) for t in (t0, t1))
        if tau1 <= tau0:
            return 0.0
        if self._uniform:
            value = float(self._fraction[0]) * float(
                self._lit(np.float64(tau1)) - self._lit(np.float64(tau0))
            )
            return max(value, 0.0)
        (p0, local0), (p1, local1) = self._split(tau0), self._split(tau1)
        if p0 == p1:
            return max(self._within(p0, local1) - self._within(p0, local0), 0.0)
        between = self._before(p1) - self._before(p0 + 1) if p1 > p0 + 1 else 0.0
        return self._within(p0, self._pass) - self._within(p0, local0) + between + self._within(p1, local1)

    def _lit(self, tau: Array | np.float64) -> Array | np.float64:
        """Time that the pulses are on in [0, tau] [s]."""
        if self._period == inf:
            return tau
        n = np.floor_divide(tau, self._period)
        return n * self._on + np.clip(tau - n * self._period, 0.0, self._on)

    def _within(self, number: int, local: float) -> float:
        """Integral of the fraction over the first ``local`` seconds of pass ``number`` [s]."""
        k = self._segment(local)
        fraction = float(self._fraction[k])
        if self._period == inf:
            return float(self._energy[k]) + fraction * (local - self._times[k])
        offset = number * self._pass
        lit = self._lit(np.float64(offset + local)) - self._lit(np.float64(offset + self._times[k]))
        return float(self._table(number)[k]) + fraction * float(lit)

    def _table(self, number: int) -> Array:
        """Integral of the pulsed fraction at the segment limits of one pass [s], shape [segments + 1]."""
        table = self._tables.get(number)
        if table is None:
            lit = np.diff(np.asarray(self._lit(number * self._pass + self._begin)))
            table = np.concatenate(([0.0], np.cumsum(self._fraction * lit)))
            self._tables[number] = table
            if len(self._tables) > 4:
                self._tables.popitem(last=False)
        return table

    def _before(self, number: int) -> float:
        """Integral of the fraction over all passes before ``number`` [s]."""
        if self._period == inf:
            return number * float(self._energy[-1])
        if self._passes_before is None:
            change = np.flatnonzero(np.diff(self._fraction)) + 1  # equal neighbours count as one segment
            limits = self._begin[np.concatenate(([0], change, [len(self._fraction)]))]
            fraction = self._fraction[np.concatenate(([0], change))]
            rows = max(1, 2_000_000 // len(limits))
            sums = []
            for first in range(0, self.passes, rows):
                offset = np.arange(first, min(first + rows, self.passes)) * self._pass
                sums.append(np.diff(np.asarray(self._lit(offset[:, None] + limits)), axis=1) @ fraction)
            self._passes_before = np.concatenate(([0.0], np.cumsum(np.concatenate(sums))))
        return float(self._passes_before[number])
