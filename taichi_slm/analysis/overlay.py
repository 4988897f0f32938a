"""Runs in one plot: the size of the largest pool over time, and the final profiles."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from taichi_slm.analysis.figures import COLOURS, INK, size_columns
from taichi_slm.output.numbers import handy

if TYPE_CHECKING:
    from taichi_slm.analysis.compare import Compared

BESIDE = 6  # more names than this stand in two columns


def overlay(runs: "list[Compared]") -> Figure:
    """Sizes of the largest pool of every run over time, and below them height and depth of the tracks along x."""
    dimensions = sorted({run.config.dimension for run in runs})
    shown = list(dict.fromkeys(column for d in dimensions for column in size_columns(d)))
    columns = [column for column in shown if any(len(run.tables["pools"].get(column[0], ())) for run in runs)]
    across = max(2, len(columns))
    figure = Figure(figsize=(min(4.6 * across, 16.0), 7.2), layout="constrained")
    grid = figure.add_gridspec(2, across)
    end = max((float(run.tables["pools"]["time_s"].max(initial=0.0)) for run in runs), default=0.0) or 1e-6
    clock, second = handy(end, "s")
    colours = palette(len(runs))
    for place, (name, label, si) in enumerate(columns):
        ax = figure.add_subplot(grid[0, place])
        largest = max(float(np.nanmax(_largest(run, name)[1], initial=0.0)) for run in runs)
        factor, unit = handy(largest, si)
        for run, colour in zip(runs, colours, strict=True):
            time, values = _largest(run, name)
            ax.plot(time / clock, values / factor, ".-", ms=4, lw=1.2, color=colour)
        ax.set(
            xlabel=f"time [{second}]", ylabel=f"{label} of the largest pool [{unit}]", xlim=(0.0, end / clock)
        )
        ax.set_ylim(bottom=0.0)
        ax.grid(alpha=0.25)
    ax = figure.add_subplot(grid[1, :])
    for run, colour in zip(runs, colours, strict=True):
        track = run.tables["track"]
        ax.plot(track["x_m"] * 1e6, track["height_m"] * 1e6, color=colour, lw=1.4, label=run.name)
        ax.plot(track["x_m"] * 1e6, track["bottom_m"] * 1e6, color=colour, lw=1.0, ls="--")
    ax.axhline(0.0, color=INK, lw=0.8)
    ax.set(xlabel="x [µm]", ylabel="height [µm]")
    ax.set_title(
        "the tracks at the end: surface (full), lowest point of what was melted (dashed)", fontsize=10
    )
    ax.grid(alpha=0.25)
    figure.legend(
        *ax.get_legend_handles_labels(), loc="outside lower center", ncols=min(len(runs), BESIDE), fontsize=8
    )
    return figure


def palette(count: int) -> list[object]:
    """Colours for ``count`` runs: the house's for a few, an even scale for many."""
    if count <= len(COLOURS):
        return list(COLOURS[:count])
    return [colormaps["viridis"](0.95 * k / (count - 1)) for k in range(count)]


def _largest(run: "Compared", name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and values of the first row of every time: of the pool with the most particles."""
    pools = run.tables["pools"]
    if name not in pools:
        return np.zeros(0), np.zeros(0)
    time, first = np.unique(pools["time_s"], return_index=True)
    return time, pools[name][first]
