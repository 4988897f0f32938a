"""Equation of state: weakly compressible about a reference density that follows temperature.

Equation   p = c0^2 (rho - rho0(T))                                                    (9)
Source     Russell, Souto-Iglesias, Zohdi 2018, CMAME 341, eq. (9); (6) has wrong units unless gamma = 1
Reads      density [kg/m^3], reference_density [kg/m^3]      Writes  pressure [Pa]
Skipped    where nothing moves
Checked    droplet_thermal_cycle: the volume follows M/rho0(T)
"""

from typing import Any

from taichi_slm.backend import ti


def stable_dt(h: float, sound_speed: float, courant: float) -> float:
    """Acoustic limit courant h/c0 [s], eq. (41); ``h`` [m], ``sound_speed`` [m/s]."""
    return courant * h / sound_speed


def pressure_of(sound_speed: float) -> Any:
    """The Taichi function (rho, rho0) -> p [Pa]."""
    stiffness = sound_speed**2

    @ti.func
    def pressure(rho, rho0):
        return stiffness * (rho - rho0)

    return pressure
