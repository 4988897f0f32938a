"""An alloy as a page of curves: every law against temperature, as a run looks it up, with its source."""

import io
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_slm.config.material import Law, Material, PhaseLaw
from taichi_slm.errors import ConfigError
from taichi_slm.materials.laws import (
    Array,
    phase_value,
    saturation_pressure,
    surface_tension,
    surface_tension_slope,
)
from taichi_slm.materials.sheet import known_alloy
from taichi_slm.output.atomic import write_bytes

FORMS = (".png", ".pdf", ".svg")
COLDEST = 293.0  # [K]
BEYOND_BOILING = 1.15  # how far the curves go, over the boiling temperature: a melt pool gets no hotter
BEYOND_LIQUIDUS = 2.0  # the same where no boiling temperature is given, over the liquidus
POINTS = 200  # of a curve in each phase
COLOURS = {"solid": "#1f5fa8", "melting": "#7a7a7a", "liquid": "#c4401c"}
FEW_DECADES = 1e3
WRAP = 80  # characters of a source on one line


@dataclass(frozen=True)
class Panel:
    """One property: what stands at its axis, its values [SI] at temperatures [K], shape [n], and its sources."""

    label: str
    values: Callable[[Array], Array]
    sources: tuple[str, ...]
    law: PhaseLaw | Law | None
    solid: bool = True  # drawn below the solidus too
    log: bool = False
    signed: bool = False  # where zero lies matters


def plot_alloy(name: str | None, path: Path) -> Path:
    """Draw all laws of the alloy ``name`` into ``path``, a PNG, PDF or SVG; returns it.

    Raises ConfigError for a name that does not ship or another kind of file, StorageError if it cannot be written.
    """
    if name is None:
        raise ConfigError("--plot draws one alloy: name it, as in taichi-slm materials 316L --plot 316L.png")
    if path.suffix.lower() not in FORMS:
        raise ConfigError(f"{path}: a picture is one of {', '.join(FORMS)}")
    figure = draw(known_alloy(name))
    stream = io.BytesIO()
    figure.savefig(stream, format=path.suffix.lower()[1:], dpi=130)
    write_bytes(path, stream.getvalue())
    return path


def draw(material: Material) -> Any:
    """The matplotlib figure: a panel for every law that ``material`` has, and one of its numbers."""
    from matplotlib.figure import Figure

    chosen = panels(material)
    rows = (len(chosen) + 2) // 2
    figure = Figure(figsize=(11.0, 0.6 + 3.0 * rows), layout="constrained")
    figure.suptitle(f"{material.name}: {material.description or ''}".rstrip(": "), fontweight="bold")
    for place, panel in enumerate(chosen, 1):
        _draw_panel(figure.add_subplot(rows, 2, place), material, panel)
    _numbers(figure.add_subplot(rows, 2, len(chosen) + 1), material)
    return figure


def panels(material: Material) -> list[Panel]:
    """What is drawn of ``material``, in reading order."""

    def phased(quantity: Any, label: str, unit: float = 1.0, **options: Any) -> Panel:
        law: PhaseLaw = getattr(material, quantity)
        return Panel(
            label, lambda T: unit * phase_value(material, quantity, T), _sources(law), law, **options
        )

    found = [
        phased("density", "density [kg/m³]"),
        phased("heat_capacity", "heat capacity [J/(kg K)]"),
        phased("conductivity", "conductivity [W/(m K)]"),
        phased("viscosity", "viscosity [mPa s]", 1e3, solid=False, log=True),
    ]
    if material.mushy_viscosity_factor is not None:
        source = (material.sources or {}).get("mushy_viscosity_factor", "")
        said = (
            f"at the solidus: {material.mushy_viscosity_factor:g} times that of the liquid; {source}".rstrip(
                "; "
            )
        )
        found[-1] = replace(found[-1], sources=(*found[-1].sources, said))
    tension = material.surface_tension
    if tension is not None:
        source = tension.source
        found += [
            Panel(
                "surface tension [N/m]",
                lambda T: surface_tension(material, T),
                (source,) if source else (),
                tension,
                solid=False,
            ),
            Panel(
                "tension slope [mN/(m K)]",
                lambda T: 1e3 * surface_tension_slope(material, T),
                ("derivative of the surface tension; its sign decides which way the melt flows",),
                tension,
                solid=False,
                signed=True,
            ),
        ]
    data = material.evaporation
    if data is not None:
        law = "Clausius-Clapeyron from the boiling temperature"
        sources = (law, data.source) if data.source else (law,)
        found.append(
            Panel(
                "vapour pressure [kPa]",
                lambda T: 1e-3 * saturation_pressure(data, T),
                sources,
                None,
                solid=False,
                log=True,
            )
        )
    return found


