"""Size of the melt pool, finer than the particle spacing: the pool ends where T crosses the melting point."""

import math
from dataclasses import asdict, dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

REACH = 1.5
"""Particles closer than this [dx] are neighbours: faces and edges of a lattice, not the next but one."""


@dataclass(frozen=True)
class MeltPool:
    """The largest connected group of liquid particles; lengths in m, all 0 where nothing is liquid."""

    length: float = 0.0
    """Extent along x [m]."""
    width: float | None = None
    """Extent along y [m]; None in 2-D."""
    depth: float = 0.0
    """Of its lowest point below the original surface [m]."""
    particles: int = 0
    """Liquid particles of the pool."""
    spatter: int = 0
    """Liquid particles of all smaller groups."""
    groups: int = 0
    """Groups of liquid particles, the pool included."""
    x_range: tuple[float, float] = (math.nan, math.nan)
    """Least and greatest x [m]; NaN where nothing is liquid."""
    lowest: float = math.nan
    """Height of its lowest point [m]."""


def measure(
    position: np.ndarray,
    temperature: np.ndarray,
    liquid_fraction: np.ndarray,
    melting_temperature: float | np.ndarray,
    spacing: float,
    surface_height: float = 0.0,
) -> MeltPool:
    """Measure the pool of particles at ``position`` [m], shape [n, dimension]; other arrays have shape [n].

    ``melting_temperature`` [K] is where the liquid fraction is a half: a number, or one per particle
    (infinite for what never melts). The edge is the set of points where T, linear between a liquid particle
    and a neighbour that is not, equals it; its error is of second order in the spacing.
    """
    excess = temperature - melting_temperature
    liquid = (excess >= 0.0) & (liquid_fraction >= 0.5)
    width = None if position.shape[1] == 2 else 0.0
    if not liquid.any():
        return MeltPool(width=width)
    molten = position[liquid]
    tree = cKDTree(molten)
    labels, sizes = groups(molten, spacing, tree)
    largest = int(np.argmax(sizes))
    members = labels == largest

    # Only what lies within reach of the pool can share an edge with it.
    low, high = molten[members].min(axis=0), molten[members].max(axis=0)
    margin = REACH * spacing
    near = ~liquid & (excess < 0.0) & np.isfinite(excess)
    near &= ((position >= low - margin) & (position <= high + margin)).all(axis=1)
    edge = molten[members]
    if near.any():
        pairs = crossing_pairs(tree, position[near], spacing)
        pairs = pairs[members[pairs["i"]]]
        points = crossing_points(molten, excess[liquid], position[near], excess[near], pairs)
        edge = np.concatenate([edge, points])
    low, high = edge.min(axis=0), edge.max(axis=0)
    return MeltPool(
        length=float(high[0] - low[0]),
        width=None if width is None else float(high[1] - low[1]),
        depth=max(0.0, surface_height - float(low[-1])),
        particles=int(sizes[largest]),
        spatter=int(len(molten) - sizes[largest]),
        groups=len(sizes),
        x_range=(float(low[0]), float(high[0])),
        lowest=float(low[-1]),
    )


def crossing_pairs(molten: cKDTree, solid: np.ndarray, spacing: float) -> np.ndarray:
    """Neighbours of which one is liquid and one is not: fields ``i`` (liquid), ``j`` (not), ``v`` (distance [m])."""
    pairs: np.ndarray = molten.sparse_distance_matrix(cKDTree(solid), REACH * spacing, output_type="ndarray")
    return pairs


def crossing_points(
    molten: np.ndarray, hot: np.ndarray, solid: np.ndarray, cold: np.ndarray, pairs: np.ndarray
) -> np.ndarray:
    """Where the melting isotherm crosses each of ``pairs`` [m], shape [pairs, dimension].

    ``hot`` (not negative) and ``cold`` (negative) are temperatures above the melting point [K], linear in between.
    """
    above, below = hot[pairs["i"]], cold[pairs["j"]]
    start = molten[pairs["i"]]
    points: np.ndarray = start + (above / (above - below))[:, None] * (solid[pairs["j"]] - start)
    return points


