"""The slope of a quantity that particles carry, and the share of a cell that lies beyond a level of it."""

import numpy as np
from scipy.spatial import cKDTree

REACH = 2.1
"""Particles closer than this [dx] take part in a fit: 12 in the plane, 32 in space on a lattice."""
SINGULAR = 1e-3
"""Least over largest eigenvalue of a fit below which the neighbours lie on a line or in a plane."""


def gradient(position: np.ndarray, values: np.ndarray, rows: np.ndarray, spacing: float) -> np.ndarray:
    """Slope of ``values`` [unit] at the particles ``rows``, shape [rows, dimension], [unit/m].

    Least squares of a linear function through the particle's own value, over its neighbours at ``position`` [m],
    shape [n, dimension], weighted by (1 - r/R)^2; exact for a linear field wherever they lie. NaN where there are
    too few of them, or all in one line or plane.
    """
    dimension = position.shape[1]
    if len(rows) == 0:
        return np.zeros((0, dimension))
    reach = REACH * spacing
    low, high = position[rows].min(axis=0) - reach, position[rows].max(axis=0) + reach
    near = np.flatnonzero(((position >= low) & (position <= high)).all(axis=1))
    pairs = cKDTree(position[rows]).sparse_distance_matrix(
        cKDTree(position[near]), reach, output_type="ndarray"
    )
    i, j = pairs["i"], near[pairs["j"]]
    offset = (position[j] - position[rows[i]]) / spacing
    weight = (1.0 - pairs["v"] / reach) ** 2
    rise = weight * (values[j] - values[rows[i]])
    matrix = np.zeros((len(rows), dimension, dimension))
    right = np.zeros((len(rows), dimension))
    for a in range(dimension):
        right[:, a] = np.bincount(i, rise * offset[:, a], len(rows))
        for b in range(a + 1):
            sums = np.bincount(i, weight * offset[:, a] * offset[:, b], len(rows))
            matrix[:, a, b] = matrix[:, b, a] = sums
    eigenvalues = np.linalg.eigvalsh(matrix)
    sound = eigenvalues[:, 0] > SINGULAR * np.maximum(eigenvalues[:, -1], 1e-300)
    slope = np.full((len(rows), dimension), np.nan)
    slope[sound] = np.linalg.solve(matrix[sound], right[sound][..., None])[..., 0] / spacing
    return slope


def share_beyond(excess: np.ndarray, slope: np.ndarray, size: float) -> np.ndarray:
    """Share of a cube (square) of edge ``size`` [m] in which a linear quantity is positive, shape [n].

    ``excess`` [unit] is its value at the centre, shape [n], ``slope`` [unit/m] of shape [n, dimension]. Exact for a
    slope along an axis; for a slanted one the true share, a spline, is replaced by the line that has its ends.
    """
    width = np.abs(slope).sum(axis=1) * size
    certain = ~(width > 0.0)  # flat, or no slope known: the centre decides
    ratio = np.divide(excess, width, out=np.where(excess >= 0.0, 0.5, -0.5), where=~certain)
    share: np.ndarray = np.clip(0.5 + ratio, 0.0, 1.0)
    return share
