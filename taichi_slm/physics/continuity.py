"""Continuity with the delta-SPH diffusion of density, and the packing correction.

Equation   drho_a/dt = rho_a Sum_b V_b u_ab . F r_ab                                             (11)
           + 2 delta h c0 Sum_b V_b (rhobar_b - rhobar_a)(-F),  rhobar = rho - rho0(T)           (13)
           + eta (c0/h) rho_a clip(Gamma_a/Gamma_flat(depth) - 1, -0.1, 0.1)                     packing
Printed    the diffusion times rho_a once more (`delta_form: printed`)
Source     Antuono, Colagrossi, Marrone, Molteni 2010, Comput. Phys. Commun. 181, 532; the packing term is this
           project's: the density of the continuity equation drifts from the real packing, which starves conduction
Reads      velocity, density, reference_density, volume, colour_strength     Writes  density_rate, shepard
Skipped    where nothing moves; diffusion acts between mobile particles only
Checked    droplet_thermal_cycle, column_two_fluids; spot_weld_3ms: packing within 5 % of ideal
"""

from typing import Any

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.sph.lattice import FlatSurface

PACKING_BRACKET = 0.1  # the packing term speaks of drift, not of a void: beyond 10 % it does not grow


def diffusion(delta: float, h: float, sound_speed: float, printed: bool) -> Any:
    """The Taichi function (rhobar_a, rhobar_b, rho_a) -> the factor of V_b (-F) [kg m^2/(m^3 s)]."""
    strength = 2.0 * delta * h * sound_speed

    @ti.func
    def standard(rhobar_a, rhobar_b, rho_a):
        return strength * (rhobar_b - rhobar_a)

    @ti.func
    def times_density(rhobar_a, rhobar_b, rho_a):
        return strength * (rhobar_b - rhobar_a) * rho_a

    return times_density if printed else standard


def packing(rate: float, h: float, sound_speed: float, h_surface: float, flat: FlatSurface, real: Any) -> Any:
    """The Taichi function (Gamma, |grad c|, rho) -> (d rho/dt [kg/(m^3 s)] that restores the packing, clipped)."""
    ideal = flat_table(flat.shepard, flat, h_surface, real)
    strength = rate * sound_speed / h

    @ti.func
    def restoring(gamma, strength_of_colour, rho):
        excess = gamma / ideal(strength_of_colour) - 1.0
        bounded = ti.max(-PACKING_BRACKET, ti.min(PACKING_BRACKET, excess))
        return strength * rho * bounded, ti.cast(bounded != excess, ti.i32)

    return restoring


def flat_table(values: np.ndarray, flat: FlatSurface, h_surface: float, real: Any) -> Any:
    """The Taichi function |grad c| [1/m] -> one of the tables of a flat surface."""
    table = ti.field(real, shape=len(values))
    table.from_numpy(np.asarray(values, np.float32 if str(real) == "f32" else np.float64))
    intervals = len(values) - 1
    scale = h_surface / flat.largest * intervals

    @ti.func
    def read(strength_of_colour):
        place = ti.min(strength_of_colour * scale, intervals - 1e-6 * intervals)
        knot = ti.cast(place, ti.i32)
        return table[knot] + (place - knot) * (table[knot + 1] - table[knot])

    return read
