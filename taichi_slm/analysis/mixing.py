"""How far marked particles have mixed with the others, and how far they have gone."""

import numpy as np
from scipy.spatial import cKDTree

REACH = 1.6
"""Particles closer than this [dx] are neighbours: the 8 (2-D) or 18 (3-D) nearest of a lattice."""


def foreign_share(position: np.ndarray, group: np.ndarray, spacing: float) -> np.ndarray:
    """Share of each particle's neighbours that belong to another ``group``, shape [n]; 0 where there is none.

    Particles are at ``position`` [m], shape [n, dimension]. Deep within its own group a particle has 0, at a flat
    interface of two groups 3/8 (2-D lattice), alone among others 1.
    """
    pairs = cKDTree(position).query_pairs(REACH * spacing, output_type="ndarray")
    differ = group[pairs[:, 0]] != group[pairs[:, 1]]
    count = len(position)
    neighbours = np.bincount(pairs.ravel(), minlength=count)
    foreign = np.bincount(pairs[differ].ravel(), minlength=count)
    return np.asarray(foreign / np.maximum(neighbours, 1))


def dispersed(position: np.ndarray, group: np.ndarray, spacing: float) -> float:
    """Share of the marked particles (``group`` > 0) most of whose neighbours are of another group; NaN if none is.

    0 for lumps and for layers at least two particles thick, however sheared; the marked share of all particles, less
    than that from one, when they are stirred at random: see :func:`stirred`.
    """
    marked = group > 0
    return (
        float((foreign_share(position, group, spacing)[marked] > 0.5).mean())
        if marked.any()
        else float("nan")
    )


def stirred(position: np.ndarray, group: np.ndarray, spacing: float, seed: int = 0) -> float:
    """What :func:`dispersed` would be, had the groups been dealt out among the particles at random."""
    return dispersed(position, np.random.default_rng(seed).permutation(group), spacing)
