"""Lines of equal temperature: particles smoothed onto a grid with a kernel, contoured inside the metal."""

from dataclasses import dataclass
from typing import Any

import numpy as np

CELL = 0.5  # grid spacing [dx]
REACH = 2.0  # radius of the kernel [dx]
FILLED = 0.33  # a grid point counts as metal above this share of a full neighbourhood


@dataclass(frozen=True)
class PlaneField:
    """A quantity on a regular grid in a plane; masked where there is no metal."""

    across: np.ndarray  # [m], shape [columns]
    up: np.ndarray  # [m], shape [rows]
    values: np.ma.MaskedArray  # shape [rows, columns]

    def lines(self, level: float) -> list[np.ndarray]:
        """Polylines [m], each of shape [points, 2], where the quantity equals ``level``."""
        from contourpy import contour_generator

        if self.values.count() == 0 or not self.values.min() < level < self.values.max():
            return []
        generator: Any = contour_generator(self.across, self.up, self.values)
        return [line for line in generator.lines(level) if len(line) > 1]


def smooth(
    plane: np.ndarray, values: np.ndarray, spacing: float, above: float, distance: np.ndarray | None = None
) -> PlaneField | None:
    """Smooth ``values`` [n] of particles at ``plane`` [m], shape [n, 2], where they exceed ``above``.

    ``distance`` [m], shape [n], is how far a particle lies off the plane (3-D). None if nothing is that warm.
    """
    reach = REACH * spacing
    near = np.ones(len(values), dtype=bool) if distance is None else np.abs(distance) < reach
    warm = near & (values > above)
    if not warm.any():
        return None
    low, high = plane[warm].min(axis=0) - 2 * reach, plane[warm].max(axis=0) + 2 * reach
    near &= ((plane >= low) & (plane <= high)).all(axis=1)
    position, quantity = plane[near], values[near]
    off = np.zeros(len(position)) if distance is None else distance[near]

    cell = CELL * spacing
    columns, rows = np.ceil((high - low) / cell).astype(int) + 1
    home = np.round((position - low) / cell).astype(int)
    steps = np.arange(-int(reach / cell), int(reach / cell) + 1)
    weight_sum = np.zeros(rows * columns)
    value_sum = np.zeros(rows * columns)
    for i in steps:
        for j in steps:
            column, row = home[:, 0] + i, home[:, 1] + j
            inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            gap = (column * cell + low[0] - position[:, 0]) ** 2 + (row * cell + low[1] - position[:, 1]) ** 2
            weight = np.where(inside, _kernel(np.sqrt(gap + off**2) / reach), 0.0)
            index = np.where(inside, row * columns + column, 0)
            weight_sum += np.bincount(index, weight, len(weight_sum))
            value_sum += np.bincount(index, weight * quantity, len(value_sum))
    metal = weight_sum > FILLED * _full(distance is not None)
    grid = np.divide(value_sum, weight_sum, out=np.zeros_like(value_sum), where=metal)
    return PlaneField(
        across=low[0] + cell * np.arange(columns),
        up=low[1] + cell * np.arange(rows),
        values=np.ma.MaskedArray(grid, ~metal).reshape(rows, columns),
    )


def _kernel(q: np.ndarray) -> np.ndarray:
    """Wendland C2 of q = distance / radius, not normalised."""
    return np.maximum(0.0, 1.0 - q) ** 4 * (4.0 * q + 1.0)


def _full(solid_body: bool) -> float:
    """Sum of the kernel over a whole lattice; in 3-D the plane lies half-way between two layers."""
    k = np.arange(-3, 4)
    axes = np.meshgrid(k, k, k - 0.5 if solid_body else [0.0])
    return float(_kernel(np.sqrt(sum(a**2 for a in axes)) / REACH).sum())
