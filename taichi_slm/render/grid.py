"""Particles seen from the points of a regular grid, in a plane or in space: a weighted mean over those near."""

from dataclasses import dataclass
from typing import Any

import numpy as np

REACH = 2.0  # radius of the kernel [dx]
INTEGRAL = {2: np.pi / 7.0, 3: 2.0 * np.pi / 21.0}  # of the kernel over its disc or ball of radius 1
FILLED = 0.33  # a grid point counts as metal above this share of a full neighbourhood
FAINT = 1e-6  # with less than this share there is nothing to take a mean of


@dataclass(frozen=True)
class Grid:
    """Grid points and what each of them sees of the particles."""

    axes: tuple[np.ndarray, ...]  # [m], one for each direction
    share: (
        np.ndarray
    )  # of a full neighbourhood, shape [points along each axis]; 1 inside the metal, about 0.5 at its surface
    weights: Any  # sparse, shape [grid points, particles]: rows sum to 1, or are empty where nobody is near

    @property
    def metal(self) -> np.ndarray:
        """Whether each grid point lies in metal."""
        return self.share > FILLED

    def mean(self, values: np.ndarray) -> np.ndarray:
        """``values`` of the particles, shape [n] or [n, components], on the grid; 0 where nobody is near."""
        return np.asarray(self.weights @ values).reshape(*self.share.shape, *values.shape[1:])


def sample(position: np.ndarray, low: np.ndarray, high: np.ndarray, cell: float, spacing: float) -> Grid:
    """A grid of ``cell`` [m] from ``low`` to ``high`` [m] over particles at ``position`` [m], shape [n, dimension].

    ``low`` and ``high`` have shape [dimension]; where they are equal the grid is one point thick. ``spacing`` is
    that of the particles [m].
    """
    from scipy.sparse import csr_array, diags_array
    from scipy.spatial import cKDTree

    axes = tuple(a + cell * np.arange(int(np.ceil((b - a) / cell * (1 - 1e-9))) + 1)
                 for a, b in zip(low, high, strict=True))  # fmt: skip
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    reach = REACH * spacing
    near = ((position > low - reach) & (position < high + cell + reach)).all(axis=1)
    pairs = cKDTree(points).sparse_distance_matrix(cKDTree(position[near]), reach, output_type="ndarray")
    weights = csr_array(
        (_kernel(pairs["v"] / reach), (pairs["i"], np.flatnonzero(near)[pairs["j"]])),
        shape=(len(points), len(position)),
    )
    total = np.asarray(weights.sum(axis=1))
    dimension = position.shape[1]
    share = total / (INTEGRAL[dimension] * REACH**dimension)
    scale = np.divide(1.0, total, out=np.zeros_like(total), where=share > FAINT)
    return Grid(axes, share.reshape([len(axis) for axis in axes]), diags_array(scale) @ weights)


def _kernel(q: np.ndarray) -> np.ndarray:
    """Wendland C2 of q = distance / radius, not normalised."""
    return np.maximum(0.0, 1.0 - q) ** 4 * (4.0 * q + 1.0)
