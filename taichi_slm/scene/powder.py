"""Powder: where the grains lie. Discs in 2-D, balls in 3-D, resting on a plane at height 0.

A bed is laid by drop and roll (Visscher, Bolsterli 1972, Nature 239, 504): a grain falls at a random place,
rolls without inertia down the grains it meets, along the walls of the bed too, and stays where it is held
up. All moves are arcs with closed-form ends, so that grains touch to round-off and never overlap.
"""

from dataclasses import dataclass
from itertools import combinations
from math import atan2, cos, inf, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from taichi_slm.errors import ConfigError

Array = NDArray[np.float64]

GRAINS_AT_MOST = 20_000
MOVES_AT_MOST = 3000  # of one grain, before it is given up
_TURN = 0.05  # largest angle of an arc on two supports, so that a lost support is noticed [rad]
_TINY = 1e-9


@dataclass(frozen=True)
class Grains:
    """Discs or balls."""

    centre: Array  # [m], shape [n, dimension]
    radius: Array  # [m], shape [n]
    order: NDArray[np.int64]  # number along the row, or in the order of laying, shape [n]


def powder_row(start: float, length: float, radius: float, rows: int, dimension: int) -> Grains:
    """Equal grains that touch each other and the plane, along x from ``start``; in 3-D ``rows`` of them."""
    count = int(length / (2 * radius) + _TINY)
    if count < 1:
        raise ConfigError(f"a powder row of length {length:g} m holds no grain of radius {radius:g} m")
    _refuse_too_many(count * rows)
    x = start + radius * (2 * np.arange(count) + 1)
    if dimension == 2:
        if rows > 1:
            raise ConfigError("a powder row of a 2-D scene has one row of grains")
        centre = np.column_stack((x, np.full(count, radius)))
        return Grains(centre, np.full(count, radius), np.arange(count))
    y = 2 * radius * (np.arange(rows) - 0.5 * (rows - 1))
    order, row = (part.ravel() for part in np.meshgrid(np.arange(count), np.arange(rows), indexing="ij"))
    centre = np.column_stack((x[order], y[row], np.full(count * rows, radius)))
    return Grains(centre, np.full(count * rows, radius), order)


def powder_bed(
    rng: np.random.Generator,
    start: float,
    length: float,
    width: float | None,
    height: float,
    mean: float,
    std: float,
    smallest: float,
    largest: float,
) -> Grains:
    """A bed over [start, start + length], in 3-D (``width`` given) times [-width/2, width/2], lengths in m.

    Radii are normal, cut to [smallest, largest]. A grain that comes to rest above ``height`` is taken away
    again; the bed is full when that happens to 20 grains in a row, plus a quarter of those that lie.
    """
    if smallest > largest:
        raise ConfigError(f"min_radius {smallest:g} m exceeds max_radius {largest:g} m")
    if smallest <= 0.0:
        raise ConfigError("grains of radius 0: give min_radius, or a std_radius below half the mean")
    for name, extent, radius in (
        ("length", length, largest),
        ("width", width, largest),
        ("height", height, smallest),
    ):
        if extent is not None and extent < 2 * radius:
            raise ConfigError(
                f"a powder bed of {name} {extent:g} m does not hold a grain of radius {radius:g} m"
            )
    from scipy.special import ndtr, ndtri  # 0.1 s that only a bed needs

    volume = length * height * (1.0 if width is None else width)
    _refuse_too_many(volume / (2 * mean) ** (2 if width is None else 3))
    half = 0.0 if width is None else 0.5 * width
    bed = _Bed((start, start + length), None if width is None else (-half, half))
    cut = ndtr([(smallest - mean) / std, (largest - mean) / std]) if std > 0.0 else None
    refused = 0
    while refused < 20 + len(bed.radius) // 4:
        radius = mean
        if cut is not None:
            radius = float(np.clip(mean + std * ndtri(rng.uniform(*cut)), smallest, largest))
        x = rng.uniform(start + radius, start + length - radius)
        y = 0.0 if width is None else rng.uniform(radius - half, half - radius)
        place = bed.drop(x, y, radius)
        if place is None or place[2] + radius > height * (1 + _TINY):
            refused += 1
            continue
        bed.lay(place, radius)
        refused = 0
    centre = bed.centre if width is not None else bed.centre[:, [0, 2]]
    return Grains(centre, bed.radius, np.arange(len(bed.radius)))


