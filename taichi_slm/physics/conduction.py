"""Heat conduction between particles of unlike conductivity.

Equation   Q_a = V_a Sum_b V_b 4 k_a k_b/(k_a + k_b) (T_a - T_b) F g_ab                           (38)
           within one material: V_a Sum_b V_b 2 (phi_a - phi_b) F g_ab,  phi = integral of k dT    Kirchhoff
           g_ab = (1/m_a + 1/m_b)/2,  m_a = tr M_a/d, at a surface (tr M_a - e.M_a e)/(d - 1):
           the moment M_a = Sum V (-F) r r of its own neighbours, at a surface along it
Printed    g_ab = 1 (`conduction_correction: false`); `conduction_moment: lattice`: g_ab = 1/M, the same for all,
           M the moment of a full lattice (0.964 in 2-D, 0.985 in 3-D at h/dx 1.2)
Source     Cleary, Monaghan 1999, J. Comput. Phys. 148, 227; the own moment is this project's: at a surface half the
           neighbours are missing, and with M a layer of one spacing conducts too little along it
Reads      temperature [K], conductivity [W/(m K)], kirchhoff [W/m], volume     Writes  heating [W], conduction_factor
Skipped    cold particles: those at the initial temperature with no warmer neighbour
Checked    heat_decay; neumann; gaussian_source
"""

from itertools import product
from typing import Any

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.sph.kernel import Wendland


def stable_dt(h: float, rho_c: float, k: float, factor: float) -> float:
    """Explicit limit factor rho c h^2/k [s], eq. (44); 0.325 is the edge in 2-D."""
    return factor * rho_c * h**2 / k


def pair_conduction(kirchhoff: bool, one_material: bool, moment: float) -> Any:
    """The Taichi function (same material, T_a, T_b, k_a, k_b, phi_a, phi_b) -> factor of V_a V_b F g_ab."""

    @ti.func
    def harmonic(T_a, T_b, k_a, k_b):
        return 4.0 / moment * k_a * k_b / (k_a + k_b + 1e-30) * (T_a - T_b)

    @ti.func
    def flux(same, T_a, T_b, k_a, k_b, phi_a, phi_b):
        result = 2.0 / moment * (phi_a - phi_b)
        if ti.static(not kirchhoff):
            result = harmonic(T_a, T_b, k_a, k_b)
        elif ti.static(not one_material):
            if same == 0:
                result = harmonic(T_a, T_b, k_a, k_b)
        return result

    return flux


def side_asymmetry(kernel: Wendland, dx: float) -> float:
    """|Sum V (-F) r| / Sum V (-F) |r| in the innermost layer of a lattice that lacks neighbours; 0 further inside."""
    reach = int(kernel.support / dx * (1.0 - 1e-9))
    r = dx * np.array(list(product(range(-reach, reach + 1), repeat=kernel.dimension)), float)
    r = r[(r[:, -1] < (reach - 0.5) * dx) & np.any(r != 0.0, axis=1)]
    weight = -kernel.slope(np.linalg.norm(r, axis=1))
    return float(np.linalg.norm(weight @ r) / (weight @ np.linalg.norm(r, axis=1)))


def own_factor(dimension: int, full: float, asymmetry: float) -> Any:
    """The Taichi function (M_a, Sum V (-F) r, Sum V (-F) |r|) -> 1/m_a.

    e is the direction of Sum V (-F) r. From ``asymmetry`` on, that of the innermost layer that lacks neighbours, only
    the moment normal to e counts; where nothing is missing e is noise, and all directions count. m is at least half of
    that of a full lattice (``full``): a particle with fewer neighbours than a flat surface has is losing contact.
    """

    @ti.func
    def factor(moment, first, length):
        trace = moment.trace()
        mean = trace / dimension
        square = first.norm_sqr() + 1e-30 * (length * length + 1e-30)
        along = (trace - first.dot(moment @ first) / square) / (dimension - 1)
        share = ti.min(first.norm() / ((length + 1e-30) * asymmetry), 1.0)
        return 1.0 / ti.max(mean + share * (along - mean), 0.5 * full)

    return factor
