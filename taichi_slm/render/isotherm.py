"""Lines of equal temperature: particles smoothed onto a grid with a kernel, contoured inside the metal."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.render.frame import FOOTER, MARGIN, Frame
from taichi_slm.render.grid import REACH, sample
from taichi_slm.render.overlay import dots_of, draw_text
from taichi_slm.render.paint import Scales

CELL = 0.7  # grid spacing [dx]
THIN_STEP = 500.0  # between the thin isotherms [K]
LABEL = (84.0, 26.0)  # width and height of a label [px]
LABELLED = 150  # isotherms at least this wide carry their temperature [px]


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


def smooth(position: np.ndarray, values: np.ndarray, spacing: float, above: float) -> PlaneField | None:
    """Smooth ``values`` [n] of particles at ``position`` [m], shape [n, dimension], where they exceed ``above``.

    In 3-D the plane is y = 0. None if nothing near it is that warm.
    """
    reach = REACH * spacing
    low, high = np.zeros(position.shape[1]), np.zeros(position.shape[1])
    warm = values > above
    if len(low) == 3:
        warm = warm & (np.abs(position[:, 1]) < reach)
    if not warm.any():
        return None
    ends = [0, -1]
    low[ends] = position[warm][:, ends].min(axis=0) - 2 * reach
    high[ends] = position[warm][:, ends].max(axis=0) + 2 * reach
    grid = sample(position, low, high, CELL * spacing, spacing)
    shape = (len(grid.axes[0]), len(grid.axes[-1]))
    field = np.ma.MaskedArray(grid.mean(values), ~grid.metal).reshape(shape)
    return PlaneField(across=grid.axes[0], up=grid.axes[-1], values=field.T)


def draw_isotherms(
    plotter: Any, field: PlaneField, view: Frame, spacing: float, scales: Scales, thin: bool
) -> None:
    """The melting point as a thick line on ``field``, and the round temperatures as ``thin`` ones, with labels."""
    if scales.melting is None:
        return
    if thin:
        taken: list[tuple[float, float]] = []
        for level in np.arange(THIN_STEP, scales.temperature[1], THIN_STEP):
            lines = field.lines(level)
            _draw_lines(plotter, lines, view, spacing, 1.4, (0.15, 0.15, 0.15))
            if level < scales.melting:
                _label(plotter, lines, level, view, taken)
    melting = field.lines(scales.melting)
    _draw_lines(plotter, melting, view, spacing, 6.0, (1.0, 1.0, 1.0))
    _draw_lines(plotter, melting, view, spacing, 3.0, (0.0, 0.0, 0.0))


def _draw_lines(
    plotter: Any,
    lines: list[np.ndarray],
    view: Frame,
    spacing: float,
    width: float,
    colour: tuple[float, ...],
) -> None:
    """The polylines of a plane, ``width`` [px] thick, in front of the particles; thin ones over thick ones."""
    import pyvista as pv

    if not lines:
        return
    points = _in_space(np.concatenate(lines), view)
    points += spacing * (1.0 + 0.05 * (6.0 - width)) * view.towards
    cells, start = [], 0
    for line in lines:
        cells += [len(line), *range(start, start + len(line))]
        start += len(line)
    plotter.add_mesh(
        pv.PolyData(points, lines=np.array(cells)),
        color=colour,
        line_width=width * dots_of(plotter),
        lighting=False,
        render=False,
    )


def _label(
    plotter: Any, lines: list[np.ndarray], level: float, view: Frame, taken: list[tuple[float, float]]
) -> None:
    """Write ``level`` where the longest of ``lines`` is lowest, unless a label is ``taken`` to be there [px]."""
    if not lines:
        return
    line = max(lines, key=len)
    lowest = line[np.argmin(line[:, 1])]
    x, y = (float(at) for at in view.pixels(_in_space(lowest[None], view))[0])
    x = float(np.clip(x, 2.5 * MARGIN, view.window[0] - 2.5 * MARGIN))
    free = all(abs(x - a) > LABEL[0] or abs(y - b) > LABEL[1] for a, b in taken)
    if free and np.ptp(line[:, 0]) * view.scale > LABELLED and y > FOOTER + MARGIN:
        draw_text(plotter, f"{level:.0f} K", (x, y - 13), 22, "centre", backed=True)
        taken.append((x, y))


def _in_space(flat: np.ndarray, view: Frame) -> np.ndarray:
    """Points [m], shape [n, 2], of the plane z = 0 of a 2-D scene, or of y = 0 of a 3-D one, shape [n, 3]."""
    points = np.zeros((len(flat), 3))
    points[:, 0], points[:, 2 if view.solid else 1] = flat[:, 0], flat[:, 1]
    return points
