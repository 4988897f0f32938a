"""Numbers that the discrete kernel sums miss: computed from the kernel and the lattice, never fitted.

All are host numbers, evaluated once when the step is built.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.integrate import trapezoid

from taichi_slm.sph.kernel import Wendland


def _offsets(dimension: int, reach: int) -> np.ndarray:
    """Integer lattice vectors other than zero, shape [n, dimension]."""
    points = np.array(list(product(range(-reach, reach + 1), repeat=dimension)), float)
    return points[np.any(points != 0, axis=1)]


def conduction_moment(kernel: Wendland, dx: float) -> float:
    """Sum V (-F) r^2 / d over a square lattice: what (38) makes of a unit Laplacian."""
    r = _offsets(kernel.dimension, int(kernel.support / dx) + 1) * dx
    distance = np.linalg.norm(r, axis=1)
    return float(np.sum(-kernel.slope(distance) * distance**2) * dx**kernel.dimension / kernel.dimension)


def viscosity_moment(kernel: Wendland, dx: float) -> float:
    """(d + 2) Sum V (-F) x^2 y^2 / (r^2 + 0.01 h^2): what (12) makes of a unit shear Laplacian."""
    r = _offsets(kernel.dimension, int(kernel.support / dx) + 1) * dx
    distance = np.linalg.norm(r, axis=1)
    terms = -kernel.slope(distance) * (r[:, 0] * r[:, 1]) ** 2 / (distance**2 + 0.01 * kernel.h**2)
    return float((kernel.dimension + 2) * np.sum(terms) * dx**kernel.dimension)


def shepard_sum(kernel: Wendland, dx: float) -> float:
    """Gamma = Sum V W of a full lattice, the particle itself included."""
    distance = np.linalg.norm(_offsets(kernel.dimension, int(kernel.support / dx) + 1), axis=1) * dx
    return float((np.sum(kernel.value(distance)) + kernel.value(0.0)) * dx**kernel.dimension)


def _planar_density(kernel: Wendland, depth: np.ndarray) -> np.ndarray:
    """Integral of W over the plane (line in 2-D) at ``depth`` from the particle [1/m]."""
    rho = np.linspace(0.0, kernel.support, 2001)
    weight = np.full_like(rho, 2.0) if kernel.dimension == 2 else 2.0 * np.pi * rho
    return np.array([trapezoid(kernel.value(np.hypot(s, rho)) * weight, rho) for s in depth])


@dataclass(frozen=True)
class FlatSurface:
    """What a particle below a flat surface sees, against g = h_s |grad c| / its largest value (at depth 0).

    ``depth`` [m] and ``shepard`` [-] are tabulated at ``knots`` values of g from 0 to 1.
    """

    largest: float
    depth: np.ndarray
    shepard: np.ndarray


def flat_surface(surface_kernel: Wendland, flow_kernel: Wendland, dx: float, knots: int = 257) -> FlatSurface:
    """Invert h_s |grad c|(depth), which falls monotonically from the surface inwards.

    Below the surface at depth s the plain colour gradient 2 Sum V grad W has the magnitude of twice the planar
    density of the kernel at s. The Shepard sum of the half space is scaled to that of the full lattice.
    """
    depth = np.linspace(0.0, surface_kernel.support, 1001)
    colour = 2.0 * surface_kernel.h * _planar_density(surface_kernel, depth)
    planar = _planar_density(flow_kernel, depth)
    half_space = 0.5 + np.concatenate([[0.0], np.cumsum(0.5 * (planar[1:] + planar[:-1]) * np.diff(depth))])
    g = np.linspace(0.0, 1.0, knots)
    falling = colour[::-1] / colour[0]
    depth_of_g = np.interp(g, falling, depth[::-1])
    shepard = np.interp(depth_of_g, depth, half_space) * shepard_sum(flow_kernel, dx)
    return FlatSurface(float(colour[0]), depth_of_g, shepard)
