"""Pictures of what goes on inside a 3-D melt: the section y = 0, the melting surface, streamlines; all close up."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichi_slm.output.snapshots import Snapshot
from taichi_slm.render.frame import ELEVATION, Frame, corners, frame
from taichi_slm.render.grid import sample
from taichi_slm.render.isotherm import PlaneField, draw_isotherms
from taichi_slm.render.paint import Scales, colours, paint
from taichi_slm.render.particles import Particles, draw_arrows, draw_mesh
from taichi_slm.render.volume import Melt, middles, section

BORDER = 0.12  # of a close-up: what is shown around the melt, as a share of its length
CELL = 0.25  # grid spacing of a section [dx]
TUBE = 0.09  # radius of a streamline [dx]
HEAD = (0.8, 0.26)  # length and radius of an arrow head on a streamline [dx]
CLEAR = 0.7  # between the middle of a ball and the melting surface, a little more than its radius [dx]
GLASS = 0.35  # opacity of the melting surface around streamlines


@dataclass(frozen=True)
class Region:
    """Where the melt is in a run, and the box around it that is looked at; all [m], shape [3]."""

    molten: tuple[np.ndarray, np.ndarray]  # lower and upper corner
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, snapshots: list[Snapshot], spacing: float) -> "Region":
        """The box of the melt in ``snapshots``; of the whole scene if nothing melts."""
        points = np.concatenate([s.arrays["position"][liquid(s)] for s in snapshots])
        first = snapshots[0].arrays["position"]
        if not len(points):
            points = first
        # nearly all of it: a single drop of spatter would make the pool small on every picture
        low, high = np.percentile(points, [0.5, 99.5], axis=0)
        around = max(BORDER * float(np.max(high - low)), 4.0 * spacing)
        edge = 0.5 * spacing
        below = np.maximum(low - around, first.min(axis=0) - edge)
        sides = np.minimum(high + around, first.max(axis=0) + edge)
        top = max(high[2] + 2.0 * spacing, sides[2])
        return cls((low, high), below, np.array([*sides[:2], top]))

    def frame(self, kind: str) -> Frame:
        """Where a picture of ``kind`` is taken from: a section from the front, the others from above."""
        low, high = self.low, self.high
        if kind == "cut":
            return frame(corners(low, high) * [1.0, 0.0, 1.0], 0.0, elevation=0.0)
        behind = corners(np.array([low[0], 0.0, low[2]]), high)
        return frame(np.concatenate([behind, corners(*self.molten)]), 0.0, elevation=ELEVATION)

    def holds(self, position: np.ndarray) -> np.ndarray:
        """Whether each ``position`` [m], shape [n, 3], is in the box."""
        return np.asarray(((position >= self.low) & (position <= self.high)).all(axis=1))


def liquid(snapshot: Snapshot) -> np.ndarray:
    """Which particles count as melt, shape [n]."""
    return np.asarray(snapshot.arrays["liquid_fraction"] >= 0.5)


def draw_inside(
    kind: str, plotter: Any, snapshot: Snapshot, region: Region, view: Frame, scales: Scales
) -> None:
    """Add what a picture of ``kind`` shows of ``snapshot``, which is 3-D."""
    if kind == "cut":
        _cut(plotter, snapshot, region, view, scales)
        return
    melt = Melt.of(snapshot, liquid(snapshot) & region.holds(snapshot.arrays["position"]))
    surface = None if melt is None or scales.melting is None else melt.surface(scales.melting)
    if melt is None or surface is None or not surface.n_points:
        _solid(plotter, snapshot, region, view, scales)
        return
    _solid(plotter, snapshot, region, view, scales, np.asarray(surface.points))
    if kind == "isosurface":
        draw_mesh(plotter, surface, colours(kind, surface.points[:, 2], scales), lit=True)
        return
    behind = surface.clip(normal="y", origin=(0.0, 0.0, 0.0), invert=False)
    if behind.n_points:
        plain = np.full((behind.n_points, 3), 0xB4, dtype=np.uint8)
        draw_mesh(plotter, behind, plain, lit=True, opacity=GLASS)
    _streamlines(plotter, melt, scales)


def _solid(
    plotter: Any,
    snapshot: Snapshot,
    region: Region,
    view: Frame,
    scales: Scales,
    surface: np.ndarray | None = None,
) -> None:
    """What is solid in the half behind y = 0, as balls in the colours of the state.

    Balls that would stick through the melting ``surface`` [m], shape [points, 3], are left out.
    """
    from scipy.spatial import cKDTree

    position = snapshot.arrays["position"]
    keep = region.holds(position) & ~liquid(snapshot)
    if surface is not None:
        gap, _ = cKDTree(surface).query(position, distance_upper_bound=CLEAR * snapshot.spacing)
        keep &= np.isinf(gap)
    rest = replace(snapshot, arrays={name: values[keep] for name, values in snapshot.arrays.items()})
    if keep.any():
        Particles(rest, snapshot.spacing * view.scale).draw(plotter, paint("state", rest, scales))


def _streamlines(plotter: Any, melt: Melt, scales: Scales) -> None:
    import pyvista as pv

    lines = melt.lines(scales.flow)
    behind = lines.clip(normal="y", origin=(0.0, 0.0, 0.0), invert=False) if lines.n_points else lines
    if not behind.n_points:
        return
    tubes = behind.extract_surface(algorithm=None).tube(radius=TUBE * melt.spacing, n_sides=8)
    draw_mesh(plotter, tubes, colours("streamlines", tubes.point_data["speed"], scales), lit=True)
    cone = pv.Cone(height=HEAD[0] * melt.spacing, radius=HEAD[1] * melt.spacing, resolution=12)
    heads = middles(lines)
    heads = heads.extract_points(heads.points[:, 1] > 0.0, adjacent_cells=False)
    if heads.n_points:
        shapes = heads.glyph(orient="velocity", scale=False, geom=cone)
        draw_mesh(plotter, shapes, colours("streamlines", shapes.point_data["speed"], scales), lit=True)


def _cut(plotter: Any, snapshot: Snapshot, region: Region, view: Frame, scales: Scales) -> None:
    dx = snapshot.spacing
    low, high = region.low * [1.0, 0.0, 1.0], region.high * [1.0, 0.0, 1.0]
    high[2] = min(high[2], float(snapshot.arrays["position"][:, 2].max()) + 2.0 * dx)
    grid = sample(snapshot.arrays["position"], low, high, CELL * dx, dx)
    temperature = grid.mean(snapshot.arrays["temperature"])
    metal = section(grid, temperature)
    draw_mesh(plotter, metal, colours("cut", metal.point_data["values"], scales))

    flat = (len(grid.axes[0]), len(grid.axes[2]))
    field = PlaneField(
        grid.axes[0], grid.axes[2], np.ma.MaskedArray(temperature, ~grid.metal).reshape(flat).T
    )
    draw_isotherms(plotter, field, view, dx, scales, thin=True)

    molten = liquid(snapshot)
    share = grid.mean(molten.astype(float))
    carried = grid.mean(np.where(molten[:, None], snapshot.arrays["velocity"], 0.0))
    inside = (grid.metal & (share > 0.5)).ravel()
    points = np.stack(
        [axis.ravel() for axis in np.meshgrid(grid.axes[0], grid.axes[2], indexing="ij")], axis=1
    )
    velocity = carried.reshape(-1, 3)[inside][:, [0, 2]] / share.ravel()[inside, None]
    draw_arrows(plotter, points[inside], velocity, view, dx, scales.speed)
