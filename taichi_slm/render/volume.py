"""What particles in 3-D enclose, as VTK meshes: sections, surfaces of equal temperature, streamlines."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.output.snapshots import Snapshot
from taichi_slm.render.grid import FILLED, Grid, sample

CELL = 0.5  # grid spacing [dx]
AROUND = 3.0  # the grid reaches this far beyond the melt [dx]
LIQUID_SHARE = 0.4  # of what a grid point sees: a streamline needs more melt than this around it
SEEDS = 240  # streamlines start from about this many points, on a lattice
SHORTEST = 3.0  # a streamline worth drawing [dx]
CARRIED = ("speed", "velocity")  # what streamlines know at each point
STEP = 0.1  # of a streamline, largest [dx]
STILL = 0.01  # share of the scale's speed below which a streamline ends


def isosurface(grid: Grid, values: np.ndarray, level: float) -> Any:
    """The surface within the metal on which ``values`` on ``grid`` equal ``level``, as pyvista's PolyData [m]."""
    image = _image(grid, share=grid.share, values=values)
    surface = image.contour([level], scalars="values", compute_normals=True)
    if not surface.n_points:
        return surface
    # where the metal ends, values fall to nothing: what the contour finds there is no part of the surface
    return surface.clip_scalar(scalars="share", value=FILLED, invert=False)


def streamlines(
    grid: Grid, velocity: np.ndarray, inside: np.ndarray, seeds: np.ndarray, step: float, slowest: float
) -> Any:
    """Lines along ``velocity`` [m/s] on ``grid`` through ``seeds`` [m], shape [n, 3], both ways, with their ``speed``.

    They end where they leave the grid cells whose corners are all ``inside``, and where the speed falls below
    ``slowest`` [m/s]. The integrator is Runge and Kutta's of order 4 and 5, its steps at most ``step`` [m].
    """
    import pyvista as pv
    from vtkmodules.vtkFiltersFlowPaths import vtkStreamTracer

    image = _image(
        grid, velocity=velocity, speed=np.linalg.norm(velocity, axis=-1), inside=inside.astype(float)
    )
    domain = image.threshold(0.5, scalars="inside", all_scalars=True)
    if domain.n_cells == 0 or len(seeds) == 0:
        return pv.PolyData()
    domain.set_active_vectors("velocity")
    tracer = vtkStreamTracer()
    tracer.SetInputData(domain)
    tracer.SetSourceData(pv.PolyData(seeds))
    tracer.SetIntegratorTypeToRungeKutta45()
    tracer.SetIntegrationDirectionToBoth()
    tracer.SetIntegrationStepUnit(1)  # lengths, not cells
    tracer.SetInitialIntegrationStep(0.5 * step)
    tracer.SetMinimumIntegrationStep(0.01 * step)
    tracer.SetMaximumIntegrationStep(step)
    tracer.SetMaximumError(1e-3 * step)
    extent = [float(np.ptp(axis)) for axis in grid.axes]
    tracer.SetMaximumPropagation(3.0 * sum(extent))
    tracer.SetMaximumNumberOfSteps(5000)
    tracer.SetTerminalSpeed(slowest)
    return _result(tracer)


def section(grid: Grid, values: np.ndarray) -> Any:
    """The metal in the plane of a ``grid`` that is one point thick along y, with ``values`` at its points."""
    flat = _image(grid, share=grid.share, values=values)
    return flat.clip_scalar(scalars="share", value=FILLED, invert=False)


