"""Heat conduction between particles of unlike conductivity.

Equation   Q_a = V_a Sum_b V_b 4 k_a k_b/(k_a + k_b) (T_a - T_b) F / M                            (38)
           within one material: V_a Sum_b V_b 2 (phi_a - phi_b) F / M,  phi = integral of k dT     Kirchhoff
           M is the lattice moment (0.964 in 2-D, 0.985 in 3-D at h/dx 1.2), 1 as printed
Source     Cleary, Monaghan 1999, J. Comput. Phys. 148, 227
Reads      temperature [K], conductivity [W/(m K)], kirchhoff [W/m], volume     Writes  heating [W]
Skipped    cold particles: those at the initial temperature with no warmer neighbour
Checked    sine decay; two-phase Neumann melting
"""

from typing import Any

from taichi_slm.backend import ti


def stable_dt(h: float, rho_c: float, k: float, factor: float) -> float:
    """Explicit limit factor rho c h^2/k [s], eq. (44); 0.325 is the edge in 2-D."""
    return factor * rho_c * h**2 / k


def pair_conduction(kirchhoff: bool, one_material: bool, moment: float) -> Any:
    """The Taichi function (same material, T_a, T_b, k_a, k_b, phi_a, phi_b) -> factor of V_a V_b F [W/m]."""

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
