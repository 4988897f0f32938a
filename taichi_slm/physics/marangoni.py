"""Marangoni force: the surface is drawn from low to high surface tension.

Equation   grad T_a = L_a Sum_b V_b (T_b - T_a) F r_ab,  L the inverse of Sum_b V_b (-F) r_ab r_ab^T    (26), corrected
           f = (dsigma/dT)(grad T - (grad T . n^) n^) |n|, only where a normal exists             (19),(27)
           balanced: instead of |n| the sum that the viscous operator lacks at the surface (`missing_stress`)
Printed    |n| (`tension: body_force`); 1/Gamma_a in place of L (`temperature_gradient: gamma`); its T_a and sign are
           slips and not offered
Source     Tong, Browne 2014, Int. J. Heat Mass Transf. 73, 284
Reads      temperature [K], normal, colour_strength, surface_tension_slope [N/(m K)]     Writes  surface_force
Skipped    with surface tension; where dsigma/dT is zero for every material
Checked    isolated drop in a temperature gradient; thermocapillary return flow
"""

from typing import Any

from taichi_slm.backend import ti

SINGULAR = 0.02  # a smaller determinant of the moment matrix (ideal: 1) is a lone particle's: no gradient


def tangential_force() -> Any:
    """The Taichi function (dsigma/dT, grad T, n^, |n|) -> force per volume [N/m^d]."""

    @ti.func
    def force(slope, gradient, normal, strength):
        return slope * strength * (gradient - gradient.dot(normal) * normal)

    return force


def missing_stress(slope_of_flow: Any, weight: Any) -> Any:
    """The Taichi function (V_b, n^, r_ab) -> what r_ab r_ab^T is times in the matrix that makes a force of a stress.

    A liquid under the stress tau at its surface has the shear tau/mu below it. The viscous sum of a particle near the
    surface lacks the pairs outside; what they would have given for that shear is the force that the stress exerts:

        f_a = Sum_b V_b w(r^2) (n^ . r_ab) F (r_ab . tau) r_ab

    with ``weight`` w of the viscous term. So the flow has its true speed up to the outermost particle, where a force
    spread as |n| over h_s loses a sixth of it at R/dx 20.
    """

    @ti.func
    def factor(V, normal, r):
        r2 = r.norm_sqr()
        return V * slope_of_flow(r2) * weight(r2) * normal.dot(r)

    return factor


def renormalised_gradient(dimension: int) -> Any:
    """The Taichi function (Sum V (T_b - T_a) F r_ab, moment matrix) -> (grad T [K/m], 1 where singular)."""

    @ti.func
    def gradient(plain, moment):
        result = plain
        singular = ti.cast(moment.determinant() < SINGULAR, ti.i32)
        if singular == 0:
            result = moment.inverse() @ plain
        return result, singular

    return gradient