@dataclass(frozen=True)
class Melt:
    """The melt of a 3-D snapshot and what is around it, on a grid."""

    grid: Grid
    temperature: np.ndarray  # [K], shape of the grid
    velocity: np.ndarray  # of the liquid [m/s], shape of the grid + [3]
    liquid: np.ndarray  # share of liquid in what a point sees, shape of the grid
    spacing: float  # of the particles [m]

    @classmethod
    def of(cls, snapshot: Snapshot, liquid: np.ndarray) -> "Melt | None":
        """From a ``snapshot`` whose ``liquid`` particles, bool, shape [n], are marked; None if there are none."""
        if not liquid.any():
            return None
        arrays, dx = snapshot.arrays, snapshot.spacing
        position = arrays["position"]
        # the pool and not its spatter, which would make the grid as large as the scene
        low, high = np.percentile(position[liquid], [0.5, 99.5], axis=0)
        grid = sample(position, low - AROUND * dx, high + AROUND * dx, CELL * dx, dx)
        share = grid.mean(liquid.astype(float))
        carried = grid.mean(np.where(liquid[:, None], arrays["velocity"], 0.0))
        velocity = np.divide(
            carried, share[..., None], out=np.zeros_like(carried), where=share[..., None] > 1e-3
        )
        return cls(grid, grid.mean(arrays["temperature"]), velocity, share, dx)

    def surface(self, level: float) -> Any:
        """Where the metal is at ``level`` [K]."""
        return isosurface(self.grid, self.temperature, level)

    def lines(self, fastest: float) -> Any:
        """Streamlines of the melt with ``speed`` and ``velocity`` [m/s]; ``fastest`` [m/s] says what is still."""
        inside = self.grid.metal & (self.liquid > LIQUID_SHARE)
        every = max(2, int(np.ceil((inside.sum() / SEEDS) ** (1 / 3))))
        chosen = np.zeros_like(inside)
        chosen[every // 2 :: every, every // 2 :: every, every // 2 :: every] = True
        seeds = np.argwhere(inside & chosen)
        points = np.stack([axis[k] for axis, k in zip(self.grid.axes, seeds.T, strict=True)], axis=1)
        dx = self.spacing
        found = streamlines(self.grid, self.velocity, inside, points, STEP * dx, STILL * fastest)
        return _long_enough(found, SHORTEST * dx)


def _image(grid: Grid, **fields: np.ndarray) -> Any:
    """The grid as pyvista's ImageData with ``fields``: shape of the grid, or that + [components]."""
    import pyvista as pv

    cell = next(float(axis[1] - axis[0]) for axis in grid.axes if len(axis) > 1)
    image = pv.ImageData(
        dimensions=[len(axis) for axis in grid.axes],
        spacing=(cell, cell, cell),
        origin=tuple(float(axis[0]) for axis in grid.axes),
    )
    for name, values in fields.items():  # VTK counts along x first
        ordered = values.reshape(*grid.share.shape, -1).transpose(2, 1, 0, 3)
        image.point_data[name] = ordered.reshape(-1, *values.shape[3:])
    return image


def _result(algorithm: Any) -> Any:
    import pyvista as pv

    algorithm.Update()
    return pv.wrap(algorithm.GetOutput())


def middles(lines: Any) -> Any:
    """The middle point of each of ``lines``, as a mesh of points with their ``speed`` and ``velocity`` [m/s]."""
    import pyvista as pv

    index = [members[len(members) // 2] for members in _members(lines)]
    mesh = pv.PolyData(np.asarray(lines.points)[index])
    for name in CARRIED:
        mesh.point_data[name] = lines.point_data[name][index]
    return mesh


def _long_enough(lines: Any, shortest: float) -> Any:
    """Those of ``lines`` that are at least ``shortest`` [m] long."""
    import pyvista as pv

    kept: list[np.ndarray] = []
    for members in _members(lines):
        steps = np.diff(lines.points[members], axis=0)
        if np.linalg.norm(steps, axis=1).sum() >= shortest:
            kept.append(np.append(len(members), members))
    if not kept:
        return pv.PolyData()
    mesh = pv.PolyData(lines.points, lines=np.concatenate(kept))
    for name in CARRIED:
        mesh.point_data[name] = lines.point_data[name]
    return mesh


def _members(lines: Any) -> Iterator[np.ndarray]:
    """The numbers of the points of each line, in order."""
    cells = np.asarray(lines.lines) if lines.n_points else np.zeros(0, dtype=int)
    start = 0
    while start < len(cells):
        end = start + 1 + cells[start]
        yield cells[start + 1 : end]
        start = end
