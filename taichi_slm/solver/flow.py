"""The flow passes: one loop over neighbours each, which calls one function per term.

advance     half drift, density, equation of state, capillary background
walls       pressure, and velocity, that the still particles beside the liquid show to it; the liquid shows its own
momentum    pressure, viscosity, gravity, surface forces -> acceleration; shift (momentum.py)
kick        velocity, half drift, shift
continuity  velocity divergence, diffusion, packing -> density rate; mean background
"""

from typing import Any

import numpy as np

from taichi_slm.backend import direct, handed_out, ti
from taichi_slm.physics import continuity as continuity_terms
from taichi_slm.physics.equation_of_state import pressure_of
from taichi_slm.physics.pressure import wall_pressure
from taichi_slm.physics.viscosity import wall_velocity
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import PACKING_BRACKETS, WALL_SUCTION, Ledger
from taichi_slm.solver.momentum import compile_momentum
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import MOBILE, State, mover

LOST = 1e30  # `moved` when somebody has no finite place [m^2]


class FlowPasses:
    """The compiled passes.

    ``moved`` [m^2] is the largest squared displacement since the lists were built, ``fastest`` [m^2/s^2] the largest
    squared speed, both of the last kick, which took ``dt`` [s].
    """

    def __init__(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger):
        self.moved = self.fastest = self.dt = 0.0
        self._rows, self._schedule = rows, disc.schedule
        self._advance = self._compile_advance(state, rows, disc)
        self._walls = self._compile_walls(state, rows, disc, ledger) if state.needs.still else None
        self._momentum = compile_momentum(state, rows, disc)
        self._kick = self._compile_kick(state, rows, disc, ledger)
        self._continuity = self._compile_continuity(state, rows, disc, ledger)

    def advance(self, drift: float, density: float) -> None:
        """Positions by ``drift``, densities by ``density`` [s] with their rates; then p by (9); velocities shown."""
        mobile = self._rows.mobile
        self._advance(mobile, drift, density, self._schedule.plain(mobile))

    def walls(self) -> None:
        """Extrapolate the liquid's pressure and velocity to the still particles beside it."""
        mobile, flow = self._rows.mobile, self._rows.flow
        if self._walls is not None:
            # a wall sums over the few of its neighbours that move: a quarter of the work; the mobile rows do nothing
            self._walls(flow, self._schedule.alone((flow - mobile) // 4 + mobile // 40))

    def momentum(self, dt: float) -> None:
        """Write accelerations and shifts; ``dt`` [s] is the time of the viscous heat and of the shear."""
        self._momentum(self._rows.mobile, dt, self._schedule.alone(self._rows.mobile))

    def kick(self, dt: float, drift: float) -> None:
        """Velocities by ``dt`` (less half of the last one for the printed leapfrog), positions by ``drift`` [s]."""
        largest = np.zeros(2)  # an argument: to read a field takes 10 us
        self._kick(self._rows.mobile, dt, self.dt, drift, largest)
        self.moved, self.fastest = largest.tolist()
        self.dt = dt

    def continuity(self) -> None:
        """Write density rates and Shepard sums."""
        self._continuity(self._rows.mobile, self._schedule.alone(self._rows.mobile))

    def _compile_advance(self, state: State, rows: Neighbours, disc: Discretisation) -> Any:
        pressure = pressure_of(disc.numerics.sound_speed)
        balanced, shows_velocity = state.needs.balanced, state.needs.shown_velocity

        @direct
        @ti.kernel
        def advance(mobile: ti.i32, drift: disc.real, density: disc.real, alone: ti.template()):
            ti.loop_config(serialize=alone)
            for k in range(mobile):
                a = rows.rows[k]
                if state.mobility[a] == MOBILE:
                    state.position[a] = state.position[a] + drift * state.velocity[a]
                    if ti.static(shows_velocity):
                        state.shown_velocity[a] = state.velocity[a]
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
        uses_shepard = disc.uses_shepard
        at_zero = float(disc.flow_kernel.value(0.0))
        clamps, shows_velocity = ledger.clamps, state.needs.shown_velocity
        shown = wall_velocity(disc.numerics.walls == "no_slip")

        @handed_out
        @ti.kernel
        def walls(flow: ti.i32, alone: ti.template()):
            ti.loop_config(serialize=alone)
            for k in range(flow):
                a = rows.rows[k]
                # among the mobile rows there are those that have frozen since
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
                        state.shown_velocity[a] = shown(velocity / ti.max(weight, 1e-30), away)
                    if ti.static(uses_shepard):
                        state.shepard[a] = gamma

        return walls

    def _compile_kick(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger) -> Any:
        d, printed, ordered = disc.dimension, state.needs.printed_leapfrog, disc.schedule.ordered
        tension, gravity = state.needs.tension, disc.gravity
        chunks = 1 if ordered else 1024
        shifts, still = state.needs.shifting, state.needs.still

        @direct
        @ti.kernel
        def kick(
            mobile: ti.i32,
            dt: disc.real,
            dt_before: disc.real,
            drift: disc.real,
            largest: ti.types.ndarray(dtype=ti.f64, ndim=1),
        ):
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
                        if ti.static(still):
                            wall += ti.cast(state.wall_force[a], ti.f64)
                        if ti.static(tension):
                            surface += ti.cast(state.surface_force[a] * state.volume[a], ti.f64)
                ti.atomic_max(largest[0], ti.cast(farthest, ti.f64))
                ti.atomic_max(largest[1], ti.cast(speed2, ti.f64))
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
        restoring = None
        if packed:
            restoring = continuity_terms.packing(
                numerics.packing_correction,
                disc.h,
                numerics.sound_speed,
                disc.h_surface,
                disc.flat,
                disc.real,
            )
        at_zero = float(disc.flow_kernel.value(0.0))
        clamps = ledger.clamps
        moment, balanced = disc.gradient_moment, state.needs.balanced
        mover_of = mover(state)

        @handed_out
        @ti.kernel
        def continuity(mobile: ti.i32, alone: ti.template()):
            ti.loop_config(serialize=alone)
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
                        moves = mover_of(b)
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