def groups(
    position: np.ndarray, spacing: float, tree: cKDTree | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Connected groups of particles at ``position``, shape [n, dimension].

    Returns the group of each particle, shape [n], and the size of each group.
    """
    count = len(position)
    if count == 0:
        return np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int64)
    pairs = (tree or cKDTree(position)).query_pairs(REACH * spacing, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    number, labels = connected_components(links, directed=False)
    return labels, np.bincount(labels, minlength=number)


@dataclass(frozen=True)
class Track:
    """What was melted and is solid again; a particle fills its cell, so lengths include half a spacing."""

    length_m: float = 0.0
    """Extent along x [m]."""
    width_m: float | None = None
    """Extent along y [m]; None in 2-D."""
    depth_m: float = 0.0
    """Of its lowest point below the plate's surface [m]."""
    mean_height_m: float = 0.0
    """Of its upper edge over the plate's surface [m]."""
    roughness_m: float = 0.0
    """Standard deviation of that edge along the track [m]."""
    particles: int = 0
    """Those of the track."""
    unmelted_powder: int = 0
    """Particles above the plate's surface that never melted."""
    pieces: int = 0
    """Connected groups of solid particles, crumbs left out; 1: powder and plate are one."""
    still_liquid: int = 0
    """Particles that are not solid yet."""

    def as_dict(self) -> dict[str, float | int | None]:
        """The fields by name, for summary.json."""
        return asdict(self)


PIECE = 10
"""Fewer connected particles than this are crumbs, not a piece."""


def solid_track(
    position: np.ndarray,
    liquid_fraction: np.ndarray,
    ever_liquid: np.ndarray,
    spacing: float,
    wall: np.ndarray | None = None,
    surface_height: float = 0.0,
) -> Track:
    """Measure the re-solidified track: particles that have been liquid and are not any more.

    ``position`` [m] has shape [n, dimension], the other arrays shape [n]; ``ever_liquid`` and ``wall`` are
    true or false. Particles of a ``wall`` belong to no track.
    """
    part = np.ones(len(position), dtype=bool) if wall is None else ~wall.astype(bool)
    solid = part & (liquid_fraction < 0.5)
    frozen = solid & ever_liquid.astype(bool)
    powder = solid & ~ever_liquid.astype(bool) & (position[:, -1] > surface_height)
    width = None if position.shape[1] == 2 else 0.0
    counts = {
        "unmelted_powder": int(powder.sum()),
        "pieces": int((groups(position[solid], spacing)[1] >= PIECE).sum()),
        "still_liquid": int((part & ~solid).sum()),
    }
    if not frozen.any():
        return Track(width_m=width, **counts)
    track = position[frozen]
    labels, sizes = groups(track, spacing)
    track = track[labels == np.argmax(sizes)]
    low, high = track.min(axis=0), track.max(axis=0)
    heights = _upper_edge(track, spacing)
    return Track(
        length_m=float(high[0] - low[0] + spacing),
        width_m=None if width is None else float(high[1] - low[1] + spacing),
        depth_m=max(0.0, surface_height - float(low[-1] - 0.5 * spacing)),
        mean_height_m=float(heights.mean() - surface_height),
        roughness_m=float(heights.std()),
        particles=len(track),
        **counts,
    )


def _upper_edge(position: np.ndarray, spacing: float) -> np.ndarray:
    """Highest point [m] of each column two spacings wide along x; a column without a particle is left out."""
    column = np.floor((position[:, 0] - position[:, 0].min()) / (2.0 * spacing)).astype(int)
    top = np.full(column.max() + 1, -np.inf)
    np.maximum.at(top, column, position[:, -1])
    return top[np.isfinite(top)] + 0.5 * spacing
