"""Melting and freezing: the state of a particle follows from its enthalpy (or temperature).

Equation   T = T(H), exact for any step;  or dT = Q dt/(m c), c = (c_S + c_L)/2 + L/dT in the band    (39)
           s = (T - T_S)/(T_L - T_S), cut to 0..1                                                      (40)
           s > 0: the particle can move; s = 0: it stands still where it stopped and is a wall to the liquid
Source     Hashemi, Sliepcevich 1967 (apparent heat capacity); enthalpy method: Eyres et al. 1946
Reads      enthalpy [J/kg]      Writes  temperature, liquid_fraction, reference_density, conductivity, kirchhoff,
           viscosity, surface_tension, surface_tension_slope, mobility, ever_liquid, density, volume, velocity
Skipped    the properties of terms that a scene does not have; cold particles
Checked    adiabatic melt and freeze cycles to round-off; two-phase Neumann melting
"""

from typing import Any

from taichi_slm.backend import ti
from taichi_slm.physics.material import MaterialTables
from taichi_slm.state import MOBILE, REMOVED, STILL, WALL, State

READ_ALWAYS = ("density",)
READ_FLOW = ("viscosity",)
READ_TENSION = ("surface_tension", "surface_tension_slope")
READ_HEAT = ("kirchhoff", "heat_capacity", "enthalpy")


def needed_tables(state: State) -> tuple[str, ...]:
    """Names of the property tables that this scene reads."""
    names: tuple[str, ...] = READ_ALWAYS
    names += READ_FLOW if state.needs.viscosity else ()
    names += READ_TENSION if state.needs.tension else ()
    names += READ_HEAT if state.needs.heat else ()
    names += ("conductivity",) if state.needs.conductivity else ()
    return names


def property_setter(state: State, tables: MaterialTables, alpha_viscosity: float) -> Any:
    """The Taichi function (particle, T, everything) that writes the properties at temperature T.

    ``everything``: all of them, or those alone that conduction reads. ``alpha_viscosity``: kinematic artificial
    viscosity [m^2/s], added as rho times it.
    """
    needs = state.needs
    density = tables.reader("density")
    viscosity = tables.reader("viscosity") if needs.viscosity else None
    sigma = tables.reader("surface_tension") if needs.tension else None
    sigma_slope = tables.reader("surface_tension_slope") if needs.tension else None
    conductivity = tables.reader("conductivity") if needs.conductivity else None
    kirchhoff = tables.reader("kirchhoff") if needs.heat else None

    @ti.func
    def set_properties(a, T, everything: ti.template()):
        m = state.material[a]
        knot, fraction = tables.locate(m, T)
        state.temperature[a] = T
        if ti.static(needs.heat):
            state.kirchhoff[a] = kirchhoff(m, knot, fraction)
        if ti.static(needs.conductivity):
            state.conductivity[a] = conductivity(m, knot, fraction)
        if ti.static(everything):
            s = tables.liquid_fraction(m, T)
            state.liquid_fraction[a] = s
            if s >= 0.5:
                state.ever_liquid[a] = 1
            rho0 = density(m, knot, fraction)
            state.reference_density[a] = rho0
            if ti.static(needs.viscosity):
                state.viscosity[a] = viscosity(m, knot, fraction) + rho0 * alpha_viscosity
            if ti.static(needs.tension):
                state.surface_tension[a] = sigma(m, knot, fraction)
                state.surface_tension_slope[a] = sigma_slope(m, knot, fraction)

    return set_properties


def phase_setter(state: State) -> tuple[Any, Any]:
    """The Taichi functions (particle) -> 1 if it was halted because it froze; and -> 1 if it was let go.

    Freezing acts at once. A melted particle is let go when the lists are next built, for it must have one; the host
    has them built before its liquid fraction exceeds `RELEASE_BY`.
    """

    @ti.func
    def halt(a):
        frozen = 0
        if state.mobility[a] != REMOVED and state.liquid_fraction[a] <= 0.0:
            if state.mobility[a] == MOBILE:
                frozen = 1
                state.mobility[a] = STILL
                state.velocity[a] = state.velocity[a] * 0.0
                state.density_rate[a] = 0.0
            state.density[a] = state.reference_density[a]
            state.volume[a] = state.mass[a] / state.density[a]
        return frozen

    @ti.func
    def waits(a):
        """Whether the particle has melted and not been let go."""
        melted = state.mobility[a] == STILL and state.liquid_fraction[a] > 0.0
        return melted and (state.kind[a] & WALL) == 0

    return halt, waits


RELEASE_BY = 0.05  # liquid fraction; a mush of 95 % solid, ten times as viscous as the melt, hardly moves
