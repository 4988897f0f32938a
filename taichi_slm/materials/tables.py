"""Materials as tables that a time step looks up.

A table has equally spaced knots in three segments: solid, mushy, liquid. The solidus and the liquidus are
knots, so the kinks of every property there stay sharp. Between knots everything is linear. Enthalpy and the
Kirchhoff potential are integrated by Gauss quadrature, exact to round-off at the knots.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from taichi_slm.config.material import Material
from taichi_slm.errors import ConfigError
from taichi_slm.materials.laws import (
    Array,
    PhaseProperty,
    phase_value,
    surface_tension,
    surface_tension_slope,
)

LOWEST_TEMPERATURE = 1.0  # T_low, where the tables begin and enthalpy and Kirchhoff potential are zero [K]
INTERVALS = (192, 32, 512)  # of the solid, mushy and liquid segment
SEGMENT_BASE = (0, 192, 224, 736)  # first knot of each segment, and the last knot
KNOTS = SEGMENT_BASE[-1] + 1
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True)
class PropertyTables:
    """Properties of all materials; first axis of every array: material [m].

    Tables over temperature have shape [m, 737], knots at ``temperature``. A material without a solid has the
    liquid segment over [T_low, T_max]; its other two segments lie below T_low, where it is continued with
    the values at T_low. "Mechanical mass" is volume times ``density``.
    """

    names: tuple[str, ...]
    segment_base: tuple[int, int, int, int]  # first knot of each segment, and the last knot
    segment_start: Array  # T_low, solidus, liquidus, T_max [K], shape [m, 4]
    temperature: Array  # knots [K], shape [m, 737]
    density: Array  # mechanical reference density rho0(T) [kg/m^3]
    density_true: Array  # of the law [kg/m^3]; differs in the solid when solid_density is "solidus"
    conductivity: Array  # k [W/(m K)]
    kirchhoff: Array  # integral of k dT from T_low [W/m]
    heat_capacity: Array  # sensible, per mechanical mass: c density_true/density [J/(kg K)]
    apparent_heat_capacity: Array  # paper (39); at solidus and liquidus the band's value [J/(kg K)]
    enthalpy: Array  # H(T) per mechanical mass, zero at T_low [J/kg]
    viscosity: Array  # [Pa s]
    surface_tension: Array  # [N/m]
    surface_tension_slope: Array  # [N/(m K)]
    enthalpy_start: Array  # H at the four segment limits [J/kg], shape [m, 4]
    temperature_of_enthalpy: Array  # T at knots equally spaced in H inside each segment [K], shape [m, 737]
    melts: np.ndarray  # whether there is a solid, bool, shape [m]
    latent_heat: Array  # of melting [J/kg], shape [m]
    band_heat_capacity: Array  # (39) in the band: (c_S + c_L)/2 + L/dT [J/(kg K)], shape [m]
    emissivity: Array  # shape [m]
    absorptivity: Array  # shape [m]
    boiling_temperature: Array  # [K], shape [m]; 0 without evaporation data
    evaporation_heat: Array  # [J/kg], shape [m]; 0 without
    molar_mass: Array  # [kg/mol], shape [m]; 0 without


def tabulate(
    materials: Sequence[Material], solid_density: Literal["solidus", "true"] = "solidus"
) -> PropertyTables:
    """The tables of ``materials``, in their order.

    solid_density "solidus" holds the mechanical density of the solid at its value at the solidus (the solid
    does not expand); the heat capacity per mechanical mass then carries the true rho c; "true" follows the
    law.
    Raises ConfigError where a density or heat capacity is not positive within the table.
    """
    columns = [_material_tables(material, solid_density) for material in materials]
    arrays = {key: np.stack([column[key] for column in columns]) for key in columns[0]}
    return PropertyTables(names=tuple(m.name for m in materials), segment_base=SEGMENT_BASE, **arrays)


def _material_tables(material: Material, solid_density: str) -> dict[str, np.ndarray]:
    low, top = LOWEST_TEMPERATURE, material.maximum_temperature
    if top <= low:
        raise ConfigError(f"material '{material.name}': maximum_temperature {top:g} K is not above {low:g} K")
    if material.solidus is None or material.liquidus is None:
        start = np.array([low - 2.0, low - 1.0, low, top])
    elif material.solidus <= low:
        raise ConfigError(
            f"material '{material.name}': solidus {material.solidus:g} K is not above {low:g} K"
        )
    else:
        start = np.array([low, material.solidus, material.liquidus, top])
    T = _segment_knots(start)
    at = np.maximum(T, low)  # below T_low (no solid) values are continued

    def law(quantity: PhaseProperty) -> Array:
        values = phase_value(material, quantity, at)
        may_vanish = quantity in ("conductivity", "viscosity")
        _refuse(values < 0.0 if may_vanish else values <= 0.0, quantity, at, material)
        return values

    density_true = law("density")
    held: float | None = None
    if material.melts and solid_density == "solidus":
        held = float(phase_value(material, "density", start[1]))

    def mechanical(temperature: Array, density: Array) -> Array:
        return density if held is None else np.where(temperature <= start[1], held, density)

    def sensible(temperature: Array) -> Array:
        density = phase_value(material, "density", temperature)
        ratio = density / mechanical(temperature, density)
        return np.asarray(phase_value(material, "heat_capacity", temperature) * ratio)

    def conduct(temperature: Array) -> Array:
        return phase_value(material, "conductivity", temperature)

    law("heat_capacity")
    tables: dict[str, np.ndarray] = {
        "segment_start": start,
        "temperature": T,
        "density": mechanical(at, density_true),
        "density_true": density_true,
        "conductivity": law("conductivity"),
        "heat_capacity": sensible(at),
        "viscosity": law("viscosity"),
        "surface_tension": surface_tension(material, at),
        "surface_tension_slope": surface_tension_slope(material, at),
    }
    tables["kirchhoff"] = _integral(conduct, T, _breaks(material, "conductivity"), low)
    tables |= _heat(material, start, T, sensible)
    evaporation = material.evaporation
    scalars = {
        "melts": material.melts,
        "latent_heat": material.latent_heat if material.melts else 0.0,
        "emissivity": material.emissivity,
        "absorptivity": material.absorptivity,
        "boiling_temperature": evaporation.boiling_temperature if evaporation else 0.0,
        "evaporation_heat": evaporation.latent_heat if evaporation else 0.0,
        "molar_mass": evaporation.molar_mass if evaporation else 0.0,
    }
    return tables | {key: np.asarray(value) for key, value in scalars.items()}


def _heat(
    material: Material, start: Array, T: Array, sensible: Callable[[Array], Array]
) -> dict[str, np.ndarray]:
    """Apparent heat capacity, enthalpy and its inverse.

    H is the integral of the sensible heat capacity in solid and liquid, and linear in T between solidus and
    liquidus with H(liquidus) - H(solidus) = (c_S + c_L)/2 dT + L, the integral of (39).
    """
    first, last = SEGMENT_BASE[1], SEGMENT_BASE[2]
    breaks = _breaks(material, "heat_capacity", "density")
    enthalpy = np.empty(KNOTS)
    apparent = sensible(np.maximum(T, LOWEST_TEMPERATURE))
    band = 0.0
    if material.melts:
        c_solid, c_liquid = sensible(start[1:2])[0], sensible(start[2:3])[0]
        band = 0.5 * (c_solid + c_liquid) + material.latent_heat / (start[2] - start[1])
        apparent[first : last + 1] = band
        enthalpy[: first + 1] = _integral(sensible, T[: first + 1], breaks, start[0])
        enthalpy[first : last + 1] = enthalpy[first] + band * (T[first : last + 1] - start[1])
        enthalpy[last:] = enthalpy[last] + _integral(sensible, T[last:], breaks, start[2])
    else:
        enthalpy[:] = _integral(sensible, T, breaks, LOWEST_TEMPERATURE)
    heat_start = enthalpy[list(SEGMENT_BASE)]
    wanted = _segment_knots(heat_start)
    inverse = np.interp(wanted, enthalpy, T)
    for begin, end in ((0, first), (last, KNOTS - 1)):  # the mushy segment is linear: np.interp was exact
        part = slice(begin, end + 1)
        inverse[part] = _invert(sensible, T[part], enthalpy[part], wanted[part])
    return {
        "apparent_heat_capacity": apparent,
        "band_heat_capacity": np.asarray(band),
        "enthalpy": enthalpy,
        "enthalpy_start": heat_start,
        "temperature_of_enthalpy": inverse,
    }


def _segment_knots(start: Array) -> Array:
    """Knots equally spaced inside each of the three segments, shape [737]; the limits are met exactly."""
    pieces = [np.linspace(start[i], start[i + 1], INTERVALS[i] + 1)[:-1] for i in range(3)]
    return np.concatenate([*pieces, start[3:]])


def _gauss(function: Callable[[Array], Array], a: Array, b: Array) -> Array:
    """Integral of ``function`` over each [a, b] by eight Gauss points; below T_low it is continued."""
    middle, half = 0.5 * (a + b)[..., None], 0.5 * (b - a)[..., None]
    points = np.maximum(middle + half * _NODES, LOWEST_TEMPERATURE)
    return np.asarray((function(points) * _WEIGHTS).sum(-1) * half[..., 0], dtype=np.float64)


def _integral(function: Callable[[Array], Array], knots: Array, breaks: Array, origin: float) -> Array:
    """Integral of ``function``, which has kinks at ``breaks``, from ``origin`` (a knot) to every knot."""
    inside = breaks[(breaks > knots[0]) & (breaks < knots[-1])]
    grid = np.union1d(knots, inside)
    total = np.concatenate(([0.0], np.cumsum(_gauss(function, grid[:-1], grid[1:]))))
    values = total[np.searchsorted(grid, knots)]
    return np.asarray(values - values[np.searchsorted(knots, origin)], dtype=np.float64)


def _invert(function: Callable[[Array], Array], T: Array, H: Array, wanted: Array) -> Array:
    """T where the integral H(T) of ``function`` takes the ``wanted`` values: Newton between knots (T, H)."""
    knot = np.clip(np.searchsorted(H, wanted, side="right") - 1, 0, len(T) - 2)
    lower, upper = T[knot], T[knot + 1]
    guess = np.interp(wanted, H, T)
    for _ in range(6):
        error = H[knot] + _gauss(function, lower, guess) - wanted
        guess = np.clip(guess - error / function(np.maximum(guess, LOWEST_TEMPERATURE)), lower, upper)
    guess[0], guess[-1] = T[0], T[-1]
    return guess


def _breaks(material: Material, *quantities: PhaseProperty) -> Array:
    """Temperatures [K] at which a law has a kink: table rows, solidus, liquidus, T_low."""
    points = [LOWEST_TEMPERATURE]
    points += [limit for limit in (material.solidus, material.liquidus) if limit is not None]
    for quantity in quantities:
        laws = getattr(material, quantity)
        for law in (laws.solid, laws.liquid):
            if law is not None and law.table is not None:
                points += [row[0] for row in law.table]
    return np.unique(points)


def _refuse(bad: np.ndarray, quantity: str, T: Array, material: Material) -> None:
    if bad.any():
        place = float(T[np.argmax(bad)])
        raise ConfigError(
            f"material '{material.name}': {quantity.replace('_', ' ')} is not positive at {place:.0f} K; "
            "mend its law, or lower maximum_temperature"
        )


def enthalpy_at(tables: PropertyTables, material: int, temperature: ArrayLike) -> Array:
    """H [J/kg of mechanical mass] at temperature [K]: the exact inverse of `temperature_at`.

    Raises ConfigError outside the table.
    """
    T = np.asarray(temperature, dtype=np.float64)
    knots = tables.temperature_of_enthalpy[material]
    low, top = (LOWEST_TEMPERATURE, tables.segment_start[material, 3])
    if T.size and (T.min() < low or T.max() > top):
        worst = T.min() if T.min() < low else T.max()
        raise ConfigError(
            f"{worst:g} K is outside the tables of '{tables.names[material]}' ({low:g} to {top:g} K); "
            "see maximum_temperature of the material"
        )
    return np.asarray(np.interp(T, knots, _segment_knots(tables.enthalpy_start[material])), dtype=np.float64)


def temperature_at(tables: PropertyTables, material: int, enthalpy: ArrayLike) -> Array:
    """T [K] at enthalpy [J/kg of mechanical mass], linear between the knots of ``temperature_of_enthalpy``.

    Outside the table the end values stand.
    """
    H = np.asarray(enthalpy, dtype=np.float64)
    knots = _segment_knots(tables.enthalpy_start[material])
    return np.asarray(np.interp(H, knots, tables.temperature_of_enthalpy[material]), dtype=np.float64)
