"""What a scene is once built: particles as numpy arrays, in SI, seeded and the same on every machine."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.config.material import Material


@dataclass(frozen=True)
class Scene:
    """Particles at time zero.

    The vertical is the last coordinate (y in 2-D, z in 3-D); the plate's top is at 0. In 2-D a mass is per
    unit depth [kg/m]. An array whose rows are all the same is a read-only view of one row.
    """

    dimension: int
    spacing: float  # dx [m]
    lower: np.ndarray  # domain [m], shape [dimension]
    upper: np.ndarray  # domain [m], shape [dimension]
    position: np.ndarray  # [m], shape [n, dimension]
    velocity: np.ndarray  # [m/s], shape [n, dimension]
    temperature: np.ndarray  # [K], shape [n]
    volume: np.ndarray  # [m^dimension], shape [n]; dx^dimension on a lattice
    material: np.ndarray  # index into materials, int32, shape [n]
    body: np.ndarray  # index into config.bodies, int32, shape [n]
    tracer: np.ndarray  # tracer group, int32, shape [n]
    wall: np.ndarray  # never moves, never melts; bool, shape [n]
    held: np.ndarray  # temperature held (Dirichlet); bool, shape [n]
    materials: tuple[Material, ...]
    follows_density: tuple[int, ...]  # bodies that start with the velocity of the first density rate
    programs: dict[int, Any]  # body -> imposed temperature program

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.position)
