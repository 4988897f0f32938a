"""The laws of a material at given temperatures, on the host.

Everything takes and returns float64 arrays of any one shape (temperature [K], result in SI) and knows nothing
of particles; ``tables.py`` turns it into what a time step looks up.
"""

from typing import Any, Literal

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from taichi_slm.config.material import Evaporation, Law, Material, Sulphur

Array = NDArray[np.float64]
PhaseProperty = Literal["density", "heat_capacity", "conductivity", "viscosity"]

GAS_CONSTANT = 8.314462618  # [J/(mol K)]
ATMOSPHERE = 101325.0  # [Pa]
# Sulphur in liquid iron: Sahoo, DebRoy, McNallan 1988, Metall. Trans. B 19, 483; paper (50), units mended.
SULPHUR_K = 3.18e-3  # entropy factor of K = k exp(heat / (R T)), a_s in wt% [-]
SULPHUR_HEAT = 1.66e5  # minus the standard heat of adsorption [J/mol]
SULPHUR_EXCESS = 1.3e-5  # surface excess at saturation, Gamma_s [mol/m^2]


def evaluate(law: Law, temperature: ArrayLike) -> Array:
    """Value of ``law`` at ``temperature`` [K]; a table is constant outside its rows."""
    T = np.asarray(temperature, dtype=np.float64)
    if law.constant is not None:
        return np.full_like(T, law.constant)
    if law.polynomial is not None:
        return np.zeros_like(T) + polynomial.polyval(T, _coefficients(law.polynomial))
    if law.line is not None:
        return law.line.value + law.line.slope * (T - law.line.at)
    if law.table is not None:
        rows = np.asarray(law.table, dtype=np.float64)
        return np.asarray(np.interp(T, rows[:, 0], rows[:, 1]), dtype=np.float64)
    if law.log10_arrhenius is not None:
        a, b, unit = law.log10_arrhenius
        return np.asarray(unit * 10.0 ** np.minimum(a / T + b, 300.0), dtype=np.float64)
    assert law.sulphur is not None  # the schema holds exactly one form
    return _sulphur(law.sulphur, T)


def slope(law: Law, temperature: ArrayLike) -> Array:
    """Derivative of ``law`` by temperature [K]; at a row of a table, that of the piece to the right."""
    T = np.asarray(temperature, dtype=np.float64)
    if law.constant is not None:
        return np.zeros_like(T)
    if law.polynomial is not None:
        derivative = polynomial.polyder(_coefficients(law.polynomial))
        return np.zeros_like(T) + polynomial.polyval(T, derivative)
    if law.line is not None:
        return np.full_like(T, law.line.slope)
    if law.table is not None:
        rows = np.asarray(law.table, dtype=np.float64)
        pieces = np.concatenate(([0.0], np.diff(rows[:, 1]) / np.diff(rows[:, 0]), [0.0]))
        return np.asarray(pieces[np.searchsorted(rows[:, 0], T, side="right")], dtype=np.float64)
    if law.log10_arrhenius is not None:
        return np.asarray(-np.log(10.0) * law.log10_arrhenius[0] / T**2 * evaluate(law, T), dtype=np.float64)
    assert law.sulphur is not None
    return _sulphur_slope(law.sulphur, T)


def _coefficients(values: list[Any]) -> Array:
    return np.asarray(values or [0.0], dtype=np.float64)


def _sulphur(law: Sulphur, T: Array) -> Array:
    """Surface tension [N/m], paper eq. (50): sigma = pure - A (T - T_m) - R T Gamma_s ln(1 + K a_s)."""
    coverage = _sulphur_logarithm(law, T)
    reduction = GAS_CONSTANT * SULPHUR_EXCESS * T * coverage
    return np.asarray(law.pure - law.slope * (T - law.melting_temperature) - reduction, dtype=np.float64)


def _sulphur_slope(law: Sulphur, T: Array) -> Array:
    """d sigma/dT [N/(m K)] of (50): -A - R Gamma_s ln(1 + K a_s) + [K a_s/(1 + K a_s)] Gamma_s 1.66e5/T."""
    coverage = _sulphur_logarithm(law, T)
    occupied = -np.expm1(-coverage)  # K a_s/(1 + K a_s)
    gain = occupied * SULPHUR_EXCESS * SULPHUR_HEAT / T
    return np.asarray(-law.slope - GAS_CONSTANT * SULPHUR_EXCESS * coverage + gain, dtype=np.float64)


