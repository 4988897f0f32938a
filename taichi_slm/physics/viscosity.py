"""Viscosity between particles of unlike viscosity, with the phase's own value and a stiffer mush.

Equation   du_a/dt = (1/rho_a) Sum_b V_b 2 mu_a mu_b/(mu_a + mu_b) (2/M) (u_ab . r_ab)/(r^2 + s) F r_ab   (11),(12)
           s is the softening that makes the sum isotropic on a lattice (6.45 h^2 in 2-D, 4.0 h^2 in 3-D at h/dx 1.2)
           and M the moment of the sum. At a wall u_b is the one that puts the no-slip plane at its face.
Printed    s = 0.01 h^2, 1/M = d + 2 (`viscosity_form: printed`), whose shear along the rows of a lattice is 24 % too
           small and at 45 degrees 16 % too large; `viscosity_correction` divides it by the mean of all directions
Source     Monaghan, Gingold 1983, J. Comput. Phys. 52, 374; momentum is mu lap u, not 2 mu lap u as printed in (5)
Reads      velocity [m/s], viscosity [Pa s], volume      Writes  acceleration [m/s^2], viscous_work [J]
Skipped    where nothing moves
Checked    Poiseuille flow, Taylor-Green vortex, viscous heating (28), (36)
"""

from typing import Any

from taichi_slm.backend import ti
from taichi_slm.sph.kernel import Wendland
from taichi_slm.sph.lattice import isotropic_softening, viscous_moment


def stable_dt(h: float, mu: float, rho: float, factor: float) -> float:
    """Viscous limit factor rho h^2/mu [s], eq. (42); 0.125 is printed and unstable at h/dx 1.2, 0.08 stands."""
    return factor * rho * h**2 / mu


def artificial_viscosity(alpha: float, h: float, sound_speed: float, dimension: int) -> float:
    """Kinematic viscosity alpha h c0/(2(d+2)) [m^2/s] of Monaghan's artificial viscosity."""
    return alpha * h * sound_speed / (2.0 * (dimension + 2))


def viscous_weight(kernel: Wendland, form: str, corrected: bool, dx: float) -> Any:
    """The Taichi function r^2 -> what multiplies mu (u_ab . r_ab) F r_ab [1/m^2]."""
    softening = isotropic_softening(kernel, dx) if form == "isotropic" else 0.01 * kernel.h**2
    scale = 2.0 * (kernel.dimension + 2)
    if corrected or form == "isotropic":
        scale = 2.0 / viscous_moment(kernel, softening, dx)

    @ti.func
    def weight(r2):
        return scale / (r2 + softening)

    return weight


def pair_viscosity(weight: Any) -> Any:
    """The Taichi function (mu_a, mu_b, u_ab . r_ab, r^2) -> the scalar that multiplies F r_ab [Pa]."""

    @ti.func
    def viscous(mu_a, mu_b, u_dot_r, r2):
        return 2.0 * mu_a * mu_b / (mu_a + mu_b + 1e-30) * u_dot_r * weight(r2)

    return viscous


def wall_velocity(no_slip: bool) -> Any:
    """The Taichi function (mean velocity of the liquid beside a wall particle, direction away from the liquid) -> u_w.

    What a wall particle shows to the viscous stress alone, so that the liquid's velocity (no slip) or the normal part
    of it (free slip) is zero at the face of the wall, half a spacing before its particles (Adami, Hu, Adams 2012).
    """

    @ti.func
    def opposed(mean, away):
        return -mean

    @ti.func
    def mirrored(mean, away):
        normal = away / ti.max(away.norm(), 1e-30)
        return mean - 2.0 * mean.dot(normal) * normal

    return opposed if no_slip else mirrored
