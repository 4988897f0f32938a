"""The volume that particles really take up, which no continuity equation knows: cells of a Voronoi tessellation."""

import numpy as np
from scipy.spatial import ConvexHull, Voronoi


def cell_volumes(position: np.ndarray) -> np.ndarray:
    """Area [m^2] or volume [m^3] of the Voronoi cell of each particle at ``position`` [m], shape [n, dimension].

    NaN where the cell has no end, as at a free surface. The cells of the layer beside these reach into the void
    where a neighbour is missing, so leave the outer two layers out of a mean.
    """
    cells = Voronoi(position)
    flat = position.shape[1] == 2
    volume = np.full(len(position), np.nan)
    for number, region in enumerate(cells.point_region):
        corners = cells.regions[region]
        if corners and -1 not in corners:
            points = cells.vertices[corners]
            volume[number] = _polygon(points) if flat else ConvexHull(points).volume
    return volume


def _polygon(corners: np.ndarray) -> float:
    """Area of a polygon with ``corners`` in order, shape [n, 2]."""
    x, y = corners.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))))
