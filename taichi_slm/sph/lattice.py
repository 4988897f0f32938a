"""Numbers that the discrete kernel sums miss: computed from the kernel and the lattice, never fitted.

All are host numbers, evaluated once when the step is built.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np  # scipy's roots and integrals would take 0.3 s of every start
from numpy.typing import ArrayLike

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


def viscous_moments(kernel: Wendland, softening: ArrayLike, dx: float) -> tuple[Any, Any]:
    """Sum V (-F) x^2 y^2/(r^2 + softening) for a shear along the rows of a lattice, and for one at 45 degrees.

    Numbers, or arrays of the shape of ``softening`` [m^2].
    With the softening 0.01 h^2 of (12) and h/dx 1.2 they are 0.750 and 1.157 of the true one in 2-D, 0.826 and 1.202 in
    3-D: the operator is not isotropic, and what it makes of a viscosity depends on how the particles lie.
    """
    r = _offsets(kernel.dimension, int(kernel.support / dx) + 1) * dx
    distance = np.linalg.norm(r, axis=1)
    softened = distance**2 + np.asarray(softening)[..., None]
    terms = -kernel.slope(distance) / softened * dx**kernel.dimension
    return terms @ (r[:, 0] * r[:, 1]) ** 2, terms @ (r[:, 0] ** 2 - r[:, 1] ** 2) ** 2 / 4.0


def viscous_moment(kernel: Wendland, softening: float, dx: float) -> float:
    """The mean of both over all directions: (along + across)/2 in 2-D, (3 along + 2 across)/5 in 3-D."""
    along, across = viscous_moments(kernel, softening, dx)
    return float((along + across) / 2.0 if kernel.dimension == 2 else (3.0 * along + 2.0 * across) / 5.0)


def isotropic_softening(kernel: Wendland, dx: float) -> float:
    """The softening [m^2] with which both moments are the same; the one of least difference where there is none.

    6.45 h^2 in 2-D and 4.0 h^2 in 3-D at h/dx 1.2. The weight 1/(r^2 + softening) is then almost constant over the
    support: near pairs, of which a lattice has few directions, count less.
    """

    def difference(softening: np.ndarray) -> np.ndarray:
        along, across = viscous_moments(kernel, softening, dx)
        return along / across - 1.0

    choices = np.geomspace(0.01, 1e3, 200) * kernel.h**2
    found = difference(choices)
    if np.all(found > 0) or np.all(found < 0):
        return float(choices[np.argmin(np.abs(found))])
    for _ in range(3):  # a 200th of the interval each time; what is left of it is straight to round-off
        first = np.flatnonzero(np.diff(np.sign(found)))[0]
        choices = np.linspace(choices[first], choices[first + 1], 201)
        found = difference(choices)
    return float(np.interp(0.0, found * np.sign(found[-1]), choices))


def shepard_sum(kernel: Wendland, dx: float) -> float:
    """Gamma = Sum V W of a full lattice, the particle itself included."""
    distance = np.linalg.norm(_offsets(kernel.dimension, int(kernel.support / dx) + 1), axis=1) * dx
    return float((np.sum(kernel.value(distance)) + kernel.value(0.0)) * dx**kernel.dimension)


def _planar_density(kernel: Wendland, depth: np.ndarray) -> np.ndarray:
    """Integral of W over the plane (line in 2-D) at ``depth`` from the particle [1/m]."""
    rho = np.linspace(0.0, kernel.support, 2001)
    weight = np.full_like(rho, 2.0) if kernel.dimension == 2 else 2.0 * np.pi * rho
    return np.array([np.trapezoid(kernel.value(np.hypot(s, rho)) * weight, rho) for s in depth])


@dataclass(frozen=True)
class FlatSurface:
    """What a particle below a flat surface sees, against g = h_s |grad c| / its largest value (at depth 0).

    ``depth`` [m] and ``shepard`` [-] are tabulated at ``knots`` values of g from 0 to 1.
    """

    largest: float
    depth: np.ndarray
    shepard: np.ndarray


# normals of the planes, as whole numbers without a common factor
_PLANES = {2: ((0, 1), (1, 1), (1, 2)), 3: ((0, 0, 1), (0, 1, 1), (1, 1, 1), (0, 1, 2))}


def flat_surface(surface_kernel: Wendland, flow_kernel: Wendland, dx: float, knots: int = 257) -> FlatSurface:
    """Invert h_s |grad c|(depth), which falls monotonically from the surface inwards.

    Below the surface at depth s the plain colour gradient 2 Sum V grad W has the magnitude of twice the planar
    density of the kernel at s. The Shepard sum is that of lattices cut along several planes: the integral of the half
    space would be 7 % too small for the outermost layer.
    """
    depth = np.linspace(0.0, surface_kernel.support, 1001)
    colour = 2.0 * surface_kernel.h * _planar_density(surface_kernel, depth)
    g = np.linspace(0.0, 1.0, knots)
    falling = colour[::-1] / colour[0]
    depth_of_g = np.interp(g, falling, depth[::-1])
    seen, sums = _cut_lattices(surface_kernel, flow_kernel, dx)
    return FlatSurface(float(colour[0]), depth_of_g, np.interp(g, seen * surface_kernel.h / colour[0], sums))


def _cut_lattices(
    surface_kernel: Wendland, flow_kernel: Wendland, dx: float
) -> tuple[np.ndarray, np.ndarray]:
    """|grad c| [1/m] and Shepard sum of the layers below the flat faces of cut lattices, by rising |grad c|."""
    d = flow_kernel.dimension
    offsets = _offsets(d, int(surface_kernel.support / dx) + 1)
    full = shepard_sum(flow_kernel, dx)
    found = [(0.0, full)]
    for plane in _PLANES[d]:
        height = offsets @ np.array(plane)  # in layers
        for layer in range(int(surface_kernel.support / dx * np.linalg.norm(plane)) + 1):
            r = -offsets[height <= layer] * dx
            distance = np.linalg.norm(r, axis=1)
            gradient = 2.0 * dx**d * (surface_kernel.slope(distance) @ r)
            gamma = dx**d * (np.sum(flow_kernel.value(distance)) + flow_kernel.value(0.0))
            found.append((float(np.linalg.norm(gradient)), float(gamma)))
    seen, sums = np.array(sorted(found)).T
    return seen, np.minimum.accumulate(sums)  # deeper is fuller; planes differ by a few tenths of a per cent
