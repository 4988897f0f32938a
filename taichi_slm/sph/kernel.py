"""The Wendland C2 kernel (Wendland 1995), the one smoothing function of the paper.

    W(r)      = alpha t^4 (2 q + 1),   t = 1 - q/2,   q = r/h < 2
    grad_a W  = F(r) r_ab,             F = -5 alpha t^3 / h^2   (never positive)

alpha = 7/(4 pi h^2) in 2-D, 21/(16 pi h^3) in 3-D. The support is 2 h.
"""

import math
from typing import Any

import numpy as np

from taichi_slm.backend import ti


class Wendland:
    """A kernel of fixed smoothing length ``h`` [m] in ``dimension`` 2 or 3.

    ``value`` and ``slope`` are numpy; ``W`` and ``F`` are the Taichi functions of r^2 [m^2].
    """

    def __init__(self, dimension: int, h: float):
        self.dimension = dimension
        self.h = h
        self.support = 2.0 * h
        self.alpha = 7.0 / (4.0 * math.pi * h**2) if dimension == 2 else 21.0 / (16.0 * math.pi * h**3)

    def value(self, r: Any) -> np.ndarray:
        """W(r) [1/m^d] at distances ``r`` [m]."""
        q = np.asarray(r, float) / self.h
        t = np.maximum(0.0, 1.0 - 0.5 * q)
        return self.alpha * t**4 * (2.0 * q + 1.0)

    def slope(self, r: Any) -> np.ndarray:
        """F(r) [1/m^(d+2)], the gradient divided by the distance."""
        t = np.maximum(0.0, 1.0 - 0.5 * np.asarray(r, float) / self.h)
        return -5.0 * self.alpha / self.h**2 * t**3

    def functions(self) -> tuple[Any, Any]:
        """Return the Taichi functions (W, F) of r^2; zero beyond the support without a branch."""
        alpha = self.alpha
        inverse_h = 1.0 / self.h
        slope = -5.0 * self.alpha / self.h**2

        @ti.func
        def W(r2):
            q = ti.sqrt(r2) * inverse_h
            t = ti.max(0.0, 1.0 - 0.5 * q)
            t2 = t * t
            return alpha * t2 * t2 * (2.0 * q + 1.0)

        @ti.func
        def F(r2):
            t = ti.max(0.0, 1.0 - 0.5 * inverse_h * ti.sqrt(r2))
            return slope * t * t * t

        return W, F
