"""What surrounds the metal on a picture, in pixels: colour bar, swatches, scale bar, texts.

A pixel of the picture is some dots of the window along each side, by the window's resolution, which VTK sizes fonts by.
"""

from typing import Any, Literal

import numpy as np

from taichi_slm.render.paint import Key

TEXT, SMALL = 30, 26  # font sizes [px]
INK = (0.1, 0.1, 0.1)
BAR_HEIGHT = 26
LETTER = 0.55  # mean width of a letter, in font sizes
POINTS = 72  # per inch: the resolution at which VTK's fonts are of their size in dots
Side = Literal["left", "centre", "right"]


def set_dots(plotter: Any, dots: int) -> None:
    """From now on ``dots`` of the window of ``plotter`` along a pixel."""
    plotter.render_window.SetDPI(POINTS * dots)


def dots_of(plotter: Any) -> int:
    """Dots of the window of ``plotter`` along a pixel."""
    return int(plotter.render_window.GetDPI()) // POINTS


def draw_text(
    plotter: Any,
    text: str,
    at: tuple[float, float],
    size: int = TEXT,
    side: Side = "left",
    bold: bool = False,
    backed: bool = False,
) -> None:
    """Write ``text`` with its base line's ``side`` at a point [px]."""
    from vtkmodules.vtkRenderingCore import vtkTextActor

    actor = vtkTextActor()
    actor.SetTextScaleModeToNone()
    actor.SetInput(text)
    style = actor.GetTextProperty()
    style.SetFontFamilyToArial()
    style.SetFontSize(size)
    style.SetColor(*INK)
    style.SetBold(bold)
    {"left": style.SetJustificationToLeft, "centre": style.SetJustificationToCentered}.get(
        side, style.SetJustificationToRight
    )()
    if backed:
        style.SetBackgroundColor(1.0, 1.0, 1.0)
        style.SetBackgroundOpacity(0.65)
    style.SetVerticalJustificationToBottom()
    actor.SetPosition(*(dots_of(plotter) * np.array(at)))
    plotter.add_actor(actor, render=False)


def draw_boxes(plotter: Any, boxes: np.ndarray, colours: np.ndarray) -> None:
    """Fill ``boxes`` (x0, y0, x1, y1) [px], shape [n, 4], with ``colours``, uint8, shape [n, 3]."""
    import pyvista as pv
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D

    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2)
    points = np.zeros((len(corners), 3), dtype=np.float32)
    points[:, :2] = dots_of(plotter) * corners
    faces = np.full((len(boxes), 5), 4)
    faces[:, 1:] = np.arange(4 * len(boxes)).reshape(-1, 4)
    mesh = pv.PolyData(points, faces=faces.ravel())
    mesh.GetCellData().SetScalars(numpy_to_vtk(np.ascontiguousarray(colours, dtype=np.uint8), deep=True))
    mapper = vtkPolyDataMapper2D()
    mapper.SetInputData(mesh)
    mapper.SetScalarModeToUseCellData()
    actor = vtkActor2D()
    actor.SetMapper(mapper)
    plotter.add_actor(actor, render=False)


def draw_key(plotter: Any, key: Key, left: float, bottom: float, width: float) -> None:
    """Draw the legend into a strip that starts at ``left``, ``bottom`` and is at most ``width`` wide [px]."""
    upper = bottom + BAR_HEIGHT + 12
    draw_text(plotter, key.title, (left, upper))
    x = left
    if key.bar is not None:
        long = min(620.0, width) if not key.swatches else min(330.0, 0.4 * width)
        edges = np.round(np.linspace(x, x + long, len(key.bar) + 1))
        boxes = np.full((len(key.bar), 4), bottom)
        boxes[:, 0], boxes[:, 2], boxes[:, 3] = edges[:-1], edges[1:], bottom + BAR_HEIGHT
        draw_boxes(plotter, boxes, key.bar)
        for share, label in key.ticks:
            at = x + share * long
            _draw_line(plotter, at - 1, at + 1, bottom - 7, bottom)
            draw_text(plotter, label, (at, bottom - 38), SMALL, "centre")
        x += long + 48
    at = max(x, left + 24.0 + LETTER * TEXT * len(key.title))
    for thickness, label in key.lines:
        if thickness:
            _draw_line(plotter, at, at + 46, upper + 15 - 0.5 * thickness, upper + 15 + 0.5 * thickness)
            at += 58
        draw_text(plotter, label, (at, upper + 2), SMALL)
        at += LETTER * SMALL * len(label) + 34
    for colour, label in key.swatches:
        draw_boxes(plotter, np.array([[x, bottom, x + 38, bottom + BAR_HEIGHT]]), colour[None])
        draw_text(plotter, label, (x + 48, bottom - 3), SMALL)
        x += 48 + LETTER * SMALL * len(label) + 30


def _draw_line(plotter: Any, left: float, right: float, low: float, high: float) -> None:
    draw_boxes(plotter, np.array([[left, low, right, high]]), np.array([[25, 25, 25]]))


def draw_scale_bar(plotter: Any, length: float, scale: float, right: float, bottom: float) -> None:
    """Draw a bar of ``length`` [m] that ends at ``right`` [px], with its label above."""
    long = length * scale
    _draw_line(plotter, right - long, right, bottom, bottom + 9)
    label = length_label(length)
    if LETTER * TEXT * len(label) > long:
        draw_text(plotter, label, (right, bottom + 16), TEXT, "right")
    else:
        draw_text(plotter, label, (right - 0.5 * long, bottom + 16), TEXT, "centre")


def length_label(length: float) -> str:
    """A round ``length`` [m] in mm, µm or nm."""
    for factor, unit in ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")):
        if length >= 0.999 * factor:
            return f"{length / factor:.3g} {unit}"
    return f"{length:.3g} m"