class _Bed:
    """Grains laid so far, and the rolling of one more. In 2-D all y are 0 and there are no walls in y."""

    def __init__(self, x_range: tuple[float, float], y_range: tuple[float, float] | None):
        self.centre = np.zeros((0, 3))
        self.radius = np.zeros(0)
        # Planes n.p >= d + r: the floor, then the side walls.
        planes = [(0.0, 0.0, 1.0, 0.0), (1.0, 0.0, 0.0, x_range[0]), (-1.0, 0.0, 0.0, -x_range[1])]
        if y_range is not None:
            planes += [(0.0, 1.0, 0.0, y_range[0]), (0.0, -1.0, 0.0, -y_range[1])]
        self._normal = np.array([plane[:3] for plane in planes])
        self._offset = np.array([plane[3] for plane in planes])

    def lay(self, place: Array, radius: float) -> None:
        """Add a grain."""
        self.centre = np.vstack((self.centre, place))
        self.radius = np.append(self.radius, radius)

    def drop(self, x: float, y: float, radius: float) -> Array | None:
        """Where a grain comes to rest that falls at (x, y); None if it does not within MOVES_AT_MOST moves.

        Supports are numbered: planes first, then grains.
        """
        p = np.array([x, y, inf])
        touching: list[int] = []
        for _ in range(MOVES_AT_MOST):
            normals = self._normals(touching, p)
            held, direction = _descend(normals)
            if not held:
                p, support = self._fall(p, radius)
                if support == 0:
                    return p
                touching = [k for k in touching if self._gap(k, p, radius) < _TINY * radius] + [support]
                continue
            if direction is None:
                grains = sum(k >= len(self._offset) for k in touching)
                return p if grains > 1 or len(touching) > 1 else None  # one support alone: balanced on a top
            p, event = self._roll(p, radius, [touching[k] for k in held], direction)
            if event == 0:
                return p
            touching = [k for k in touching if self._gap(k, p, radius) < _TINY * radius]
            if event is not None and event not in touching:
                touching.append(event)
        return None

    def _normals(self, supports: list[int], p: Array) -> Array:
        """Unit normals from the supports to the grain, shape [k, 3]."""
        rows = []
        for k in supports:
            if k < len(self._offset):
                rows.append(self._normal[k])
            else:
                away = p - self.centre[k - len(self._offset)]
                rows.append(away / sqrt(away @ away))
        return np.array(rows).reshape(-1, 3)

    def _gap(self, k: int, p: Array, radius: float) -> float:
        """Distance of a grain at p from support k [m]."""
        planes = len(self._offset)
        if k < planes:
            return float(self._normal[k] @ p - self._offset[k] - radius)
        away = p - self.centre[k - planes]
        return sqrt(float(away @ away)) - float(self.radius[k - planes]) - radius

    def _fall(self, p: Array, radius: float) -> tuple[Array, int]:
        """Straight down to the first support below."""
        reach = (self.radius + radius) ** 2
        beside = ((self.centre[:, :2] - p[:2]) ** 2).sum(axis=1)
        top = self.centre[:, 2] + np.sqrt(np.maximum(reach - beside, 0.0))
        below = (beside < reach * (1 - 1e-12)) & (top <= p[2] + _TINY * radius)
        if not below.any():
            return np.array([p[0], p[1], radius]), 0
        k = int(np.argmax(np.where(below, top, -inf)))
        if top[k] <= radius:
            return np.array([p[0], p[1], radius]), 0
        return np.array([p[0], p[1], top[k]]), k + len(self._offset)

    def _roll(self, p: Array, radius: float, held: list[int], direction: Array) -> tuple[Array, int | None]:
        """Along the arc that the supports ``held`` (a grain, or a grain and something else) leave open.

        Ends at the next support (returned), at the lowest point, at the equator of a lone support, or, on two
        supports, after a small turn (None).
        """
        planes = len(self._offset)
        anchor = self.centre[max(held) - planes]
        middle = anchor
        if len(held) == 2:
            other = min(held)
            axis = self._normal[other] if other < planes else self.centre[other - planes] - anchor
            axis = axis / sqrt(axis @ axis)
            middle = anchor + ((p - anchor) @ axis) * axis
        e = p - middle
        rho = sqrt(e @ e)
        e, t = e / rho, direction / sqrt(direction @ direction)
        lowest = atan2(-t[2], -e[2])
        limit = lowest if len(held) == 2 else min(lowest, atan2(e[2], -t[2]))
        if len(held) == 2:
            limit = min(limit, _TURN)
        # a cos + b sin - k is the distance from a plane, or the excess of the squared one from a grain.
        away = middle - self.centre
        reach = (self.radius + radius) ** 2
        a = np.concatenate((rho * (self._normal @ e), 2 * rho * (away @ e)))
        b = np.concatenate((rho * (self._normal @ t), 2 * rho * (away @ t)))
        flat = self._offset + radius - self._normal @ middle
        k = np.concatenate((flat, reach - (away**2).sum(axis=1) - rho**2))
        angle = _first_crossing(a, b, k, np.concatenate((np.full(planes, radius), reach)))
        angle[held] = inf
        event: int | None = int(np.argmin(angle))
        phi = float(angle[event])
        if phi > limit:
            phi, event = limit, None
        return middle + rho * (cos(phi) * e + sin(phi) * t), event


