"""Points of the bodies: sites of the scene's one lattice, and droplets on their own.

A site is an integer vector i; its point is (i + 1/2) dx on every axis. Bodies that touch share the lattice,
so no two of their particles are nearer than dx. Arrays of sites have shape [n, dimension], int64; the order
is the first axis slowest, the vertical fastest.
"""

from math import ceil, floor, gamma, pi, prod

import numpy as np
from numpy.typing import NDArray

from taichi_slm.errors import ConfigError

Array = NDArray[np.float64]
Sites = NDArray[np.int64]
Ranges = list[tuple[int, int]]

PARTICLES_AT_MOST = 50_000_000
_SLACK = 1e-6  # of dx: a point this near to a limit counts as on it


def site_points(sites: Sites, dx: float) -> Array:
    """Positions [m] of lattice sites."""
    return np.asarray((sites + 0.5) * dx, dtype=np.float64)


def site_keys(sites: Sites) -> Sites:
    """One integer per site, shape [n]: equal for equal sites."""
    limit = 1 << 20
    if sites.size and np.abs(sites).max() >= limit:
        raise ConfigError(f"a body lies more than {limit:,} spacings from the origin; is a unit missing?")
    keys = np.zeros(len(sites), dtype=np.int64)
    for axis in range(sites.shape[1]):
        keys = (keys << 21) | (sites[:, axis] + limit)
    return keys


def block_ranges(lower: list[float], upper: list[float], dx: float) -> Ranges:
    """Site numbers [first, end) of points with lower <= point < upper, per axis."""
    return [
        (ceil(lo / dx - 0.5 - _SLACK), ceil(hi / dx - 0.5 - _SLACK))
        for lo, hi in zip(lower, upper, strict=True)
    ]


def block_sites(ranges: Ranges) -> Sites:
    """All sites of a block."""
    _refuse_too_many(prod(max(end - first, 0) for first, end in ranges))
    axes = [np.arange(first, end, dtype=np.int64) for first, end in ranges]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(ranges))


def container_sites(inner: Ranges, layers: int) -> Sites:
    """Floor and side walls, ``layers`` thick, corners too, around the block ``inner``; open at the top."""
    outer = [(first - layers, end + layers) for first, end in inner[:-1]] + [
        (inner[-1][0] - layers, inner[-1][1])
    ]
    sites = block_sites(outer)
    first, end = np.array(inner, dtype=np.int64).T
    return sites[~((sites >= first) & (sites < end)).all(axis=1)]


def ball_sites(centre: Array, radius: float, dx: float) -> Sites:
    """Sites whose points lie in the disc or ball."""
    inside = radius + _SLACK * dx
    ranges = [(ceil((c - inside) / dx - 0.5), floor((c + inside) / dx - 0.5) + 1) for c in centre.tolist()]
    sites = block_sites(ranges)
    return sites[((site_points(sites, dx) - centre) ** 2).sum(axis=1) <= inside**2]


def ball_volume(radius: float, dimension: int) -> float:
    """Area of a disc [m^2] or volume of a ball [m^3]."""
    return pi ** (dimension / 2) / gamma(dimension / 2 + 1) * radius**dimension


def droplet(
    centre: Array, radius: float, dx: float, arrangement: str = "lattice", stretch: float = 0.0
) -> tuple[Array, float]:
    """Points [m], shape [n, dimension], and the volume [m^dimension] of each; their sum is exact.

    "lattice": a square or cubic lattice symmetric to the centre. "rings" (2-D): 6 k particles on circle k
    around one in the centre, so that every annulus has the same area per particle, at one spacing between
    and along circles. The spacing departs from dx by the little that makes its square or cube the volume of
    a particle. ``stretch`` e multiplies x by 1 + e and the other axes by (1 + e)^(-1/(dimension - 1)).
    """
    dimension = len(centre)
    volume = ball_volume(radius, dimension)
    _refuse_too_many(volume / dx**dimension)
    if arrangement == "rings":
        if dimension != 2:
            raise ConfigError("arrangement 'rings' exists in 2-D only; use 'lattice'")
        points = _rings(radius, dx)
    else:
        reach = ceil(radius / dx + 1)
        points = site_points(block_sites([(-reach, reach)] * dimension), dx)
        points = points[(points**2).sum(axis=1) <= (radius + _SLACK * dx) ** 2]
        if len(points):
            points = points * ((volume / len(points)) ** (1 / dimension) / dx)
    if not len(points):
        raise ConfigError(f"a droplet of radius {radius:g} m has no particle at spacing {dx:g} m")
    factors = np.full(dimension, (1.0 + stretch) ** (-1.0 / (dimension - 1)))
    factors[0] = 1.0 + stretch
    return centre + points * factors, volume / len(points)


def _rings(radius: float, dx: float) -> Array:
    """Concentric circles: 6 k points on the k-th, which has radius k s; the rim is at (count + 1/2) s."""
    spacing = dx * (3.0 / pi) ** 0.5  # between circles, so that 2 pi s^2/6, the area per particle, is dx^2
    count = max(round(radius / spacing - 0.5), 0)
    step = radius / (count + 0.5)
    points = [np.zeros((1, 2))]
    for k in range(1, count + 1):
        angle = np.arange(6 * k) * (2.0 * pi / (6 * k))
        points.append(k * step * np.column_stack((np.cos(angle), np.sin(angle))))
    return np.concatenate(points)


def _refuse_too_many(count: float) -> None:
    if count > PARTICLES_AT_MOST:
        raise ConfigError(
            f"a body would have about {count:.3g} particles, more than {PARTICLES_AT_MOST:,}; "
            "is a unit missing?"
        )
