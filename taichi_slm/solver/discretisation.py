"""What every pass over neighbours needs from the scene: kernels, spacing, moments, which terms exist."""

from dataclasses import dataclass
from typing import Any

from taichi_slm.backend import Schedule
from taichi_slm.config.numerics import Numerics, Physics
from taichi_slm.sph.kernel import Wendland
from taichi_slm.sph.lattice import FlatSurface, conduction_moment, flat_surface


@dataclass(frozen=True)
class Discretisation:
    """Host numbers of the discretisation, SI."""

    dimension: int
    dx: float
    flow_kernel: Wendland
    surface_kernel: Wendland
    conduction_moment: float
    gradient_moment: float
    flat: FlatSurface
    physics: Physics
    numerics: Numerics
    gravity: float
    ambient: float
    shifting: float
    schedule: Schedule
    real: Any

    @property
    def uses_shepard(self) -> bool:
        """Whether a printed form divides by Gamma, so that walls need it too."""
        forms = (self.numerics.pressure_form, self.numerics.colour_gradient)
        return self.physics.flow and "gamma" in forms

    @property
    def h(self) -> float:
        """Smoothing length of flow and heat [m]."""
        return self.flow_kernel.h

    @property
    def h_surface(self) -> float:
        """Smoothing length of the surface terms [m]."""
        return self.surface_kernel.h


def discretise(dimension: int, dx: float, physics: Physics, numerics: Numerics, gravity: float, ambient: float,
               shifting: float, schedule: Schedule, real: Any) -> Discretisation:  # fmt: skip
    """Evaluate kernels, lattice moments and the flat-surface tables once."""
    flow = Wendland(dimension, numerics.smoothing * dx)
    surface = Wendland(dimension, numerics.surface_smoothing * dx)
    return Discretisation(
        dimension=dimension, dx=dx, flow_kernel=flow, surface_kernel=surface,
        conduction_moment=conduction_moment(flow, dx) if numerics.conduction_correction else 1.0,
        gradient_moment=conduction_moment(flow, dx) if numerics.gradient_correction else 1.0,
        flat=flat_surface(surface, flow, dx),
        physics=physics, numerics=numerics, gravity=gravity, ambient=ambient,
        shifting=shifting, schedule=schedule, real=real,
    )  # fmt: skip
