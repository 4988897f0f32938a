"""Draw the plots of the cases: numbers become pictures."""

import math
from pathlib import Path

from matplotlib.figure import Figure

from taichi_slm.output.atomic import write_bytes
from taichi_slm.verification.case import Plot

_STYLES = {"line": {}, "dashed": {"linestyle": "--"}, "points": {"linestyle": "none", "marker": "o"}}


def draw(plot: Plot, path: Path) -> None:
    """Write ``plot`` as a PNG."""
    import io

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for curve in plot.curves:
        y = [math.nan if value is None else value for value in curve.y]
        axes.plot(curve.x, y, label=curve.label, markersize=4, **_STYLES[curve.style])  # type: ignore[arg-type]
    if "x" in plot.log:
        axes.set_xscale("log")
    if "y" in plot.log:
        axes.set_yscale("log")
    axes.set(title=plot.title, xlabel=plot.x, ylabel=plot.y)
    axes.grid(alpha=0.3)
    if any(curve.label for curve in plot.curves):
        axes.legend(fontsize=8)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    write_bytes(path, picture.getvalue())
