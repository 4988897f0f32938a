"""Surface tension on a free surface (continuum surface force).

Equation   n_a = 2 Sum_b V_b F r_ab over all metal, h/dx 1.8 (inward)                            (20)
           n^ = n/|n| where h_s |n| > eps, else none                                             (21)
           kappa_a = Sum' V_b (n^_b - n^_a) . F r_ab / Sum' V_b W, Sum' over those with a normal  (22),(23)
           kappa <- kappa / max(1 - kappa s/(d-1), 1/2), s = depth of the particle: the surface's curvature,
           not that of the parallel surface at the particle's depth
           kappa clipped to +-(d-1)/(2 h_s), that of a ball of radius 2 h_s                      (24)
           balanced: b_a = -sigma kappa at the surface, carried inwards as the mean of the neighbours', and
           f = 2 b_a Sum_b V_b F r_ab/M, so that the pressure gradient works on (p_a + p_b - 2 b_a): a pressure equal
           to the capillary one does nothing, however the particles lie. With (25) it acts as a weak solid of about
           1 % of the pressure, which stops a Marangoni flow after some spacings of sliding.
Printed    f = -sigma kappa n (25) (`tension: body_force`),
           `colour_gradient: gamma`, `curvature: printed`, `curvature_clip: printed`, `depth_correction: false`
Source     Brackbill, Kothe, Zemach 1992, J. Comput. Phys. 100, 335; Morris 2000; the depth correction is this project's
Reads      position, volume, surface_tension [N/m]      Writes  colour_gradient, normal, curvature, surface_force
Skipped    away from surfaces; where nothing moves
Checked    static drop: Laplace jump; oscillating drop: period
"""

import math
from typing import Any

from taichi_slm.backend import ti


def stable_dt(h_surface: float, rho: float, sigma: float, factor: float) -> float:
    """Capillary limit factor sqrt(rho h_s^3/(2 pi sigma)) [s], eq. (43) with the root that the print lost."""
    return factor * math.sqrt(rho * h_surface**3 / (2.0 * math.pi * sigma)) if sigma > 0 else math.inf


def surface_weight(h_surface: float, cut: float) -> Any:
    """The Taichi function |grad c| -> how much a particle is of the surface: 0 at the cut of (21), 1 from cut + 0.3."""

    @ti.func
    def weight(strength):
        return ti.max(0.0, ti.min((strength * h_surface - cut) / 0.3, 1.0))

    return weight


def surface_curvature(
    dimension: int, h_surface: float, depth_correction: bool, two_sided: bool, depth: Any
) -> Any:
    """The Taichi function (sum n^, sum W, |grad c|) -> (kappa [1/m], 1 where clipped).

    ``depth`` is the Taichi function |grad c| -> depth below a flat surface [m].
    """
    # printed: 1/(2 h_s) in 3-D, too, where a ball of R/dx 7 has more, so that it swells without any restoring force
    limit = ((dimension - 1) if two_sided else 1) / (2.0 * h_surface)

    @ti.func
    def curvature(divergence, weight, strength):
        kappa = divergence / weight
        if ti.static(depth_correction):
            kappa /= ti.max(1.0 - kappa * depth(strength) / (dimension - 1), 0.5)
        bounded = ti.min(kappa, limit)
        if ti.static(two_sided):
            bounded = ti.max(bounded, -limit)
        return bounded, ti.cast(bounded != kappa, ti.i32)

    return curvature
