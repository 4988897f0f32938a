"""The particles of one snapshot as a mesh: in 2-D discs of a particle's area, in 3-D balls of its volume."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.output.snapshots import Snapshot
from taichi_slm.render.frame import Frame

FINE = (
    9.0  # pixels a particle up to which its disc amid others is not drawn, and one at a surface has 8 corners
)
DISC_EDGES = ((FINE, 8), (20.0, 16), (np.inf, 32))  # (up to this many pixels a particle, corners of a disc)
LOOSE, ON_LATTICE = 0.74, 0.52  # half a side of the square behind a particle [dx], was it molten or never
# The square of one at a surface: half a side, and how far it lies towards the metal [dx]. Out of the disc it
# nowhere comes on the outer side: the corners that lie there are within 0.5 dx of its middle.
EDGE, INWARDS = 0.5, 0.5
SQUARE = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
BACKING_SHADE = 0.9
ARROW_CELL, ARROW_LENGTH = 26, 60  # one velocity arrow in a square of this side, the longest one [px]
REACH = 2.1  # [dx]
# Neighbours within reach of a particle inside: a lattice has 12 (2-D) and 32 (3-D), at its surface 8 and 22.
ALL_ROUND = {2: 9, 3: 26}
BALL = """//VTK::Color::Impl
float reach = dot(offsetVCVSOutput.xy, offsetVCVSOutput.xy);
if (reach > 1.0) { discard; }
float shade = 0.62 + 0.38 * sqrt(1.0 - reach);
ambientColor *= shade;
diffuseColor *= shade;
"""  # a disc that faces the camera, shaded like a ball
ARROW = np.array(  # outline of an arrow of length 1 along x
    [[0.0, -0.035], [0.66, -0.035], [0.66, -0.14], [1.0, 0.0], [0.66, 0.14], [0.66, 0.035], [0.0, 0.035]]
)


class Particles:
    """What is drawn of one snapshot; the same for all its pictures but for the colours.

    Discs of the true size leave star-shaped gaps inside the metal, which at a few pixels a particle look like
    a pattern. A square, a little darker, lies behind every particle that has metal on all sides, and fills them;
    at the surface it lies on the side of the metal, so that the outline is that of the true discs. (A square, since
    software draws at the pace of its triangles: two instead of the six of a disc.) Where particles are a few pixels
    wide the square is all that is drawn of those amid such: a fifth of the triangles, and no pattern.
    """

    def __init__(self, snapshot: Snapshot, pixels: float) -> None:
        """Build the mesh of ``snapshot`` for a picture on which a particle is ``pixels`` wide."""
        import pyvista as pv

        position, dx = snapshot.arrays["position"], snapshot.spacing
        self.flat = snapshot.dimension == 2
        if self.flat:
            inside, neighbours = _inside(position, dx)
            amid = inside & neighbours.all_are(inside)
            lattice = inside & (snapshot.arrays["ever_liquid"] == 0)
            tight = lattice & neighbours.all_are(lattice)
            towards = neighbours.direction(position)
            self.backed = np.flatnonzero(inside | towards.any(axis=1))
            corners = next(number for most, number in DISC_EDGES if pixels <= most)
            angle = 2.0 * np.pi * np.arange(corners) / corners
            circle = dx * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            fine = pixels <= FINE
            self.discs = np.flatnonzero(~(amid & fine))
            self.shade = 1.0 if fine else BACKING_SHADE
            self.mesh = polygons(position[self.discs], circle / np.sqrt(np.pi), 0.0)
            half = np.where(inside, np.where(tight, ON_LATTICE, LOOSE), EDGE)[self.backed, None, None]
            middle = position + np.where(inside, 0.0, INWARDS * dx)[:, None] * towards
            self.backing = polygons(middle[self.backed], half * dx * SQUARE, -0.1 * dx)
        else:
            half = np.flatnonzero(position[:, 1] >= 0.0)  # cut open along the track
            still = snapshot.arrays["ever_liquid"][half] == 0  # a melt is too loose to hide what is behind
            inside, neighbours = _inside(position[half], dx)
            amid = inside & neighbours.all_are(inside)
            self.shown = half[~(still & amid & (position[half, 1] > 2.5 * dx))]
            self.radius = dx * (0.75 / np.pi) ** (1 / 3)
            self.mesh = pv.PolyData(position[self.shown].astype(np.float32))

    def draw(self, plotter: Any, colours: np.ndarray) -> None:
        """Add the particles in ``colours``, uint8, shape [all particles, 3]."""
        if self.flat:
            draw_polygons(plotter, self.backing, (self.shade * colours[self.backed]).astype(np.uint8))
            draw_polygons(plotter, self.mesh, colours[self.discs])
            return
        draw_balls(plotter, self.mesh, self.radius, colours[self.shown])


def draw_arrows(
    plotter: Any, position: np.ndarray, velocity: np.ndarray, view: Frame, height: float, fastest: float
) -> None:
    """Arrows along ``velocity`` at ``position`` [m] in the plane of the picture, shape [n, 2] both, one in a square.

    The longest stands for ``fastest``, of the unit of ``velocity``; what is slower than a thirtieth gets none. They
    lie ``height`` [m] in front of the plane.
    """
    cell, longest = ARROW_CELL / view.scale, ARROW_LENGTH / view.scale
    speed = np.linalg.norm(velocity, axis=1)
    picked = np.flatnonzero(speed > 0.03 * fastest)
    if len(picked) == 0:
        return
    squares = np.floor(position[picked] / cell).astype(int)
    off_centre = np.abs(position[picked] / cell - squares - 0.5).max(axis=1)
    order = np.lexsort((off_centre, squares[:, 1], squares[:, 0]))
    _, first = np.unique(squares[order], axis=0, return_index=True)
    chosen = picked[order[first]]
    along = velocity[chosen] * (np.minimum(1.0, fastest / speed[chosen]) * longest / fastest)[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    outline = ARROW[:, 0, None] * along[:, None] + ARROW[:, 1, None] * aside[:, None]
    mesh = polygons(position[chosen], outline, 0.0)
    flat = np.asarray(mesh.points)
    mesh.points = flat[:, :1] * view.right + flat[:, 1:2] * view.up + height * view.towards
    draw_polygons(plotter, mesh, np.full((mesh.n_cells, 3), 20, dtype=np.uint8))


def polygons(position: np.ndarray, outline: np.ndarray, height: float) -> Any:
    """One polygon at each ``position`` [m], shape [n, 2], at z = ``height`` [m].

    ``outline`` [m] holds the corners, shape [corners, 2], or [n, corners, 2] where they differ.
    """
    import pyvista as pv

    corners = outline.shape[-2]
    points = np.full((len(position) * corners, 3), height, dtype=np.float32)
    points[:, :2] = (position[:, None] + outline).reshape(-1, 2)
    faces = np.full((len(position), corners + 1), corners)
    faces[:, 1:] = np.arange(len(points)).reshape(len(position), corners)
    return pv.PolyData(points, faces=faces.ravel())


def draw_polygons(plotter: Any, mesh: Any, colours: np.ndarray) -> None:
    """Add ``mesh`` with one flat colour per cell, uint8, shape [cells, 3]."""
    _add(plotter, mesh, mesh.GetCellData(), colours).GetProperty().LightingOff()


def draw_mesh(plotter: Any, mesh: Any, colours: np.ndarray, lit: bool = False, opacity: float = 1.0) -> None:
    """Add ``mesh`` with a colour per point, uint8, shape [points, 3]; shaded by the plotter's lights if ``lit``."""
    style = _add(plotter, mesh, mesh.GetPointData(), colours).GetProperty()
    style.SetOpacity(opacity)
    if lit:
        style.SetAmbient(0.35)
        style.SetDiffuse(0.7)
        style.SetInterpolationToPhong()
    else:
        style.LightingOff()


