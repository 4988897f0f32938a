"""The flow passes: one loop over neighbours each, which calls one function per term.

advance     half drift, density, equation of state
walls       pressure of the still particles beside the liquid
momentum    pressure, viscosity, gravity, surface forces -> acceleration
kick        velocity, half drift
continuity  velocity divergence, diffusion, packing -> density rate
"""

from typing import Any

from taichi_slm.backend import ti
from taichi_slm.physics import continuity as continuity_terms
from taichi_slm.physics.equation_of_state import pressure_of
from taichi_slm.physics.pressure import pair_pressure, wall_pressure
from taichi_slm.physics.shifting import displacement, shear_rate_of
from taichi_slm.physics.viscosity import pair_viscosity, viscous_weight, wall_velocity
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import PACKING_BRACKETS, WALL_SUCTION, Ledger
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import MOBILE, State

LOST = 1e30  # `moved` when somebody has no finite place [m^2]


class FlowPasses:
    """The compiled passes; ``moved`` [m^2] is the largest squared displacement since the lists were built."""

    def __init__(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger):
        self.moved = ti.field(disc.real, shape=())
        self.fastest = ti.field(disc.real, shape=())  # largest squared speed of the last kick [m^2/s^2]
        self._rows = rows
        self._advance = self._compile_advance(state, rows, disc)
        self._walls = self._compile_walls(state, rows, disc, ledger)
        self._momentum = self._compile_momentum(state, rows, disc)
        self._kick = self._compile_kick(state, rows, disc, ledger)
        self._continuity = self._compile_continuity(state, rows, disc, ledger)

    def advance(self, drift: float, density: float) -> None:
        """Move positions by ``drift`` and densities by ``density`` [s] with their rates; then p by (9)."""
        self._advance(self._rows.mobile, drift, density)

    def walls(self) -> None:
        """Extrapolate the liquid's pressure to the still particles beside it."""
        self._walls(self._rows.flow)

    def momentum(self, dt: float) -> None:
        """Write accelerations; ``dt`` [s] is the time over which viscous heat is collected."""
        self._momentum(self._rows.mobile, dt)

    def kick(self, dt: float, dt_before: float, drift: float) -> None:
        """Velocities by ``dt`` (less half of ``dt_before`` for the printed leapfrog), positions by ``drift`` [s]."""
        self._kick(self._rows.mobile, dt, dt_before, drift)

    def continuity(self) -> None:
        """Write density rates and Shepard sums."""
        self._continuity(self._rows.mobile)

    def _compile_advance(self, state: State, rows: Neighbours, disc: Discretisation) -> Any:
        pressure = pressure_of(disc.numerics.sound_speed)
        serial, balanced = disc.ordered, state.needs.balanced

        @ti.kernel
        def advance(mobile: ti.i32, drift: disc.real, density: disc.real):
            ti.loop_config(serialize=serial)
            for k in range(mobile):
                a = rows.rows[k]
                if state.mobility[a] == MOBILE:
                    state.position[a] = state.position[a] + drift * state.velocity[a]
                    rho = state.density[a] + density * state.density_rate[a]
                    state.density[a] = rho
                    state.volume[a] = state.mass[a] / rho
                    state.pressure[a] = pressure(rho, state.reference_density[a])
                    if ti.static(balanced):
                        weight = state.at_surface[a]
                        state.background[a] = (
                            weight * state.capillary[a] + (1.0 - weight) * state.background_mean[a]
                        )

        return advance

    def _compile_walls(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger) -> Any:
        W, _ = disc.flow_kernel.functions()
        extrapolated = wall_pressure(disc.gravity, disc.dimension - 1)
        serial, uses_shepard = disc.serial, disc.uses_shepard
        at_zero = float(disc.flow_kernel.value(0.0))
        clamps, shows_velocity = ledger.clamps, state.needs.wall_velocity
        shown = wall_velocity(disc.numerics.walls == "no_slip")

        @ti.kernel
        def walls(flow: ti.i32):
            ti.loop_config(serialize=serial)
            for k in range(flow):
                a = rows.rows[k]
                if state.mobility[a] != MOBILE:
                    x = state.position[a]
                    total = x[0] * 0.0
                    weight = x[0] * 0.0
                    velocity = x * 0.0
                    away = x * 0.0
                    gamma = state.volume[a] * at_zero
                    for j in range(rows.near_count[a]):
                        b = rows.near[a, j]
                        if ti.static(uses_shepard):
                            gamma += state.volume[b] * W((x - state.position[b]).norm_sqr())
                        if state.mobility[b] == MOBILE:
                            r = x - state.position[b]
                            w = W(r.norm_sqr())
                            total += w * extrapolated(state.pressure[b], state.density[b], r)
                            weight += w
                            if ti.static(shows_velocity):
                                velocity += w * state.velocity[b]
                                away += w * r
                    p = total * 0.0
                    if weight > 0.0:
                        p = total / weight
                        if p < 0.0:  # a wall does not pull
                            p = 0.0
                            ti.atomic_add(clamps[WALL_SUCTION], 1)
                    state.pressure[a] = p
                    if ti.static(shows_velocity):
                        state.wall_velocity[a] = shown(velocity / ti.max(weight, 1e-30), away)
                    if ti.static(uses_shepard):
                        state.shepard[a] = gamma

        return walls

    def _compile_momentum(self, state: State, rows: Neighbours, disc: Discretisation) -> Any:
        d, numerics, needs = disc.dimension, disc.numerics, state.needs
        _, F = disc.flow_kernel.functions()
        pressure = pair_pressure(numerics.pressure_form)
        viscosity = pair_viscosity(
            viscous_weight(disc.flow_kernel, numerics.viscosity_form, numerics.viscosity_correction, disc.dx)
        )
        gamma_form = numerics.pressure_form == "gamma"
        gravity, serial = disc.gravity, disc.serial
        moment = disc.gradient_moment
        shift, shear_rate = displacement(disc.shifting, disc.h), shear_rate_of(d)
        sound_speed2 = numerics.sound_speed**2

        @ti.kernel
        def momentum(mobile: ti.i32, dt: disc.real):
            ti.loop_config(serialize=serial)
            for k in range(mobile):
                a = rows.rows[k]
                if state.mobility[a] == MOBILE:
                    x = state.position[a]
                    u = state.velocity[a]
                    p_a = state.pressure[a]
                    mu_a = state.viscosity[a]
                    gamma_a = x[0] * 0.0 + 1.0
                    if ti.static(gamma_form):
                        gamma_a = state.shepard[a]
                    force = u * 0.0
                    from_walls = u * 0.0
                    crowding = u * 0.0  # Sum V grad W: zero where the particles are in order
                    push = u * 0.0
                    gradient = u.outer_product(u) * 0.0  # of the velocity
                    dissipated = u[0] * 0.0
                    for j in range(rows.near_count[a]):
                        b = rows.near[a, j]
                        r = x - state.position[b]
                        r2 = r.norm_sqr()
                        slope = state.volume[b] * F(r2)
                        gamma_b = x[0] * 0.0 + 1.0
                        if ti.static(gamma_form):
                            gamma_b = state.shepard[b]
                        u_dot_r = (u - state.velocity[b]).dot(r)
                        sheared = u_dot_r
                        moves = ti.cast(state.mobility[b] == MOBILE, disc.real)
                        if ti.static(needs.wall_velocity):
                            if state.mobility[b] != MOBILE:
                                sheared = (u - state.wall_velocity[b]).dot(r)
                        stress = viscosity(mu_a, state.viscosity[b], sheared, r2)
                        p = pressure(p_a, state.pressure[b], gamma_a, gamma_b) / moment
                        term = slope * (stress - p) * r
                        force += term
                        if ti.static(needs.shifting):
                            push += slope * p * r
                        if ti.static(needs.balanced or needs.shifting):
                            crowding += slope * r
                        if ti.static(needs.shifting):
                            gradient -= moves * slope * (u - state.velocity[b]).outer_product(r)
                        from_walls += (1.0 - moves) * term
                        if ti.static(needs.viscous_heating):
                            dissipated -= (1.0 - 0.5 * moves) * slope * stress * u_dot_r
                    if ti.static(needs.balanced):
                        state.surface_force[a] = (
                            state.tangential_force[a] + 2.0 / moment * state.background[a] * crowding
                        )
                    if ti.static(needs.tension):
                        force += state.surface_force[a]
                    acceleration = force / state.density[a]
                    acceleration[d - 1] -= gravity
                    if ti.static(needs.shifting):
                        by = shift(crowding, state.normal[a], shear_rate(gradient), dt)
                        state.shift[a] = by
                        # the pressure stays where it was; its gradient is that of the differences
                        state.density[a] += by.dot(push - 2.0 / moment * p_a * crowding) / sound_speed2
                    if ti.static(needs.printed_leapfrog):
                        state.acceleration_before[a] = state.acceleration[a]
                    state.acceleration[a] = acceleration
                    state.wall_force[a] = from_walls * state.volume[a]
                    if ti.static(needs.viscous_heating):
                        state.viscous_work[a] += dt * dissipated * state.volume[a]

        return momentum

    def _compile_kick(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger) -> Any:
        d, printed, ordered = disc.dimension, state.needs.printed_leapfrog, disc.ordered
        moved, fastest, tension, gravity = self.moved, self.fastest, state.needs.tension, disc.gravity
        chunks = 1 if ordered else 1024
        shifts = state.needs.shifting

        @ti.kernel
        def kick(mobile: ti.i32, dt: disc.real, dt_before: disc.real, drift: disc.real):
            moved[None] = 0.0
            fastest[None] = 0.0
            ti.loop_config(serialize=ordered)
            for chunk in range(chunks):
                farthest = ti.cast(0.0, disc.real)
                speed2 = ti.cast(0.0, disc.real)
                weight = ti.cast(0.0, ti.f64)
                wall = ti.Vector.zero(ti.f64, d)
                surface = ti.Vector.zero(ti.f64, d)
                for k in range(chunk * mobile // chunks, (chunk + 1) * mobile // chunks):
                    a = rows.rows[k]
                    if state.mobility[a] == MOBILE:
                        u = state.velocity[a]
                        if ti.static(printed):
                            u -= 0.5 * dt_before * state.acceleration_before[a]
                        u += dt * state.acceleration[a]
                        x = state.position[a] + drift * u
                        if ti.static(shifts):
                            x += state.shift[a]
                        state.position[a] = x
                        if ti.static(printed):  # the velocity at the full step is an extrapolation
                            state.velocity[a] = u + 0.5 * dt * state.acceleration[a]
                        else:
                            state.velocity[a] = u
                        distance2 = (x - state.reference_position[a]).norm_sqr()
                        if ti.math.isnan(
                            distance2
                        ):  # a maximum would lose it; the next search names the particle
                            distance2 = LOST
                        farthest = ti.max(farthest, distance2)
                        speed2 = ti.max(speed2, u.norm_sqr())
                        weight += gravity * ti.cast(state.mass[a], ti.f64)
                        wall += ti.cast(state.wall_force[a], ti.f64)
                        if ti.static(tension):
                            surface += ti.cast(state.surface_force[a] * state.volume[a], ti.f64)
                ti.atomic_max(moved[None], farthest)
                ti.atomic_max(fastest[None], speed2)
                ledger.add_impulses(dt, weight, wall, surface)

        return kick

    def _compile_continuity(
        self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger
    ) -> Any:
        numerics = disc.numerics
        W, F = disc.flow_kernel.functions()
        diffusion = continuity_terms.diffusion(
            numerics.delta, disc.h, numerics.sound_speed, numerics.delta_form == "printed"
        )
        packed = state.needs.surface and numerics.packing_correction > 0
        restoring = (
            continuity_terms.packing(
                numerics.packing_correction,
                disc.h,
                numerics.sound_speed,
                disc.h_surface,
                disc.flat,
                disc.real,
            )
            if packed
            else None
        )
        at_zero = float(disc.flow_kernel.value(0.0))
        serial, clamps = disc.serial, ledger.clamps
        moment, balanced = disc.gradient_moment, state.needs.balanced

        @ti.kernel
        def continuity(mobile: ti.i32):
            ti.loop_config(serialize=serial)
            for k in range(mobile):
                a = rows.rows[k]
                if state.mobility[a] == MOBILE:
                    x = state.position[a]
                    u = state.velocity[a]
                    rho = state.density[a]
                    excess = rho - state.reference_density[a]
                    divergence = x[0] * 0.0
                    diffused = x[0] * 0.0
                    gamma = state.volume[a] * at_zero
                    weight = gamma
                    background = x[0] * 0.0
                    if ti.static(balanced):
                        background = weight * state.background[a]
                    for j in range(rows.near_count[a]):
                        b = rows.near[a, j]
                        r = x - state.position[b]
                        r2 = r.norm_sqr()
                        V = state.volume[b]
                        slope = V * F(r2)
                        divergence += slope * (u - state.velocity[b]).dot(r)
                        moves = ti.cast(state.mobility[b] == MOBILE, disc.real)
                        excess_b = state.density[b] - state.reference_density[b]
                        diffused -= moves * slope * diffusion(excess, excess_b, rho)
                        gamma += V * W(r2)
                        if ti.static(balanced):
                            weight += moves * V * W(r2)
                            background += moves * V * W(r2) * state.background[b]
                    rate = rho * divergence / moment + diffused
                    if ti.static(balanced):
                        state.background_mean[a] = background / weight
                    if ti.static(packed):
                        correction, bracketed = restoring(gamma, state.colour_strength[a], rho)
                        rate += correction
                        if bracketed:
                            ti.atomic_add(clamps[PACKING_BRACKETS], 1)
                    state.density_rate[a] = rate
                    state.shepard[a] = gamma

        return continuity
