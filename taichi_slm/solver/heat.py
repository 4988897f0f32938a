"""The heat passes: rates, the time scheme, latent heat, phase.

rates    conduction, radiation, evaporation, laser, viscous heat -> heating [W]
account  energy accounts of a stage
predict  state at the end of the step with the present rates
correct  mean of both rates (second order)
phases   who froze, who waits to be let go, how hot it is
release  let go who has melted
"""

from typing import Any

import numpy as np

from taichi_slm.backend import direct, handed_out, ti
from taichi_slm.physics.conduction import pair_conduction
from taichi_slm.physics.evaporation import vapour
from taichi_slm.physics.material import MaterialTables
from taichi_slm.physics.phase_change import phase_setter, property_setter
from taichi_slm.physics.radiation import radiated_flux
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import MOMENTUM, Ledger
from taichi_slm.solver.surroundings import Surroundings
from taichi_slm.solver.timestep import stages_for
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import HELD, MOBILE, State, reader

POWERS = ("absorbed", "radiated", "evaporated", "conducted_out", "viscous")  # accounts of the heat passes


# what `phases` reports
WAITING, LEFT_RIM, MOVING, HOTTEST, HOTTEST_ID = range(5)


class HeatPasses:
    """The compiled passes. In 2-D powers are per metre of depth."""

    def __init__(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger, tables: MaterialTables,
                 emissivity: np.ndarray, band_heat_capacity: np.ndarray, evaporations: tuple[Any, ...],
                 alpha_viscosity: float, warm_from: float, rest: float):  # fmt: skip
        self._rows = rows
        self.surroundings = Surroundings(state, rows, disc)
        self._scheme = disc.numerics.heat_scheme
        self._tolerance = disc.numerics.fixed_point_tolerance
        self._sweeps = disc.numerics.fixed_point_sweeps
        self.change = ti.field(ti.f64, shape=())  # largest relative change of a fixed-point sweep
        self.sweeps = 0  # fixed-point sweeps or stages of the last step
        self._ledger, self._schedule = ledger, disc.schedule
        self._rates = self._compile_rates(state, rows, disc, emissivity, evaporations)
        self._account = self._compile_account(state, rows, disc)
        self._predict, self._correct, self._stage = self._compile_scheme(
            state, rows, disc, tables, band_heat_capacity, alpha_viscosity
        )
        self._phases, self._release = self._compile_phases(state, rows, disc, ledger, warm_from, rest)

    def step(self, dt: float, lit: bool, stable: float) -> np.ndarray:
        """One heat step of ``dt`` [s] with the laser powers frozen; returns the report of `phases`.

        ``stable`` is the longest step of explicit Euler [s].
        """
        hot, plain = self._rows.hot, self._schedule.plain(self._rows.hot)
        self.surroundings.look()
        if self._scheme == "rkl2":
            self._super_step(dt, lit, stages_for(dt / stable))
        else:
            first = self._powers(lit, dt)
            euler = self._scheme == "euler"
            self._predict(hot, dt, euler, plain)
            mean = first
            if not euler:
                for sweep in range(self._sweeps if self._scheme == "trapezoid" else 1):
                    last = self._powers(lit, dt)
                    self._correct(hot, 0.5 * dt, plain)
                    self.sweeps = sweep + 1
                    if self._scheme == "trapezoid" and self.change[None] < self._tolerance:
                        break
                mean = 0.5 * (first + last)
            self._ledger.book(POWERS, dt * mean)
        report = np.zeros(5)
        self._phases(hot, report)
        return report

    def _powers(self, lit: bool, dt: float) -> np.ndarray:
        """Heating of every row at the present state; returns the total powers [W] by account, shape [5]."""
        hot, lit_now, powers = self._rows.hot, int(lit), np.zeros(len(POWERS))
        self._rates(hot, lit_now, 1.0 / dt, self._schedule.alone(hot))
        self._account(hot, lit_now, 1.0 / dt, powers)
        return powers

    def _super_step(self, dt: float, lit: bool, stages: int) -> None:
        """Runge-Kutta-Legendre of second order: ``stages`` rates carry a step of (s^2 + s - 2)/4 Euler steps.

        Meyer, Balsara, Aslam 2014, J. Comput. Phys. 257, 594, eqs. (16)-(17). The accounts obey the same recurrence as
        the particles, so they close to round-off.
        """
        hot, plain = self._rows.hot, self._schedule.plain(self._rows.hot)

        def b(j: int) -> float:
            return 1.0 / 3.0 if j < 2 else (j * j + j - 2.0) / (2.0 * j * (j + 1.0))

        w = 4.0 / (stages * stages + stages - 2.0)
        first = self._powers(lit, dt)
        self._predict(hot, b(1) * w * dt, False, plain)
        booked, before = b(1) * w * dt * first, np.zeros_like(first)
        for j in range(2, stages + 1):
            mu = (2.0 * j - 1.0) / j * b(j) / b(j - 1)
            nu = -(j - 1.0) / j * b(j) / b(j - 2)
            new, old = mu * w * dt, -(1.0 - b(j - 1)) * mu * w * dt
            powers = self._powers(lit, dt)
            self._stage(hot, j == 2, mu, nu, new, old, j == stages, plain)
            booked, before = mu * booked + nu * before + new * powers + old * first, booked
        self.sweeps = stages
        self._ledger.book(POWERS, booked)

    def release(self) -> None:
        """Let go who has melted; the lists must be built next."""
        self._release(self._rows.hot)

    def _compile_rates(self, state: State, rows: Neighbours, disc: Discretisation, emissivity: np.ndarray,
                       evaporations: tuple[Any, ...]) -> Any:  # fmt: skip
        numerics, needs = disc.numerics, state.needs
        slope_of = self.surroundings.slope
        one_material = len(emissivity) == 1
        own = numerics.conduction_correction and numerics.conduction_moment == "own"
        moment = 1.0 if own else disc.conduction_moment
        flux = pair_conduction(numerics.conduction == "kirchhoff", one_material, moment)
        radiated = radiated_flux(disc.ambient, numerics.radiation_law)
        evaporated = vapour(evaporations, disc.real)[0] if needs.evaporation else None
        conductivity = reader(state, "conductivity")
        emits = ti.field(disc.real, shape=len(emissivity))
        emits.from_numpy(emissivity.astype(np.float32 if str(disc.real) == "f32" else np.float64))

        @handed_out
        @ti.kernel
        def rates(hot: ti.i32, lit: ti.i32, per_step: ti.f64, alone: ti.template()):
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = rows.hot_rows[k]
                x = state.position[a]
                T_a = state.temperature[a]
                k_a = conductivity(a)
                phi_a = state.kirchhoff[a]
                m_a = state.material[a]
                V_a = state.volume[a]
                g_a = state.conduction_factor[a]
                conducted = x[0] * 0.0
                for j in range(rows.near_count[a]):
                    b = rows.near[a, j]
                    same = ti.cast(state.material[b] == m_a, ti.i32)
                    slope = slope_of(a, j, b, x)
                    if ti.static(own):
                        slope *= 0.5 * (g_a + state.conduction_factor[b])
                    conducted += slope * flux(
                        same, T_a, state.temperature[b], k_a, conductivity(b), phi_a, state.kirchhoff[b]
                    )
                heating = ti.cast(V_a * conducted, ti.f64)
                if ti.static(needs.radiation):
                    lost = V_a * state.surface_area[a] * radiated(emits[m_a], T_a)
                    state.radiated[a] = lost
                    heating -= lost
                if ti.static(needs.evaporation):
                    lost = V_a * state.surface_area[a] * evaporated(m_a, T_a)
                    state.evaporated[a] = lost
                    heating -= lost
                if ti.static(needs.laser):
                    if lit != 0:
                        heating += state.laser[a]
                if ti.static(needs.viscous_heating):
                    heating += state.viscous_work[a] * per_step
                state.heating[a] = heating

        return rates

    def _compile_account(self, state: State, rows: Neighbours, disc: Discretisation) -> Any:
        needs, ordered = state.needs, disc.schedule.ordered
        chunks = 1 if ordered else 1024

        @direct
        @ti.kernel
        def account(
            hot: ti.i32, lit: ti.i32, per_step: ti.f64, power: ti.types.ndarray(dtype=ti.f64, ndim=1)
        ):
            ti.loop_config(serialize=ordered)
            for chunk in range(chunks):
                sums = ti.Vector.zero(ti.f64, 5)
                for k in range(chunk * hot // chunks, (chunk + 1) * hot // chunks):
                    a = rows.hot_rows[k]
                    if ti.static(needs.laser):
                        if lit != 0:
                            sums[0] += state.laser[a]
                    if ti.static(needs.radiation):
                        sums[1] += state.radiated[a]
                    if ti.static(needs.evaporation):
                        sums[2] += state.evaporated[a]
                    if (state.kind[a] & HELD) != 0:
                        sums[3] += state.heating[a]
                    if ti.static(needs.viscous_heating):
                        sums[4] += state.viscous_work[a] * per_step
                for i in ti.static(range(5)):
                    ti.atomic_add(power[i], sums[i])

        return account

    def _compile_scheme(self, state: State, rows: Neighbours, disc: Discretisation, tables: MaterialTables,
                        band_heat_capacity: np.ndarray, alpha_viscosity: float) -> tuple[Any, Any, Any]:  # fmt: skip
        apparent = disc.numerics.latent_heat == "apparent"
        set_properties = property_setter(state, tables, alpha_viscosity)
        capacity, enthalpy_of = tables.reader("heat_capacity"), tables.reader("enthalpy")
        band = ti.field(ti.f64, shape=len(band_heat_capacity))
        band.from_numpy(np.asarray(band_heat_capacity, np.float64))
        change = self.change

        @ti.func
        def rate_of(a):
            """Rate of the thermal state: dH/dt [J/(kg s)], or dT/dt [K/s] with the apparent heat capacity."""
            rate = state.heating[a] / state.mass[a]
            if ti.static(apparent):
                m = state.material[a]
                T = state.temperature[a]
                knot, fraction = tables.locate(m, T)
                c = ti.cast(capacity(m, knot, fraction), ti.f64)
                s = tables.liquid_fraction(m, T)
                if s > 0.0 and s < 1.0:
                    c = band[m]
                rate /= c
            return rate

        @ti.func
        def thermal_state(a):
            result = state.enthalpy[a]
            if ti.static(apparent):
                result = ti.cast(state.temperature[a], ti.f64)
            return result

        @ti.func
        def settle(a, thermal, last: ti.template()):
            """Give the particle its thermal state; between stages only with what the rates read."""
            m = state.material[a]
            T = ti.cast(thermal, disc.real)
            if ti.static(apparent):
                knot, fraction = tables.locate(m, T)
                state.enthalpy[a] = enthalpy_of(m, knot, fraction)
            else:
                state.enthalpy[a] = thermal
                T = ti.cast(tables.temperature_of(m, thermal), disc.real)
            set_properties(a, T, last)

        @ti.func
        def free(a):
            return (state.kind[a] & HELD) == 0 and state.mass[a] > 0.0

        @direct
        @ti.kernel
        def predict(hot: ti.i32, dt: ti.f64, last: ti.template(), alone: ti.template()):
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = rows.hot_rows[k]
                if free(a):
                    rate = rate_of(a)
                    before = thermal_state(a)
                    state.enthalpy_before[a] = before
                    state.heating_before[a] = rate
                    settle(a, before + dt * rate, last)

        @direct
        @ti.kernel
        def correct(hot: ti.i32, half: ti.f64, alone: ti.template()):
            change[None] = 0.0
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = rows.hot_rows[k]
                if free(a):
                    T = state.temperature[a]
                    mean = state.heating_before[a] + rate_of(a)
                    settle(a, state.enthalpy_before[a] + half * mean, True)
                    ti.atomic_max(change[None], ti.cast(abs(state.temperature[a] - T) / T, ti.f64))

        @direct
        @ti.kernel
        def stage(
            hot: ti.i32,
            second: ti.i32,
            mu: ti.f64,
            nu: ti.f64,
            new: ti.f64,
            old: ti.f64,
            last: ti.template(),
            alone: ti.template(),
        ):
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = rows.hot_rows[k]
                if free(a):
                    start = state.enthalpy_before[a]
                    present = thermal_state(a)
                    past = start
                    if second == 0:
                        past = state.enthalpy_past[a]
                    state.enthalpy_past[a] = present
                    step = new * rate_of(a) + old * state.heating_before[a]
                    settle(a, mu * present + nu * past + (1.0 - mu - nu) * start + step, last)

        return predict, correct, stage

    def _compile_phases(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger,
                        warm_from: float, rest: float) -> tuple[Any, Any]:  # fmt: skip
        halt, waits = phase_setter(state)
        flow, viscous, d = state.needs.flow, state.needs.viscous_heating, disc.dimension
        momentum, ordered = ledger.momentum, disc.schedule.ordered
        chunks = 1 if ordered else 1024
        frozen = MOMENTUM.index("frozen")

        @direct
        @ti.kernel
        def phases(hot: ti.i32, report: ti.types.ndarray(dtype=ti.f64, ndim=1)):
            ti.loop_config(serialize=ordered)
            for chunk in range(chunks):
                hottest, waiting, moving = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
                hottest_id = 0
                left_rim = 0
                for k in range(chunk * hot // chunks, (chunk + 1) * hot // chunks):
                    a = rows.hot_rows[k]
                    T = ti.cast(state.temperature[a], ti.f64)
                    if ti.math.isnan(T):  # a maximum would lose it
                        T = ti.cast(1e30, ti.f64)
                    if ti.static(viscous):
                        state.viscous_work[a] = 0.0
                    if T > hottest:
                        hottest = T
                        hottest_id = a
                    if rows.core[k] == 0 and abs(T - rest) > warm_from:
                        left_rim = 1
                    if ti.static(flow):
                        u = state.velocity[a]
                        if halt(a):
                            for axis in ti.static(range(d)):
                                ti.atomic_add(
                                    momentum[frozen][axis], ti.cast(state.mass[a] * u[axis], ti.f64)
                                )
                        if waits(a):
                            waiting = ti.max(waiting, ti.cast(state.liquid_fraction[a], ti.f64))
                            moving += 1.0
                        elif state.mobility[a] == MOBILE:
                            moving += 1.0
                if hottest > ti.atomic_max(report[HOTTEST], hottest):
                    report[HOTTEST_ID] = hottest_id
                ti.atomic_max(report[WAITING], waiting)
                ti.atomic_max(report[LEFT_RIM], ti.cast(left_rim, ti.f64))
                ti.atomic_add(report[MOVING], moving)

        @direct
        @ti.kernel
        def release(hot: ti.i32):
            ti.loop_config(serialize=ordered)
            for k in range(hot):
                a = rows.hot_rows[k]
                if waits(a):
                    state.mobility[a] = MOBILE

        return phases, release
