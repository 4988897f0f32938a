"""The melt pools of a moment, kept apart from each other and from what flies; terms in docs/analysis.md."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from taichi_slm.analysis.gradient import gradient, share_beyond
from taichi_slm.analysis.melt_pool import PIECE, REACH, crossing_pairs, crossing_points, groups
from taichi_slm.analysis.recording import Moment


@dataclass(frozen=True)
class Melt:
    """The liquid of a moment, sorted into connected groups."""

    rows: np.ndarray  # liquid particles of the moment
    tree: cKDTree | None  # of their positions
    group: np.ndarray  # of each of them
    size: np.ndarray  # particles of each group
    resting: np.ndarray  # whether a group touches metal that rests; bool, of each group

    @property
    def flying(self) -> np.ndarray:
        """Rows of the moment that are liquid and touch nothing that rests."""
        return self.rows[~self.resting[self.group]] if len(self.rows) else self.rows


def sort_melt(moment: Moment, on_plate: bool = True) -> Melt:
    """Sort the liquid of ``moment`` into groups, and these into resting and flying ones.

    A group rests if one of its particles touches solid metal that hangs together with plate, wall or a grain that
    never melted. Where no solid is left at all (a free drop) the largest group rests.
    """
    rows = np.flatnonzero(moment.liquid)
    if len(rows) == 0:
        none = np.zeros(0, dtype=int)
        return Melt(rows, None, none, none, none.astype(bool))
    molten = moment.position[rows]
    tree = cKDTree(molten)
    group, size = groups(molten, moment.spacing, tree)
    resting = np.zeros(len(size), dtype=bool)
    ground = moment.position[grounded(moment, on_plate)]
    margin = REACH * moment.spacing
    if len(ground):
        near = ((ground >= molten.min(axis=0) - margin) & (ground <= molten.max(axis=0) + margin)).all(axis=1)
        if near.any():
            distance, _ = cKDTree(ground[near]).query(molten, distance_upper_bound=margin)
            resting[group[np.isfinite(distance)]] = True
    else:
        resting[np.argmax(size)] = True
    return Melt(rows, tree, group, size, resting)


def grounded(moment: Moment, on_plate: bool = True) -> np.ndarray:
    """Rows of the solid that hangs together with metal that never melted, or with the plate."""
    solid = moment.solid
    sure = solid & ~moment.ever_liquid
    if on_plate:
        sure |= solid & (moment.position[:, -1] < 0.0)
    doubtful = solid & ~sure
    if not doubtful.any():
        return np.flatnonzero(sure)
    margin = REACH * moment.spacing
    rows = np.flatnonzero(doubtful)
    group, size = groups(moment.position[rows], moment.spacing)
    low, high = moment.position[rows].min(axis=0) - margin, moment.position[rows].max(axis=0) + margin
    near = sure & ((moment.position >= low) & (moment.position <= high)).all(axis=1)
    joined = np.zeros(len(size), dtype=bool)
    if near.any():
        distance, _ = cKDTree(moment.position[near]).query(moment.position[rows], distance_upper_bound=margin)
        joined[group[np.isfinite(distance)]] = True
    sure[rows[joined[group]]] = True
    return np.flatnonzero(sure)


@dataclass(frozen=True)
class Pool:
    """One melt pool at one time; lengths in m."""

    members: np.ndarray  # rows of its liquid particles
    low: np.ndarray  # lowest coordinates of the melting isotherm and of its particles, shape [dimension]
    high: np.ndarray
    volume: float  # inside the isotherm [m^dimension]

    @property
    def length(self) -> float:
        """Extent along the beam's way [m]."""
        return float(self.high[0] - self.low[0])

    @property
    def width(self) -> float:
        """Extent across it [m]; NaN in 2-D."""
        return float(self.high[1] - self.low[1]) if len(self.low) == 3 else float("nan")

    @property
    def depth(self) -> float:
        """Of the lowest point below height 0 [m], not less than 0."""
        return max(0.0, -float(self.low[-1]))


def find_pools(moment: Moment, melt: Melt) -> list[Pool]:
    """The pools of ``moment``, the largest first: groups that rest, of at least PIECE particles."""
    chosen = [g for g in np.argsort(-melt.size, kind="stable") if melt.resting[g] and melt.size[g] >= PIECE]
    if not chosen or melt.tree is None:
        return []
    molten = moment.position[melt.rows]
    margin = REACH * moment.spacing
    near = ~moment.liquid & np.isfinite(moment.excess) & (moment.excess < 0.0)
    box = (moment.position >= molten.min(axis=0) - margin) & (moment.position <= molten.max(axis=0) + margin)
    solid = np.flatnonzero(near & box.all(axis=1))
    pairs = crossing_pairs(melt.tree, moment.position[solid], moment.spacing) if len(solid) else None
    if pairs is None or len(pairs) == 0:
        return [_whole(moment, melt.rows[melt.group == g]) for g in chosen]

    hot, cold = moment.excess[melt.rows], moment.excess[solid]
    points = crossing_points(molten, hot, moment.position[solid], cold, pairs)
    share = _shares(moment, melt.rows, solid, pairs)
    owner = melt.group[pairs["i"]]
    # A solid particle between two pools is cut by the isotherm of the one that comes first.
    rim, first = np.unique(pairs["j"], return_index=True)
    rim_owner = owner[first]
    pools = []
    for g in chosen:
        members = melt.rows[melt.group == g]
        edge = np.concatenate([moment.position[members], points[owner == g]])
        cut = solid[rim[rim_owner == g]]
        volume = (share[members] * moment.volume[members]).sum() + (share[cut] * moment.volume[cut]).sum()
        pools.append(Pool(members, edge.min(axis=0), edge.max(axis=0), float(volume)))
    return pools