def _sources(law: PhaseLaw) -> tuple[str, ...]:
    """What the law's phases say of where they come from; once, where they say the same."""
    said = {phase: each.source for phase in ("solid", "liquid") if (each := getattr(law, phase)) is not None}
    if len(set(said.values())) == 1 and len(said) == 2:
        return tuple(filter(None, {said["solid"]}))
    return tuple(f"{phase}: {source}" for phase, source in said.items() if source)


def hottest(material: Material) -> float:
    """Where the curves end [K]."""
    end = material.maximum_temperature
    if material.evaporation is not None:
        return min(end, BEYOND_BOILING * material.evaporation.boiling_temperature)
    return end if material.liquidus is None else min(end, BEYOND_LIQUIDUS * material.liquidus)


def pieces(material: Material, panel: Panel) -> dict[str, Array]:
    """The temperatures [K] at which ``panel`` is drawn in each phase: evenly, and at the rows of its tables."""
    end = hottest(material)
    if material.solidus is None or material.liquidus is None:
        limits = {"liquid": (COLDEST, end)}
    else:
        limits = {"melting": (material.solidus, material.liquidus), "liquid": (material.liquidus, end)}
        if panel.solid:
            limits = {"solid": (COLDEST, material.solidus), **limits}
    laws = (panel.law.solid, panel.law.liquid) if isinstance(panel.law, PhaseLaw) else (panel.law,)
    rows = [row[0] for law in laws if law is not None and law.table is not None for row in law.table]
    return {
        phase: np.union1d(np.linspace(low, high, POINTS), [T for T in rows if low < T < high])
        for phase, (low, high) in limits.items()
    }


def _draw_panel(axes: Any, material: Material, panel: Panel) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    largest = 0.0
    for phase, T in pieces(material, panel).items():
        values = panel.values(T)
        axes.plot(T, values, color=COLOURS[phase], linewidth=1.8)
        largest = max(largest, values.max())
    if material.solidus is not None and material.liquidus is not None:
        axes.axvspan(material.solidus, material.liquidus, color="0.87", zorder=0)
    if material.evaporation is not None:
        axes.axvline(material.evaporation.boiling_temperature, color="0.4", linestyle=":", linewidth=1.2)
    if panel.signed:
        axes.axhline(0.0, color="0.4", linewidth=0.8)
    if panel.log and largest > 0.0:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        if high < FEW_DECADES * low:  # a tick a decade would be one or two
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_xlim(COLDEST, hottest(material))
    axes.set_xlabel("temperature [K]")
    axes.set_ylabel(panel.label)
    axes.grid(alpha=0.3)
    lines = [line for source in panel.sources for line in textwrap.wrap(source, WRAP)]
    axes.set_title("\n".join(lines) or "no source given", fontsize=7.5, color="0.3", loc="left")


def _numbers(axes: Any, material: Material) -> None:
    """The panel of what is one number, with the meaning of the colours."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    axes.axis("off")
    rows = [f"latent heat of melting: {1e-3 * material.latent_heat:.4g} kJ/kg"]
    keys: list[Any] = [Line2D([], [], color=COLOURS["liquid"], label="liquid")]
    if material.solidus is not None and material.liquidus is not None:
        rows.insert(0, f"melts from {material.solidus:g} to {material.liquidus:g} K")
        keys.insert(0, Line2D([], [], color=COLOURS["solid"], label="solid"))
        keys.append(Line2D([], [], color=COLOURS["melting"], label="melting"))
        keys.append(Patch(color="0.87", label="melting range"))
    if material.evaporation is not None:
        rows.append(f"boils at {material.evaporation.boiling_temperature:g} K")
        rows.append(f"latent heat of evaporation: {1e-3 * material.evaporation.latent_heat:.4g} kJ/kg")
        keys.append(Line2D([], [], color="0.4", linestyle=":", label="boiling temperature"))
    rows += [f"emissivity: {material.emissivity:g}", f"absorptivity: {material.absorptivity:g}"]
    axes.text(0.0, 1.0, "\n".join(rows), va="top", fontsize=10, linespacing=1.5, transform=axes.transAxes)
    axes.legend(handles=keys, loc="lower left", fontsize=9.5, frameon=False, borderaxespad=0.0, ncols=2)
