"""Draw the plots of the cases: numbers become pictures."""

import math
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from taichi_slm.output.atomic import write_bytes
from taichi_slm.verification.case import Plot

_STYLES = {"line": {}, "dashed": {"linestyle": "--"}, "points": {"linestyle": "none", "marker": "o"}}


class _Plain(LogFormatter):
    """Labels of a logarithmic axis: 0.5, not 5 x 10^-1."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def draw(plot: Plot, path: Path) -> None:
    """Write ``plot`` as a PNG."""
    import io

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for curve in plot.curves:
        y = [math.nan if value is None else value for value in curve.y]  # numbers, or names
        axes.plot(curve.x, y, label=curve.label, markersize=4, **_STYLES[curve.style])  # type: ignore[arg-type]
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        if name in plot.log:
            (axes.set_xscale if name == "x" else axes.set_yscale)("log")
            axis.set_major_formatter(_Plain())
            axis.set_minor_formatter(_Plain(minor_thresholds=(1.5, 0.5)))  # some, where there is no decade
    if any(isinstance(value, str) for curve in plot.curves for value in curve.y):
        axes.invert_yaxis()  # names are read from above
    axes.set(title=plot.title, xlabel=plot.x, ylabel=plot.y)
    axes.grid(alpha=0.3)
    if any(curve.label for curve in plot.curves):
        axes.legend(fontsize=8)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    write_bytes(path, picture.getvalue())
