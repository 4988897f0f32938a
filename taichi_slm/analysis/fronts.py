"""Where and how fast the metal freezes, and how long it was molten; terms in docs/analysis.md.

Particles carry their temperature, so each is followed by its id from snapshot to snapshot; between two snapshots its
temperature is taken as linear in time.
"""

from typing import Any

import numpy as np

from taichi_slm.analysis.gradient import gradient
from taichi_slm.analysis.recording import Moment

Array = np.ndarray


class FrontBook:
    """Follows every particle through melting and freezing; its last freezing counts."""

    def __init__(self, solidus: Array, liquidus: Array) -> None:
        """``solidus`` and ``liquidus`` [K] of each material, shape [materials]."""
        self._solidus, self._liquidus = solidus, liquidus
        self._before: Moment | None = None

    def see(self, moment: Moment) -> None:
        """Take in the next moment."""
        if self._before is None:
            self._start(moment)
        else:
            self._step(self._before, moment)
        self._before = moment

    def _start(self, moment: Moment) -> None:
        count, dimension = int(moment.id.max()) + 1, moment.dimension
        self.molten_time = np.zeros(count)  # above the melting point [s]
        self.melted = np.zeros(count, dtype=int)  # how many times
        self.melted[moment.id[moment.liquid]] = 1
        self.time = np.full(count, np.nan)  # of the last freezing [s]
        self.place = np.full((count, dimension), np.nan)  # [m]
        self.gradient = np.full(count, np.nan)  # [K/m]
        self.rate = np.full(count, np.nan)  # at the melting point [K/s]
        self.cooling = np.full(count, np.nan)  # mean over the freezing range [K/s]
        self.drop = np.full(count, np.nan)  # of the temperature from one snapshot to the next [K]
        self._below_liquidus = np.full(count, np.nan)  # time of the last way down [s]

    def _step(self, old: Moment, new: Moment) -> None:
        _, a, b = np.intersect1d(old.id, new.id, assume_unique=True, return_indices=True)
        dt = new.time - old.time
        able = np.isfinite(old.excess[a]) & (np.maximum(old.excess[a], new.excess[b]) >= 0.0)
        able |= np.isfinite(self._below_liquidus[old.id[a]])  # still on its way to the solidus
        a, b = a[able], b[able]
        if len(a) == 0 or not dt > 0.0:
            return
        ids, before, after = old.id[a], old.excess[a], new.excess[b]
        self.molten_time[ids] += dt * share_above(before, after)
        self.melted[ids[(before < 0.0) & (after >= 0.0)]] += 1

        half = 0.5 * (self._liquidus - self._solidus)[old.material[a]]
        self._below_liquidus[ids[after >= half]] = np.nan
        passed = (before >= half) & (after < half)
        self._below_liquidus[ids[passed]] = old.time + dt * _way(before, after, half)[passed]

        down = (before >= 0.0) & (after < 0.0)
        self.cooling[ids[down]] = np.nan  # of an earlier freezing
        self._freeze(old, new, a[down], b[down])
        through = (before >= -half) & (after < -half)
        ends = old.time + dt * _way(before, after, -half)[through]
        took = ends - self._below_liquidus[ids[through]]
        self.cooling[ids[through]] = 2.0 * half[through] / took
        self._below_liquidus[ids[through]] = np.nan

    def _freeze(self, old: Moment, new: Moment, a: Array, b: Array) -> None:
        """Particles of rows ``a`` before and ``b`` after have passed the melting point on their way down."""
        if len(a) == 0:
            return
        ids, dt = old.id[a], new.time - old.time
        fall = old.temperature[a] - new.temperature[b]
        s = (old.excess[a] / (old.excess[a] - new.excess[b]))[:, None]
        slope = (1.0 - s) * gradient(old.position, old.temperature, a, old.spacing)
        slope += s * gradient(new.position, new.temperature, b, new.spacing)
        self.time[ids] = old.time + s[:, 0] * dt
        self.place[ids] = (1.0 - s) * old.position[a] + s * new.position[b]
        self.gradient[ids] = np.linalg.norm(slope, axis=1)
        self.rate[ids] = fall / dt
        self.drop[ids] = fall

    def table(self, dimension: int) -> dict[str, Any]:
        """The columns of fronts.csv: a row per particle that froze, in the order of time."""
        if self._before is None:
            return {name: np.zeros(0) for name in columns(dimension)}
        rows = np.flatnonzero(np.isfinite(self.time))
        rows = rows[np.argsort(self.time[rows], kind="stable")]
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = np.where(self.gradient[rows] > 0.0, self.rate[rows] / self.gradient[rows], np.nan)
        place = self.place[rows]
        values = {
            "id": rows,
            "time_s": self.time[rows],
            "x_m": place[:, 0],
            "y_m": place[:, 1],
            "z_m": place[:, -1],
            "gradient_K_m": self.gradient[rows],
            "cooling_rate_K_s": self.cooling[rows],
            "cooling_rate_at_front_K_s": self.rate[rows],
            "front_speed_m_s": speed,
            "time_above_melting_s": self.molten_time[rows],
            "times_melted": self.melted[rows],
        }
        return {name: values[name] for name in columns(dimension)}

    def chief(self, dimension: int) -> dict[str, Any]:
        """Median, 10th and 90th percentile of each column, and how well the snapshots resolve the cooling."""
        table = self.table(dimension)
        molten = self.molten_time[self.molten_time > 0.0] if self._before is not None else np.zeros(0)
        names = ("gradient_K_m", "cooling_rate_K_s", "front_speed_m_s")
        return {
            "frozen_particles": len(table["id"]),
            "remelted_particles": int((table["times_melted"] > 1).sum()),
            **{name: percentiles(table[name]) for name in names},
            "time_above_melting_s": percentiles(molten),
            "max_time_above_melting_s": float(molten.max()) if len(molten) else 0.0,
            "median_drop_between_snapshots_K": percentiles(self.drop)["median"] if len(table["id"]) else None,
        }


def columns(dimension: int) -> list[str]:
    """Names of the columns of fronts.csv."""
    return [
        "id", "time_s", "x_m", *(["y_m"] if dimension == 3 else []), "z_m", "gradient_K_m", "cooling_rate_K_s",
        "cooling_rate_at_front_K_s", "front_speed_m_s", "time_above_melting_s", "times_melted",
    ]  # fmt: skip


def share_above(before: Array, after: Array) -> Array:
    """Share of an interval in which a value that runs linearly from ``before`` to ``after`` is not negative."""
    high, low = np.maximum(before, after), np.minimum(before, after)
    crossing = (high >= 0.0) & (low < 0.0)
    share: Array = np.where(low >= 0.0, 1.0, 0.0)
    share[crossing] = (high / np.where(crossing, high - low, 1.0))[crossing]
    return share


def _way(before: Array, after: Array, level: Array) -> Array:
    """Where between ``before`` (0) and ``after`` (1) a line passes ``level``; 0 where it does not fall."""
    falls = before > after
    return np.divide(before - level, before - after, out=np.zeros_like(before), where=falls)


def percentiles(values: Array) -> dict[str, float | None]:
    """Median, 10th and 90th percentile of the finite ``values``; None where there are none."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return {"median": None, "p10": None, "p90": None}
    low, median, high = np.percentile(finite, [10, 50, 90])
    return {"median": float(median), "p10": float(low), "p90": float(high)}
