"""Particle shifting: particles that a flow has drawn out one way and squeezed another are put in order again.

Equation   dr_a = -min(S h^2 g dt, 0.1 h^2) Sum_b V_b F r_ab;  at a surface its tangential part, halved
           g = sqrt(2 D : D), D the deviatoric part of the strain rate: no shear, no shift; sound does not count
Source     Lind, Xu, Stansby, Rogers 2012, J. Comput. Phys. 231, 1499 (Fick's law); its rate is this project's
Reads      position, velocity, volume, normal     Writes  shift [m]
Skipped    where nothing moves; by default in a scene without surface tension
Checked    isolated drop in a temperature gradient: without it the flow crumples after some spacings of sliding.
           Elliptic drop: with S = 20 its axis is right to 0.3 %, without to 5 %. S = 200 was chosen on the first of
           these; a column at rest under gravity does not like it (its pressure gets 2 % too flat), hence the default.
Moves no mass between particles and no momentum: what a particle carries is displaced by about half a spacing per unit
of strain, a diffusion of some 0.1 dx^2 times the shear rate.
"""

from typing import Any

from taichi_slm.backend import ti

UNDER_TENSION = 200.0  # the default where there is surface tension: its pressure keeps no order there
LARGEST = 0.1  # of h^2 Sum V grad W: twice that much and the explicit spreading would overshoot
AT_SURFACE = (
    0.5  # share of the tangential shift that a surface particle makes: half of its neighbours are missing
)


def shear_rate_of(dimension: int) -> Any:
    """The Taichi function (velocity gradient) -> sqrt(2 D : D) [1/s]."""

    @ti.func
    def rate(gradient):
        strain = 0.5 * (gradient + gradient.transpose())
        mean = strain.trace() / dimension
        return ti.sqrt(2.0 * ti.max(strain.norm_sqr() - dimension * mean * mean, 0.0))

    return rate


def displacement(strength: float, h: float) -> Any:
    """The Taichi function (Sum V grad W, n^, shear rate, dt) -> dr [m]."""
    largest = LARGEST * h**2

    @ti.func
    def shift(crowding, normal, shear_rate, dt):
        along = crowding
        if normal.norm_sqr() > 0.5:
            along = AT_SURFACE * (crowding - crowding.dot(normal) * normal)
        return -ti.min(strength * h**2 * shear_rate * dt, largest) * along

    return shift
