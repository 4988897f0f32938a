"""Marangoni force: the surface is drawn from low to high surface tension.

Equation   grad T_a = L_a Sum_b V_b (T_b - T_a) F r_ab,  L the inverse of Sum_b V_b (-F) r_ab r_ab^T    (26), corrected
           f = (dsigma/dT)(grad T - (grad T . n^) n^) |n|, only where a normal exists             (19),(27)
Printed    1/Gamma_a in place of L (`temperature_gradient: gamma`); its T_a and sign are slips and not offered
Source     Tong, Browne 2014, Int. J. Heat Mass Transf. 73, 284
Reads      temperature [K], normal, colour_strength, surface_tension_slope [N/(m K)]     Writes  surface_force
Skipped    with surface tension; where dsigma/dT is zero for every material
Checked    isolated drop in a temperature gradient
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
