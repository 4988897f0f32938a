"""The metal as a field on a grid: where its surface is, finer than the particles, and what it encloses.

Each particle's volume is laid onto a grid of half the spacing and smoothed, so that a lattice gives 1 inside, 0 outside
and 1/2 on a flat surface. A surface of radius R lies SMOOTHING^2/(2 R) too far inwards.
"""

from dataclasses import dataclass

import numpy as np

CELL = 0.5  # of the grid [dx]
SMOOTHING = 0.6  # standard deviation of the Gaussian [dx]: the wiggle of a lattice is then below 0.1 %
MARGIN = 4  # empty cells around


@dataclass(frozen=True)
class MetalField:
    """Share of metal at the points of a grid, shape [along, (across,) up]."""

    axes: tuple[np.ndarray, ...]  # coordinates of the points [m]
    share: np.ndarray
    cell: float  # [m]

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.axes)


def grid_axes(low: np.ndarray, high: np.ndarray, spacing: float) -> tuple[np.ndarray, ...]:
    """Points of a grid over the box from ``low`` to ``high`` [m] with a margin; edges of the lattice are among them."""
    cell = CELL * spacing
    first = np.floor(low / cell).astype(int) - MARGIN
    last = np.ceil(high / cell).astype(int) + MARGIN
    return tuple(cell * np.arange(a, b + 1) for a, b in zip(first, last, strict=True))


def metal_field(
    position: np.ndarray, volume: np.ndarray, axes: tuple[np.ndarray, ...], spacing: float
) -> MetalField:
    """The field of particles at ``position`` [m], shape [n, d], with ``volume`` [m^d], on the grid ``axes``.

    Particles outside the grid are left out; the field is right from MARGIN cells inside its rim on.
    """
    from scipy.ndimage import gaussian_filter

    cell, dimension = CELL * spacing, len(axes)
    shape = tuple(len(axis) for axis in axes)
    place = (position - np.array([axis[0] for axis in axes])) / cell
    inside = ((place >= 0.0) & (place < np.array(shape) - 1)).all(axis=1)
    place, weight = place[inside], volume[inside] / cell**dimension
    home = np.floor(place).astype(int)
    part = place - home
    total = np.zeros(int(np.prod(shape)))
    for corner in np.ndindex(*(2,) * dimension):
        share = np.prod(np.where(np.array(corner) == 1, part, 1.0 - part), axis=1)
        index = np.ravel_multi_index(tuple((home + corner).T), shape)
        total += np.bincount(index, weight * share, len(total))
    smooth = gaussian_filter(total.reshape(shape), SMOOTHING / CELL, mode="constant")
    return MetalField(axes, smooth, cell)


def upper_surface(field: MetalField) -> np.ndarray:
    """Height [m] of the uppermost surface over every column, shape [along, (across)]; NaN where no metal is."""
    return _crossing(field.share, field.axes[-1])


def lower_surface(field: MetalField) -> np.ndarray:
    """Height [m] of the lowest surface in every column, shape [along, (across)]; NaN where no metal is."""
    return -_crossing(field.share[..., ::-1], -field.axes[-1][::-1])


def _crossing(share: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Where, from above, ``share`` first reaches 1/2 along its last axis, linear between two points."""
    full = share >= 0.5
    k = share.shape[-1] - 1 - np.argmax(full[..., ::-1], axis=-1)
    any_metal = full.any(axis=-1)
    above = np.minimum(k + 1, share.shape[-1] - 1)
    inner = np.take_along_axis(share, k[..., None], -1)[..., 0]
    outer = np.take_along_axis(share, above[..., None], -1)[..., 0]
    step = np.divide(inner - 0.5, inner - outer, out=np.zeros_like(inner), where=inner > outer)
    found: np.ndarray = np.where(any_metal, height[k] + step * (height[above] - height[k]), np.nan)
    return found


@dataclass(frozen=True)
class Voids:
    """Empty space that metal encloses on all sides."""

    volume: np.ndarray  # of each, the largest first [m^dimension]
    centre: np.ndarray  # [m], shape [voids, dimension]
    lined: np.ndarray  # whether metal that never melted is among what surrounds it; bool


def enclosed_voids(
    field: MetalField, never_melted: np.ndarray, spacing: float, smallest: float = 1.0
) -> Voids:
    """Regions of ``field`` below 1/2 that do not reach its rim; those below ``smallest`` particles are left out.

    ``never_melted`` is where the particles that never melted are [m], shape [n, dimension].
    """
    from scipy import ndimage
    from scipy.spatial import cKDTree

    from taichi_slm.analysis.gradient import share_beyond

    dimension, cell = field.dimension, field.cell
    label, count = ndimage.label(field.share < 0.5)
    for axis in range(dimension):
        for rim in (0, -1):
            outside = np.unique(np.take(label, rim, axis=axis))
            label[np.isin(label, outside[outside > 0])] = 0
    kept = np.unique(label[label > 0])
    none = Voids(np.zeros(0), np.zeros((0, dimension)), np.zeros(0, dtype=bool))
    if count == 0 or len(kept) == 0:
        return none
    slope = np.stack([np.gradient(0.5 - field.share, cell, axis=k) for k in range(dimension)], axis=-1)
    tree = cKDTree(never_melted) if len(never_melted) else None
    found = []
    boxes = ndimage.find_objects(label)
    for number in kept:
        box = tuple(slice(max(0, s.start - 1), s.stop + 1) for s in boxes[number - 1])
        own = ndimage.binary_dilation(label[box] == number, np.ones((3,) * dimension))
        cells = share_beyond((0.5 - field.share[box])[own], slope[box][own], cell)
        volume = float(cells.sum()) * cell**dimension
        if volume < smallest * spacing**dimension:
            continue
        grid = np.stack(np.meshgrid(*(a[s] for a, s in zip(field.axes, box, strict=True)), indexing="ij"), -1)
        points = grid[label[box] == number]
        lined = tree is not None and bool(
            np.isfinite(tree.query(points, distance_upper_bound=1.5 * spacing)[0]).any()
        )
        found.append((volume, points.mean(axis=0), lined))
    found.sort(key=lambda each: -each[0])
    if not found:
        return none
    return Voids(
        np.array([v for v, _, _ in found]),
        np.array([c for _, c, _ in found]),
        np.array([b for _, _, b in found]),
    )
