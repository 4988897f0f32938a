"""Radiation of the surface to the surroundings.

Equation   Q_a = -eps sigma_SB (T^4 - T_inf^4) A_a V_a                                            (34), corrected
           A_a = |n_a| q^(d-1)/(1 + kappa s/2),  q = 1 + kappa_s s/(d-1),  kappa = kappa_s/q
           kappa_s = -Sum' V_b (n^_b - n^_a) . F r_ab / Sum' V_b W, Sum' over those with a normal
           h_s |n_a| = G(s) (1 + kappa s/2): s is the depth of the particle, G as below a flat surface
Printed    (T - T_inf)^4 (`radiation_law: printed`); the printed sign would heat, and is not offered
           A_a = |n_a| (`surface_area: plain`)
Source     the area is this project's: |n| lives up to h_s inside a curved surface, where the parallel surface is
           smaller by q^(d-1), so that Sum V |n| is 0.81 of the area of a ball of R/dx 5. 1 + kappa s/2 is what a
           curvature makes of |n| at depth s, to first order and for any kernel. Below a flat surface A_a = |n_a|
Reads      temperature [K], colour_strength [1/m], normal, volume      Writes  heating, radiated [W]
Skipped    inside the metal
Checked    radiating_drop: closed form of the cooling time; areas of discs, balls, hollows and blocks
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


def area_density(dimension: int, depth: Any) -> Any:
    """The Taichi function (|grad c|, kappa_s) [1/m] -> surface area per volume of metal [1/m].

    kappa_s: sum of the principal curvatures of the parallel surface at the particle, positive on a drop. ``depth`` is
    the Taichi function |grad c| -> depth below a flat surface [m]. q is kept within 1/2 and 2, and what the curvature
    makes of |n| above 1/2: beyond, the surface is more curved than its layer is thick, and has no parallel surface.
    """
    others = float(dimension - 1)

    @ti.func
    def area(strength, kappa):
        seen = strength * 0.0 + 1.0  # |n| over that of a flat surface at the same depth
        ratio = seen  # radius of the surface over that of the parallel surface
        for _ in ti.static(
            range(2)
        ):  # the depth depends on it weakly: a third round changes the area by 1e-3
            s = depth(strength / seen)
            ratio = ti.min(ti.max(1.0 + kappa * s / others, 0.5), 2.0)
            seen = ti.max(1.0 + 0.5 * kappa * s / ratio, 0.5)
        return strength * ratio ** (dimension - 1) / seen

    return area