def _sulphur_logarithm(law: Sulphur, T: Array) -> Array:
    """ln(1 + K a_s), K = 3.18e-3 exp(1.66e5/(R T)), without overflow at low temperature."""
    if law.sulphur_wt_percent == 0.0:
        return np.zeros_like(T)
    exponent = np.log(SULPHUR_K * law.sulphur_wt_percent) + SULPHUR_HEAT / (GAS_CONSTANT * T)
    return np.asarray(np.logaddexp(0.0, exponent), dtype=np.float64)


def liquid_fraction(material: Material, temperature: ArrayLike) -> Array:
    """s [-], paper (40), limits T_m +- dT/2: 0 below the solidus, 1 above the liquidus, linear between."""
    T = np.asarray(temperature, dtype=np.float64)
    if material.solidus is None or material.liquidus is None:
        return np.ones_like(T)
    return np.asarray(np.clip((T - material.solidus) / (material.liquidus - material.solidus), 0.0, 1.0))


def phase_value(material: Material, quantity: PhaseProperty, temperature: ArrayLike) -> Array:
    """A property [SI] in whatever phase the temperature [K] says.

    The solid's law below the solidus, the liquid's above the liquidus, in the mushy zone linear in T between
    their end values (paper section 3.3 and eq. 49). The viscosity of the solid is its value at the solidus:
    ``mushy_viscosity_factor`` times that of the liquid, or the solid's law there.
    """
    T = np.asarray(temperature, dtype=np.float64)
    law = getattr(material, quantity)
    factor = material.scale.get(quantity, 1.0)
    if material.solidus is None or material.liquidus is None:
        return factor * evaluate(law.liquid, T)
    solidus, liquidus = material.solidus, material.liquidus
    at_liquidus = evaluate(law.liquid, liquidus)
    if quantity == "viscosity":
        if material.mushy_viscosity_factor is not None:
            solid = np.full_like(T, material.mushy_viscosity_factor * at_liquidus)
        else:
            solid = np.full_like(T, at_liquidus if law.solid is None else evaluate(law.solid, solidus))
        at_solidus = solid.flat[0] if solid.size else at_liquidus
    else:
        solid_law = law.liquid if law.solid is None else law.solid
        solid, at_solidus = evaluate(solid_law, np.minimum(T, solidus)), evaluate(solid_law, solidus)
    liquid = evaluate(law.liquid, np.maximum(T, liquidus))
    s = liquid_fraction(material, T)
    mushy = at_solidus + s * (at_liquidus - at_solidus)
    return np.asarray(factor * np.where(s <= 0.0, solid, np.where(s >= 1.0, liquid, mushy)), dtype=np.float64)


def surface_tension(material: Material, temperature: ArrayLike) -> Array:
    """sigma [N/m] at temperature [K]; zero without a law and where the law falls below zero."""
    T = np.asarray(temperature, dtype=np.float64)
    if material.surface_tension is None:
        return np.zeros_like(T)
    factor = material.scale.get("surface_tension", 1.0)
    return np.asarray(factor * np.maximum(evaluate(material.surface_tension, T), 0.0), dtype=np.float64)


def surface_tension_slope(material: Material, temperature: ArrayLike) -> Array:
    """d sigma/dT [N/(m K)] at temperature [K]; zero where the surface tension is."""
    T = np.asarray(temperature, dtype=np.float64)
    if material.surface_tension is None:
        return np.zeros_like(T)
    factor = material.scale.get("surface_tension", 1.0)
    exists = evaluate(material.surface_tension, T) > 0.0
    return np.asarray(np.where(exists, factor * slope(material.surface_tension, T), 0.0), dtype=np.float64)


def saturation_pressure(data: Evaporation, temperature: ArrayLike) -> Array:
    """p_sat [Pa] of the vapour at temperature [K], Clausius-Clapeyron: one atmosphere where the metal boils."""
    T = np.asarray(temperature, dtype=np.float64)
    slope = data.latent_heat * data.molar_mass / GAS_CONSTANT
    return np.asarray(
        ATMOSPHERE * np.exp(slope * (1.0 / data.boiling_temperature - 1.0 / T)), dtype=np.float64
    )