def _whole(moment: Moment, members: np.ndarray) -> Pool:
    position = moment.position[members]
    return Pool(members, position.min(axis=0), position.max(axis=0), float(moment.volume[members].sum()))


def _shares(moment: Moment, liquid: np.ndarray, solid: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Share of every particle's cell inside the isotherm: 1 or 0 but for those that it cuts, shape [n]."""
    share = moment.liquid.astype(float)
    at_edge = np.concatenate([liquid[np.unique(pairs["i"])], solid[np.unique(pairs["j"])]])
    slope = gradient(moment.position, moment.temperature, at_edge, moment.spacing)
    share[at_edge] = share_beyond(moment.excess[at_edge], slope, moment.spacing)
    return share


class PoolBook:
    """Collects a row per pool and time; a pool keeps its number as long as it shares particles with its past."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float | int]] = []
        self._before: list[tuple[int, np.ndarray]] = []  # number and ids of the pools a moment ago
        self._count = 0

    def see(self, moment: Moment, pools: list[Pool]) -> None:
        """Add the ``pools`` of ``moment``."""
        numbers = self._numbers([moment.id[pool.members] for pool in pools])
        self._before = [(n, moment.id[pool.members]) for n, pool in zip(numbers, pools, strict=True)]
        for number, pool in zip(numbers, pools, strict=True):
            self.rows.append(_row(moment, number, pool))

    def _numbers(self, ids: list[np.ndarray]) -> list[int]:
        """The number of each pool: of the past pool with the most common particles, the greatest claim first."""
        claims = sorted(
            (
                (int(np.isin(now, then, assume_unique=True).sum()), -k, number)
                for k, now in enumerate(ids)
                for number, then in self._before
            ),
            reverse=True,
        )
        numbers: dict[int, int] = {}
        taken: set[int] = set()
        for common, k, number in claims:
            if common > 0 and -k not in numbers and number not in taken:
                numbers[-k] = number
                taken.add(number)
        for k in range(len(ids)):
            if k not in numbers:
                self._count += 1
                numbers[k] = self._count
        return [numbers[k] for k in range(len(ids))]

    def table(self, dimension: int) -> dict[str, list[float | int]]:
        """The columns of pools.csv."""
        return {name: [row[name] for row in self.rows] for name in columns(dimension)}

    def chief(self, dimension: int) -> dict[str, float | int | None]:
        """The largest values that any pool had at any time, and how many pools there were."""
        size = "area_m2" if dimension == 2 else "volume_m3"
        names = ["length_m", *(["width_m"] if dimension == 3 else []), "depth_m", size]
        last = max((row["time_s"] for row in self.rows), default=None)
        first = min((row["time_s"] for row in self.rows), default=None)
        largest = {f"max_{name}": max((row[name] for row in self.rows), default=0.0) for name in names}
        return {"pools": self._count, "first_seen_s": first, "last_seen_s": last, **largest}


def columns(dimension: int) -> list[str]:
    """Names of the columns of pools.csv."""
    deep = dimension == 3
    return [
        "time_s", "pool", "particles", "rear_m", "front_m", "length_m", *(["width_m"] if deep else []), "depth_m",
        "height_m", "volume_m3" if deep else "area_m2", "mass_kg" if deep else "mass_kg_m", "mean_temperature_K",
        "max_temperature_K", "mean_speed_m_s", "max_speed_m_s",
    ]  # fmt: skip


def _row(moment: Moment, number: int, pool: Pool) -> dict[str, float | int]:
    deep = moment.dimension == 3
    members = pool.members
    speed = np.linalg.norm(moment.velocity[members], axis=1)
    mass = moment.mass[members]
    return {
        "time_s": moment.time,
        "pool": number,
        "particles": len(members),
        "rear_m": float(pool.low[0]),
        "front_m": float(pool.high[0]),
        "length_m": pool.length,
        "width_m": pool.width,
        "depth_m": pool.depth,
        "height_m": float(pool.high[-1]) + 0.5 * moment.spacing,
        "volume_m3" if deep else "area_m2": pool.volume,
        "mass_kg" if deep else "mass_kg_m": float(mass.sum()),
        "mean_temperature_K": float(np.average(moment.temperature[members], weights=mass)),
        "max_temperature_K": float(moment.temperature[members].max()),
        "mean_speed_m_s": float(np.average(speed, weights=mass)),
        "max_speed_m_s": float(speed.max()),
    }