def _first_crossing(a: Array, b: Array, k: Array, scale: Array) -> Array:
    """Angle in [0, 2 pi) at which a cos + b sin - k first turns negative; inf where it never does."""
    size = np.hypot(a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.mod(np.arctan2(b, a) + np.arccos(k / size), 2 * pi)
    angle[~(np.abs(k) < size)] = inf
    tiny = 1e-11 * scale
    touching, closing = a - k <= tiny, b < -tiny
    angle[touching & closing] = 0.0
    angle[touching & ~closing & ((angle < 1e-6) | (angle > 2 * pi - 1e-6))] = inf
    return angle


def _descend(normals: Array) -> tuple[list[int], Array | None]:
    """Supports that carry a grain, and the direction in which it slides down; None: it rests.

    The direction is gravity projected on the cone of directions that no support blocks: the subset of
    supports with pushes >= 0 that leaves none of the others blocked. No carrying support: it falls.
    """
    down = np.array([0.0, 0.0, -1.0])
    count = len(normals)
    for size in range(min(count, 3) + 1):
        for subset in combinations(range(count), size):
            direction = down
            if size:
                N = normals[list(subset)]
                push = _pushes(N)
                if push is None or min(push) < -1e-12:
                    continue
                direction = down + np.asarray(push) @ N
            if count == 0 or (normals @ direction).min() > -1e-9:
                return list(subset), direction if direction @ direction > 1e-16 else None
    return list(range(count)), None


def _pushes(N: Array) -> tuple[float, ...] | None:
    """Multipliers that take from (0, 0, -1) its parts along the rows of N (normals); None: parallel rows."""
    z = N[:, 2].tolist()
    if len(N) == 1:
        return (z[0],)
    gram = N @ N.T
    if len(N) == 2:
        g = float(gram[0, 1])
        det = 1.0 - g * g
        return None if det < 1e-12 else ((z[0] - g * z[1]) / det, (z[1] - g * z[0]) / det)
    if np.linalg.det(gram) < 1e-12:
        return None
    return tuple(np.linalg.solve(gram, N[:, 2]).tolist())


def _refuse_too_many(count: float) -> None:
    if count > GRAINS_AT_MOST:
        raise ConfigError(
            f"about {count:.3g} grains of powder, more than {GRAINS_AT_MOST:,}; is a unit missing?"
        )
