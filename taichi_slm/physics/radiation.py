"""Radiation of the surface to the surroundings.

Equation   Q_a = -eps sigma_SB (T^4 - T_inf^4) |n_a| V_a                                          (34), corrected
Printed    (T - T_inf)^4 (`radiation_law: printed`); the printed sign would heat, and is not offered
Reads      temperature [K], colour_strength [1/m], volume      Writes  heating, radiated [W]
Skipped    inside the metal
Checked    radiating drop: closed form of the cooling time
"""

from typing import Any

from taichi_slm.backend import ti

STEFAN_BOLTZMANN = 5.670374419e-8  # [W/(m^2 K^4)], CODATA 2018


def radiated_flux(ambient: float, law: str) -> Any:
    """The Taichi function (emissivity, T) -> heat flux that leaves the surface [W/m^2]."""

    @ti.func
    def stefan_boltzmann(emissivity, T):
        return emissivity * STEFAN_BOLTZMANN * (T**4 - ambient**4)

    @ti.func
    def printed(emissivity, T):
        return emissivity * STEFAN_BOLTZMANN * (T - ambient) ** 4

    return printed if law == "printed" else stefan_boltzmann
