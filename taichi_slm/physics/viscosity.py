"""Viscosity between particles of unlike viscosity, with the phase's own value and a stiffer mush.

Equation   du_a/dt = (1/rho_a) Sum_b V_b 2 mu_a mu_b/(mu_a + mu_b) 2(d+2)/M
                     (u_ab . r_ab)/(r^2 + 0.01 h^2) F r_ab                                     (11),(12)
           M is the lattice moment of the operator (0.75 in 2-D, 0.83 in 3-D at h/dx 1.2), 1 as printed
Source     Monaghan, Gingold 1983, J. Comput. Phys. 52, 374; momentum is mu lap u, not 2 mu lap u as printed in (5)
Reads      velocity [m/s], viscosity [Pa s], volume      Writes  acceleration [m/s^2], viscous_work [J]
Skipped    where nothing moves
Checked    Poiseuille flow, Taylor-Green vortex, viscous heating (28), (36)
"""

from typing import Any

from taichi_slm.backend import ti


def stable_dt(h: float, mu: float, rho: float, factor: float) -> float:
    """Viscous limit factor rho h^2/mu [s], eq. (42); 0.125 is printed and unstable at h/dx 1.2, 0.08 stands."""
    return factor * rho * h**2 / mu


def artificial_viscosity(alpha: float, h: float, sound_speed: float, dimension: int) -> float:
    """Kinematic viscosity alpha h c0/(2(d+2)) [m^2/s] of Monaghan's artificial viscosity."""
    return alpha * h * sound_speed / (2.0 * (dimension + 2))


def pair_viscosity(dimension: int, h: float, moment: float) -> Any:
    """The Taichi function (mu_a, mu_b, u_ab . r_ab, r^2) -> the scalar that multiplies F r_ab [Pa]."""
    prefactor = 4.0 * (dimension + 2) / moment
    softening = 0.01 * h**2

    @ti.func
    def viscous(mu_a, mu_b, u_dot_r, r2):
        return prefactor * mu_a * mu_b / (mu_a + mu_b + 1e-30) * u_dot_r / (r2 + softening)

    return viscous
