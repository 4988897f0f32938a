"""The plots of an analysis: one PNG each, with units on every axis."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, LogLocator

from taichi_slm.analysis.energy import ENDS, SOURCES
from taichi_slm.output.atomic import write_bytes
from taichi_slm.output.numbers import handy

if TYPE_CHECKING:
    from taichi_slm.analysis.analyse import Analysis

DPI = 130
INK, TRACK, DEEP, POWDER = "#333333", "#c44e1e", "#2f6690", "#8a8a8a"
VISIBLE = 0.002  # share of an account below which its layer is thinner than a line
NAMED = 6  # pools that get a colour and a name of their own; later ones are grey
COLOURS = ("#c44e1e", "#2f6690", "#5b8c3e", "#8e5ea2", "#b8860b", "#2a9d8f")


def draw_all(found: "Analysis") -> list[Path]:
    """Draw what the run has numbers for; the files."""
    plots: list[tuple[str, Callable[[Analysis], Figure | None]]] = [
        ("pools", pools_figure),
        ("track", track_figure),
        ("fronts", fronts_figure),
        ("spatter", spatter_figure),
        ("mixing", mixing_figure),
        ("energy", energy_figure),
    ]
    files = []
    for name, draw in plots:
        figure = draw(found)
        path = found.folder / f"{name}.png"
        if figure is not None:
            save(figure, path)
            files.append(path)
        else:
            path.unlink(missing_ok=True)  # of an earlier analysis
    return files


def save(figure: Figure, path: Path) -> None:
    """Write ``figure`` as a PNG."""
    stream = io.BytesIO()
    FigureCanvasAgg(figure).print_figure(stream, dpi=DPI, format="png")
    write_bytes(path, stream.getvalue())


def title_of(found: "Analysis") -> str:
    """Of the scene, else the name of the folder."""
    return found.recording.config.title or found.recording.folder.resolve().name


def panels(count: int, across: int, title: str, height: float = 2.9) -> tuple[Figure, list[Any]]:
    """A figure with ``count`` axes in rows of ``across``."""
    down = -(-count // across)
    figure = Figure(figsize=(5.2 * across, height * down + 0.5), layout="constrained")
    figure.suptitle(title, fontsize=12)
    axes = [figure.add_subplot(down, across, k + 1) for k in range(count)]
    for each in axes:
        each.grid(alpha=0.25)
    return figure, axes


def size_columns(dimension: int) -> list[tuple[str, str, str]]:
    """Column, label and unit of what is drawn of a pool over time."""
    deep = [("width_m", "width", "m")] if dimension == 3 else []
    size = ("volume_m3", "volume", "m³") if dimension == 3 else ("area_m2", "area", "m²")
    return [("length_m", "length", "m"), *deep, ("depth_m", "depth", "m"), size]


def pools_figure(found: "Analysis") -> Figure | None:
    """Length, width, depth and size of every pool over time."""
    table = {name: np.asarray(values) for name, values in found.tables["pools"].items()}
    if not len(table["time_s"]):
        return None
    shown = size_columns(found.dimension)
    figure, axes = panels(len(shown) + 1, 2, title_of(found))
    clock, second = handy(found.end, "s")
    numbers, counts = np.unique(table["pool"], return_counts=True)
    named = numbers[np.argsort(-counts, kind="stable")][:NAMED]
    columns = [*shown, ("max_temperature_K", "highest temperature", "K")]
    for ax, (name, label, unit) in zip(axes, columns, strict=True):
        factor, unit_shown = handy(float(table[name].max()), unit)
        for number in numbers:
            rows = table["pool"] == number
            known = number in named
            colour = COLOURS[int(np.flatnonzero(named == number)[0])] if known else "#bbbbbb"
            ax.plot(
                table["time_s"][rows] / clock,
                table[name][rows] / factor,
                ".-",
                ms=4,
                lw=1.2 if known else 0.7,
                color=colour,
                label=f"pool {number}" if known else None,
                zorder=3 if known else 2,
            )
        ax.set(xlabel=f"time [{second}]", ylabel=f"{label} [{unit_shown}]")
        ax.set_xlim(0.0, found.end / clock)
        if unit != "K":
            ax.set_ylim(bottom=0.0)
    if len(numbers) > 1:
        more = f"; grey: {len(numbers) - len(named)} more" if len(numbers) > len(named) else ""
        figure.legend(
            *axes[0].get_legend_handles_labels(), fontsize=8, title=f"those seen longest{more}", title_fontsize=8,
            loc="outside lower center", ncols=NAMED,
        )  # fmt: skip
    return figure


def track_figure(found: "Analysis") -> Figure | None:
    """The longitudinal profile to scale in x only; in 3-D the sections along the path as well."""
    table = found.tables["track"]
    if not len(table["x_m"]):
        return None
    chief = found.chief["track"]
    deep = found.dimension == 3
    figure = Figure(figsize=(10.4, 6.6 if deep else 4.4), layout="constrained")
    figure.suptitle(title_of(found), fontsize=12)
    axes = figure.subplots(2, 1, sharex=True) if deep else [figure.add_subplot()]
    x, height, depth = (table[name] * 1e6 for name in ("x_m", "height_m", "depth_m"))
    ax = axes[0]
    # NaN where there is no metal: nothing is filled there
    bottom = np.nan_to_num(table["bottom_m"] * 1e6, nan=0.0)
    body = np.isfinite(table["bottom_m"])
    upper = np.maximum(height, bottom)
    ax.fill_between(
        x, bottom, np.minimum(0.0, upper), where=body & (bottom < 0.0), color=DEEP, alpha=0.35, lw=0,
        label="track below the plate's top",
    )  # fmt: skip
    ax.fill_between(
        x,
        np.maximum(bottom, 0.0),
        upper,
        where=body & (upper > 0.0),
        color=TRACK,
        alpha=0.35,
        lw=0,
        label="above it",
    )
    ax.plot(x, height, color=TRACK, lw=1.3)
    ax.plot(x, np.where(body, bottom, np.nan), color=DEEP, lw=1.3)
    ax.axhline(0.0, color=INK, lw=0.8)
    mean = chief["mean_height_m"] * 1e6
    inner = 0.1 * (x[-1] - x[0])
    ax.plot([x[0] + inner, x[-1] - inner], [mean, mean], "--", color=INK, lw=1.0, label="mean height")
    ax.set(ylabel="height on the centre line, root [µm]" if deep else "height [µm]")
    norms = [f"${name[0]}_{name[1]}$ {chief[f'{name}_m'] * 1e6:.1f} µm" for name in ("Ra", "Rq", "Rz", "Pq")]
    parts = [", ".join(norms)]
    if "dilution" in chief:
        parts.append(f"dilution {100 * chief['dilution']:.0f} %")
    ax.set_title("; ".join(parts), fontsize=10)
    room = float(np.nanmax(height) + np.nanmax(depth)) or 1.0
    ax.set_ylim(-np.nanmax(depth) - 0.1 * room, np.nanmax(height) + 0.35 * room)
    ax.legend(fontsize=8, ncols=3, loc="upper center")
    if deep:
        axes[1].plot(x, table["width_m"] * 1e6, color=INK, label="width")
        axes[1].plot(x, height, color=TRACK, label="height on the centre line")
        axes[1].plot(x, table["crest_m"] * 1e6, ":", color=TRACK, label="crest")
        axes[1].plot(x, depth, color=DEEP, label="depth")
        axes[1].set(ylabel="section [µm]")
        axes[1].set_ylim(bottom=0.0)
        axes[1].legend(fontsize=8, ncols=4, loc="upper center")
        axes[1].set_ylim(top=1.25 * float(np.nanmax(table["width_m"])) * 1e6)
    for each in axes:
        each.grid(alpha=0.25)
    axes[-1].set(xlabel="x [µm]")
    return figure


def fronts_figure(found: "Analysis") -> Figure | None:
    """Gradient against front speed, cooling rate along the track, and time above melting."""
    table = found.tables["fronts"]
    rate, slope, speed = (
        np.asarray(table[name]) for name in ("cooling_rate_K_s", "gradient_K_m", "front_speed_m_s")
    )
    good = np.isfinite(slope) & np.isfinite(speed) & (slope > 0.0) & (speed > 0.0)
    if good.sum() < 2:
        return None
    figure, (left, middle, right) = panels(3, 3, title_of(found), 3.7)
    left.loglog(speed[good], slope[good], ".", ms=3, color=DEEP, alpha=0.5, mew=0)
    left.set(xlabel="front speed R [m/s]", ylabel="thermal gradient G [K/m]")
    _cooling_lines(left, speed[good], slope[good])
    known = np.isfinite(rate) & (rate > 0.0)
    dots = middle.scatter(
        table["x_m"][known] * 1e6, table["z_m"][known] * 1e6, c=rate[known], s=5, lw=0, cmap="viridis",
        norm=_log_norm(rate[known]),
    )  # fmt: skip
    if known.any():
        figure.colorbar(
            dots, ax=middle, label="cooling rate [K/s]", location="top", shrink=0.9,
            ticks=LogLocator(subs=(1.0, 2.0, 5.0)), format=LogFormatterSciNotation(minor_thresholds=(9, 9)),
        ).ax.minorticks_off()  # fmt: skip
    middle.set(xlabel="x [µm]", ylabel="height [µm]")
    molten = np.asarray(table["time_above_melting_s"])
    clock, second = handy(float(molten.max()), "s")
    right.hist(molten / clock, bins=40, color=TRACK, alpha=0.8)
    right.set(xlabel=f"time above melting [{second}]", ylabel="particles that froze")
    return figure


def _log_norm(values: np.ndarray) -> Any:
    from matplotlib.colors import LogNorm

    low, high = np.percentile(values, [2, 98]) if len(values) else (1.0, 10.0)
    return LogNorm(float(low), float(max(high, 1.01 * low)))


def _cooling_lines(ax: Any, speed: np.ndarray, slope: np.ndarray) -> None:
    """Lines of equal G R across the plot, each with its value."""
    (left, right), (low, high) = (np.percentile(values, [1, 99]) for values in (speed, slope))
    left, right, low, high = left / 3, right * 3, low / 3, high * 3
    ax.set(xlim=(left, right), ylim=(low, high))
    for power in range(int(np.ceil(np.log10(left * low))), int(np.floor(np.log10(right * high))) + 1):
        product = 10.0**power
        ax.plot([left, right], [product / left, product / right], "-", color=POWDER, lw=0.8, zorder=1)
        at = max(left * 1.1, product / (high / 1.5))
        if at < right / 2 and product / at > low:
            ax.text(
                at, product / at, f"$10^{{{power}}}$ K/s", fontsize=8, color=INK, rotation=-35, va="center"
            )


def spatter_figure(found: "Analysis") -> Figure | None:
    """Metal in flight and metal gone over time, and how fast it flies."""
    table = {name: np.asarray(values, dtype=float) for name, values in found.tables["spatter"].items()}
    if not found.chief["spatter"]["ejected_particles"]:
        return None
    clock, second = handy(found.end, "s")
    factor, unit = (1e-9, "µg") if found.dimension == 3 else (1e-6, "mg/m")
    tail = "kg" if found.dimension == 3 else "kg_m"
    figure, (left, right) = panels(2, 2, title_of(found), 3.4)
    time = table["time_s"] / clock
    left.plot(time, table[f"mass_in_flight_{tail}"] / factor, ".-", color=TRACK, label="in flight")
    left.step(time, table[f"removed_mass_{tail}"] / factor, where="post", color=DEEP, label="gone, in sum")
    left.set(xlabel=f"time [{second}]", ylabel=f"mass [{unit}]")
    left.legend(fontsize=8)
    right.plot(time, table["max_speed_m_s"], "v", ms=5, color=TRACK, label="fastest")
    right.plot(time, table["mean_speed_m_s"], ".", color=DEEP, label="mean of all in flight")
    right.set(xlabel=f"time [{second}]", ylabel="speed in flight [m/s]")
    right.set_xlim(left.get_xlim())
    right.set_ylim(0.0, 1.1 * float(np.nanmax(table["max_speed_m_s"], initial=0.0)) or 1.0)
    right.legend(fontsize=8, loc="lower right")
    return figure


def mixing_figure(found: "Analysis") -> Figure | None:
    """Mixing index and spread of each group over time."""
    table = found.tables["mixing"]
    if not table:
        return None
    clock, second = handy(found.end, "s")
    figure, (left, right) = panels(2, 2, title_of(found), 3.4)
    columns = {name: np.asarray(values) for name, values in table.items()}
    labels = [f"{kind} {group}" for kind, group in zip(table["kind"], table["group"], strict=True)]
    for colour, label in zip(COLOURS, dict.fromkeys(labels), strict=False):
        rows = np.array([each == label for each in labels])
        time = columns["time_s"][rows] / clock
        left.plot(time, columns["mixing_index"][rows], ".-", ms=4, color=colour, label=label)
        for axis, style in (("x", "-"), ("z", "--")):
            right.plot(
                time, columns[f"spread_{axis}_m"][rows] * 1e6, style, color=colour, label=f"{label}, {axis}"
            )
    left.axhline(1.0, color=INK, lw=0.8, ls=":")
    left.text(0.02, 0.97, "1: stirred at random", transform=left.get_yaxis_transform(), va="top", fontsize=8)
    left.set(
        xlabel=f"time [{second}]",
        ylabel="mixing index of melted metal [-]",
        ylim=(0.0, 1.1),
        xlim=(0.0, found.end / clock),
    )
    right.set(xlabel=f"time [{second}]", ylabel="spread of places [µm]", xlim=(0.0, found.end / clock))
    right.set_yscale("log")
    left.legend(fontsize=8)
    right.legend(fontsize=8)
    return figure


def _seen(values: np.ndarray, total: float, name: str) -> str:
    """``name`` for the key, hidden where the account is too thin to be seen."""
    return name if float(values[-1]) > VISIBLE * total else f"_{name}"


def _percent(share: float) -> str:
    """Three digits, as 100 %, 97.7 % or 0.0478 %."""
    return f"{100 * share:.3g} %" if 0.0 < abs(share) < 0.9995 else f"{100 * share:.0f} %"


def energy_figure(found: "Analysis") -> Figure | None:
    """What became of the energy: over time, and at the end."""
    account = found.energy
    if account is None or found.chief["energy"]["in_J"] <= 0.0:
        return None
    unit = "J/m" if found.dimension == 2 else "J"
    clock, second = handy(float(account.time[-1]), "s")
    total = found.chief["energy"]["in_J"]
    factor, shown = handy(total, unit)
    figure, (left, right) = panels(2, 2, title_of(found), 3.8)
    names = dict(ENDS) | dict(SOURCES)
    # Small accounts first, from the bottom, so that they are seen below the store.
    order = sorted(account.ends, key=lambda name: name == "stored_J")
    colours = {
        "stored_J": "#e0a458",
        **dict(zip((n for n, _ in ENDS if n != "stored_J"), COLOURS, strict=False)),
    }
    left.stackplot(
        account.time / clock, [np.maximum(account.ends[name], 0.0) / factor for name in order],
        colors=[colours[name] for name in order], lw=0,
        labels=[_seen(account.ends[name], total, names[name]) for name in order],
    )  # fmt: skip
    left.plot(
        account.time / clock, sum(account.sources.values()) / factor, color=INK, lw=1.2, label="brought in"
    )
    left.set(xlabel=f"time [{second}]", ylabel=f"energy [{shown}]", xlim=(0.0, account.time[-1] / clock))
    left.legend(fontsize=8, loc="center right")
    bars = [*((name, "in") for name, _ in SOURCES), *((name, "out") for name, _ in ENDS)]
    values = [float((account.sources if side == "in" else account.ends)[name][-1]) for name, side in bars]
    places = np.arange(len(bars))[::-1]
    right.barh(places, [v / total * 100 for v in values], color=[colours.get(name, INK) for name, _ in bars])
    right.set_yticks(places, [f"{side}: {names[name]}" for name, side in bars], fontsize=8)
    right.set(
        xlabel="share of the energy brought in [%]",
        xlim=(min(0.0, *(v / total * 100 for v in values)), 118.0),
    )
    for place, value in zip(places, values, strict=True):
        right.text(
            max(value, 0.0) / total * 100 + 1.5, place, _percent(value / total), va="center", fontsize=8
        )
    missing = found.chief["energy"]["unaccounted_J"] / total
    right.set_title(f"not accounted for: {abs(missing):.0e} of it", fontsize=10)
    return figure
