"""Evaporation: heat lost with the vapour, and its recoil on the surface. Optional; off in the paper's cases.

Equation   p_sat = 101325 exp[(L_v M/R)(1/T_v - 1/T)];  mass flux 0.82 p_sat sqrt(M/(2 pi R T))
           heat loss L_v times the mass flux;  recoil pressure 0.54 p_sat, along the inward normal
Source     Anisimov 1968; Knight 1979, AIAA J. 17, 519 (0.82 and 0.54 are its values at Mach 1)
Reads      temperature [K], colour_gradient      Writes  heating, evaporated [W]; surface_force [N/m^d]
Skipped    unless asked for (`physics.evaporation`, `physics.recoil`)
Checked    316L at its boiling point: 54,716 Pa, 48.85 kg/(m^2 s), 3.615e8 W/m^2
The vapour's mass is not taken from the particle: 49 kg/(m^2 s) for 100 us is 0.5 um of a 4 um particle.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.config.material import Evaporation
from taichi_slm.materials.laws import ATMOSPHERE, GAS_CONSTANT, saturation_pressure

RECOIL_SHARE = 0.54
ESCAPING_SHARE = 0.82


def heat_flux(data: Evaporation, temperature: float) -> float:
    """Heat carried away by the vapour [W/m^2] at ``temperature`` [K]."""
    per_pressure = ESCAPING_SHARE * math.sqrt(data.molar_mass / (2.0 * math.pi * GAS_CONSTANT * temperature))
    return data.latent_heat * per_pressure * float(saturation_pressure(data, temperature))


def vapour(materials: Sequence[Evaporation | None], real: Any) -> tuple[Any, Any]:
    """The Taichi functions (material, T) -> evaporation heat flux [W/m^2] and recoil pressure [Pa]."""
    rows = np.zeros((len(materials), 3))
    for row, data in zip(rows, materials, strict=True):
        if data is not None:
            row[0] = data.latent_heat * data.molar_mass / GAS_CONSTANT
            row[1] = 1.0 / data.boiling_temperature
            factor = ESCAPING_SHARE * math.sqrt(data.molar_mass / (2.0 * math.pi * GAS_CONSTANT))
            row[2] = data.latent_heat * factor
    table = ti.field(real, shape=rows.shape)
    table.from_numpy(rows.astype(np.float32 if str(real) == "f32" else np.float64))

    @ti.func
    def saturation(m, T):
        pressure = ti.cast(0.0, real)
        if table[m, 0] > 0.0:
            pressure = ATMOSPHERE * ti.exp(table[m, 0] * (table[m, 1] - 1.0 / ti.max(T, 200.0)))
        return pressure

    @ti.func
    def flux(m, T):
        return table[m, 2] * saturation(m, T) / ti.sqrt(T)

    @ti.func
    def recoil(m, T):
        return RECOIL_SHARE * saturation(m, T)

    return flux, recoil