def _add(plotter: Any, mesh: Any, data: Any, colours: np.ndarray) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkRenderingCore import vtkActor, vtkDataSetMapper

    data.SetScalars(numpy_to_vtk(np.ascontiguousarray(colours), deep=True))
    mapper = vtkDataSetMapper()
    mapper.SetInputData(mesh)
    mapper.SetScalarMode(1 if data is mesh.GetPointData() else 2)  # colours of points, of cells
    actor = vtkActor()
    actor.SetMapper(mapper)
    plotter.add_actor(actor, render=False, reset_camera=False)
    return actor


def draw_balls(plotter: Any, mesh: Any, radius: float, colours: np.ndarray) -> None:
    """Add a shaded ball of ``radius`` [m] at every point of ``mesh``; colours uint8, shape [points, 3]."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkRenderingCore import vtkActor
    from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLPointGaussianMapper

    mesh.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(colours), deep=True))
    mapper = vtkOpenGLPointGaussianMapper()
    mapper.SetInputData(mesh)
    mapper.SetScaleFactor(radius)
    mapper.SetBoundScale(1.05)  # just around the ball: of what is drawn, what is outside is thrown away again
    mapper.EmissiveOff()
    mapper.SetSplatShaderCode(BALL)
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    plotter.add_actor(actor, render=False, reset_camera=False)


@dataclass(frozen=True)
class Neighbours:
    """Pairs of particles within `REACH`, shape [pairs, 2], each pair once."""

    pairs: np.ndarray

    def direction(self, position: np.ndarray) -> np.ndarray:
        """Unit vectors to the middle of a particle's neighbours, zero without any, shape of ``position``."""
        a, b = self.pairs.T
        apart = position[b] - position[a]
        total = np.stack([np.bincount(a, each, len(position)) - np.bincount(b, each, len(position))
                          for each in apart.T], axis=1)  # fmt: skip
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return np.divide(total, length, out=np.zeros_like(total), where=length > 0.0)

    def all_are(self, marked: np.ndarray) -> np.ndarray:
        """Whether all neighbours of a particle are ``marked``, both of shape [n]."""
        (a, b), count = self.pairs.T, len(marked)
        return np.bincount(a, ~marked[b], count) + np.bincount(b, ~marked[a], count) == 0


def _inside(position: np.ndarray, spacing: float) -> tuple[np.ndarray, Neighbours]:
    """Whether each particle, ``position`` [m] of shape [n, dimension], has metal on all sides; and the neighbours."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(position).query_pairs(REACH * spacing, output_type="ndarray")
    inside = np.bincount(pairs.ravel(), minlength=len(position)) >= ALL_ROUND[position.shape[1]]
    return inside, Neighbours(pairs)
