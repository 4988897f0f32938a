"""The momentum pass: pressure, viscosity, gravity, surface forces -> acceleration; and the particle shifting.

One loop over neighbours. What it sums for a particle a besides the force:

crowding   Sum V grad W: zero where the particles are in order
push       -Sum V p grad W: what the pressure of the pairs does
gradient   of the velocity, from the mobile neighbours

Nothing in the loop asks whether a neighbour moves: walls show a velocity of their own, as everybody does, and what is
for the mobile ones alone is multiplied by 0 or 1. A branch there makes the pass half as long again.
"""

from typing import Any

from taichi_slm.backend import handed_out, ti
from taichi_slm.physics.pressure import pair_pressure
from taichi_slm.physics.shifting import displacement, shear_rate_of
from taichi_slm.physics.viscosity import pair_viscosity, viscous_weight
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import MOBILE, State, mover, reader


def compile_momentum(state: State, rows: Neighbours, disc: Discretisation) -> Any:
    """The kernel (mobile rows, dt [s], alone); ``dt`` is the time over which viscous heat is collected."""
    needs, gravity, up = state.needs, disc.gravity, disc.dimension - 1
    moment = disc.gradient_moment
    _, F = disc.flow_kernel.functions()
    shepard, pressure = _pressure_between(state, disc)
    viscosity, viscous = _viscosity_between(state, disc)
    mover_of = mover(state)
    shown = state.shown_velocity if needs.shown_velocity else state.velocity
    put_in_order = _shifter(state, disc) if needs.shifting else None

    @handed_out
    @ti.kernel
    def momentum(mobile: ti.i32, dt: disc.real, alone: ti.template()):
        ti.loop_config(serialize=alone)
        for k in range(mobile):
            a = rows.rows[k]
            if state.mobility[a] == MOBILE:
                x, u = state.position[a], state.velocity[a]
                p_a, mu_a, gamma_a = state.pressure[a], viscosity(a), shepard(a)
                force, from_walls, crowding, push = u * 0.0, u * 0.0, u * 0.0, u * 0.0
                gradient = u.outer_product(u) * 0.0
                dissipated = u[0] * 0.0
                for j in range(rows.near_count[a]):
                    b = rows.near[a, j]
                    r, u_ab = x - state.position[b], u - shown[b]
                    r2 = r.norm_sqr()
                    slope = state.volume[b] * F(r2)
                    moves = mover_of(b)
                    stress = viscous(u_ab, b, mu_a, r, r2)
                    p = pressure(b, p_a, gamma_a) / moment
                    term = slope * (stress - p) * r
                    force += term
                    if ti.static(needs.still):
                        from_walls += (1.0 - moves) * term
                    if ti.static(needs.balanced or needs.shifting):
                        crowding += slope * r
                    if ti.static(needs.shifting):
                        push += slope * p * r
                        gradient -= moves * slope * u_ab.outer_product(r)
                    if ti.static(needs.viscous_heating):
                        work = stress * (u - state.velocity[b]).dot(r)
                        dissipated -= (1.0 - 0.5 * moves) * slope * work
                if ti.static(needs.balanced):  # the pressure gradient works on p_a + p_b - 2 background_a
                    background = 2.0 / moment * state.background[a] * crowding
                    state.surface_force[a] = state.tangential_force[a] + background
                if ti.static(needs.tension):
                    force += state.surface_force[a]
                acceleration = force / state.density[a]
                acceleration[up] -= gravity
                if ti.static(needs.printed_leapfrog):
                    state.acceleration_before[a] = state.acceleration[a]
                state.acceleration[a] = acceleration
                if ti.static(needs.still):
                    state.wall_force[a] = from_walls * state.volume[a]
                if ti.static(needs.viscous_heating):
                    state.viscous_work[a] += dt * dissipated * state.volume[a]
                if ti.static(needs.shifting):
                    put_in_order(a, p_a, crowding, push, gradient, dt)

    return momentum


def _pressure_between(state: State, disc: Discretisation) -> tuple[Any, Any]:
    """The Taichi functions a -> Gamma_a (1 where the form has none) and (b, p_a, Gamma_a) -> pressure of the pair."""
    of_pair = pair_pressure(disc.numerics.pressure_form)
    gamma_form = disc.numerics.pressure_form == "gamma"

    @ti.func
    def shepard(a):
        result = state.pressure[a] * 0.0 + 1.0
        if ti.static(gamma_form):
            result = state.shepard[a]
        return result

    @ti.func
    def pressure(b, p_a, gamma_a):
        return of_pair(p_a, state.pressure[b], gamma_a, shepard(b))

    return shepard, pressure


def _viscosity_between(state: State, disc: Discretisation) -> tuple[Any, Any]:
    """The Taichi functions a -> mu_a [Pa s] and (u_ab, b, mu_a, r_ab, r^2) -> stress [Pa]; 0 without viscosity."""
    form, corrected = disc.numerics.viscosity_form, disc.numerics.viscosity_correction
    of_pair = pair_viscosity(viscous_weight(disc.flow_kernel, form, corrected, disc.dx))

    has_some, viscosity = state.needs.viscosity, reader(state, "viscosity")

    @ti.func
    def stress(u_ab, b, mu_a, r, r2):
        result = r2 * 0.0
        if ti.static(has_some):
            result = of_pair(mu_a, viscosity(b), u_ab.dot(r), r2)
        return result

    return viscosity, stress


def _shifter(state: State, disc: Discretisation) -> Any:
    """The Taichi function that writes the shift of a, and lets its density follow so that its pressure field stays."""
    shift, shear_rate = displacement(disc.shifting, disc.h), shear_rate_of(disc.dimension)
    moment, sound_speed2 = disc.gradient_moment, disc.numerics.sound_speed**2

    @ti.func
    def put_in_order(a, p_a, crowding, push, gradient, dt):
        by = shift(crowding, state.normal[a], shear_rate(gradient), dt)
        state.shift[a] = by
        # the pressure stays where it was; its gradient is that of the differences
        state.density[a] += by.dot(push - 2.0 / moment * p_a * crowding) / sound_speed2

    return put_in_order
