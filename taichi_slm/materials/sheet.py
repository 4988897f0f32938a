"""An alloy as a page of text: the law of every property, and where its numbers come from."""

import difflib
from typing import Any

from taichi_slm.config.material import LAW_FORMS, Law, Material, PhaseLaw
from taichi_slm.errors import ConfigError
from taichi_slm.materials.library import alloy_names, load_alloy

UNITS = {
    "density": "kg/m^3",
    "heat_capacity": "J/(kg K)",
    "conductivity": "W/(m K)",
    "viscosity": "Pa s",
    "surface_tension": "N/m",
    "latent_heat": "J/kg",
    "solidus": "K",
    "liquidus": "K",
    "maximum_temperature": "K",
    "mushy_viscosity_factor": "",
    "emissivity": "",
    "absorptivity": "",
}


def sheet(name: str | None = None) -> list[str]:
    """All alloys, a line each; or the page of one. Raises ConfigError for a name that does not ship."""
    if name is None:
        return [f"{alloy:<22}{load_alloy(alloy).description or ''}" for alloy in alloy_names()]
    return _page(known_alloy(name))


def known_alloy(name: str) -> Material:
    """The alloy ``name``. Raises ConfigError, with a guess, for one that does not ship."""
    if name not in alloy_names():
        close = difflib.get_close_matches(name, alloy_names(), n=1)
        hint = f" Did you mean '{close[0]}'?" if close else f" There are {', '.join(alloy_names())}."
        raise ConfigError(f"there is no alloy '{name}'.{hint}")
    return load_alloy(name)


def _page(material: Material) -> list[str]:
    lines = [f"{material.name}: {material.description or ''}"]
    sources = material.sources or {}
    for quantity, unit in UNITS.items():
        value = getattr(material, quantity)
        if value is None:
            continue
        label = f"  {quantity:<24}"
        if isinstance(value, PhaseLaw):
            for phase in ("solid", "liquid"):
                law = getattr(value, phase)
                if law is not None:
                    lines += _law(f"{label}{phase:<8}", law, unit)
        elif isinstance(value, Law):
            lines += _law(label, value, unit)
        else:
            lines.append(f"{label}{value:g} {unit}".rstrip())
            lines += _source(sources.get(quantity))
    if material.evaporation is not None:
        data = material.evaporation
        lines.append(
            f"  {'evaporation':<24}{data.latent_heat:g} J/kg at {data.boiling_temperature:g} K, "
            f"{data.molar_mass:g} kg/mol"
        )
        lines += _source(data.source)
    return lines


def _law(label: str, law: Law, unit: str) -> list[str]:
    form = next(name for name in LAW_FORMS if getattr(law, name) is not None)
    return [f"{label}{_formula(form, getattr(law, form))} {unit}".rstrip(), *_source(law.source)]


def _formula(form: str, value: Any) -> str:
    if form == "constant":
        return f"{value:g}"
    if form == "polynomial":
        terms = [f"{c:g}" + ("" if n == 0 else " T" if n == 1 else f" T^{n}") for n, c in enumerate(value)]
        return " + ".join(terms).replace("+ -", "- ")
    if form == "line":
        return f"{value.value:g} {value.slope:+g} (T - {value.at:g})"
    if form == "table":
        return f"table of {len(value)} rows, {value[0][0]:g} to {value[-1][0]:g} K"
    if form == "log10_arrhenius":
        return f"10^({value[0]:g}/T {value[1]:+g}) x {value[2]:g}"
    return (
        f"sulphur law, pure {value.pure:g} at {value.melting_temperature:g} K, "
        f"slope -{value.slope:g}/K, {value.sulphur_wt_percent:g} wt% S"
    )


def _source(text: str | None) -> list[str]:
    return [f"      {text}"] if text else []
