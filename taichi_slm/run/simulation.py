"""A simulation: a scene on the device, the passes that it needs, and the loop over time."""

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_slm import backend
from taichi_slm.backend import ti
from taichi_slm.config.schema import Config
from taichi_slm.errors import BlowUpError
from taichi_slm.materials.tables import enthalpy_at, tabulate
from taichi_slm.physics.laser import LaserBins, line_power
from taichi_slm.physics.material import MaterialTables
from taichi_slm.physics.phase_change import RELEASE_BY, needed_tables, property_setter
from taichi_slm.physics.viscosity import artificial_viscosity
from taichi_slm.run.accounts import Accounts
from taichi_slm.scene.beam import BeamPath
from taichi_slm.scene.build import build_scene
from taichi_slm.scene.program import program_rate, program_temperature
from taichi_slm.scene.scene import Scene
from taichi_slm.solver.activity import WARM_FROM, Activity
from taichi_slm.solver.discretisation import discretise
from taichi_slm.solver.ejection import Ejection
from taichi_slm.solver.flow import FlowPasses
from taichi_slm.solver.heat import HOTTEST, HOTTEST_ID, LEFT_RIM, MOVING, WAITING, HeatPasses
from taichi_slm.solver.ledger import Ledger
from taichi_slm.solver.step import FlowStep
from taichi_slm.solver.surface import SurfacePasses
from taichi_slm.solver.timestep import StepLimits
from taichi_slm.sph.cells import Cells
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import HELD, MOBILE, REMOVED, STILL, WALL, Needs, State

SNAPSHOT_ARRAYS = (
    "position", "velocity", "temperature", "liquid_fraction", "density", "pressure", "surface_force", "material",
    "tracer", "id", "ever_liquid", "wall", "held",
)  # fmt: skip
_OF_THE_SCENE = {"material": np.int32, "tracer": np.int32, "wall": np.uint8, "held": np.uint8}
FLOW_ONLY_STEPS = 8  # flow steps between looks at the clock in a scene without heat


class Simulation:
    """Build with a :class:`Config`; then ``step()``, ``advance(until)`` or ``run()``.

    One per process at a time: building one resets Taichi, and an earlier one's fields are gone.
    ``temperature``, ``position``, ``velocity`` ... are numpy copies of all particles, removed ones included.
    """

    def __init__(self, config: Config, scene: Scene | None = None, arch: str = "cpu", precision: str = "f64",
                 threads: int | None = None, debug: bool = False):  # fmt: skip
        backend.start(arch, precision, threads, debug)
        self.config, self.time, self.steps = config, 0.0, 0
        self.scene = scene or build_scene(config)
        self.particle_steps = 0
        self.compile_time_s = self.solver_time_s = 0.0
        self.dt, self.dt_limiter = 0.0, "start"
        self._allowed = math.inf  # flow step that the limits allowed last [s]
        self.beam = BeamPath(config.laser, config.dimension) if config.laser else None
        real = getattr(ti, precision)
        cpu = arch == "cpu"
        self._build(real, serial=cpu and (threads == 1 or self.scene.count < config.performance.serial_below),
                    ordered=cpu)  # fmt: skip
        self._start()

    # ----------------------------------------------------------------- set-up

    def _build(self, real: Any, serial: bool, ordered: bool) -> None:
        config, scene, physics, numerics = self.config, self.scene, self.config.physics, self.config.numerics
        tension = physics.flow and (physics.surface_tension or physics.marangoni or physics.recoil)
        losses = physics.heat and (physics.radiation or physics.evaporation)
        packing = physics.flow and numerics.packing_correction > 0
        needs = Needs(
            flow=physics.flow, heat=physics.heat, surface=tension or losses or packing, tension=tension,
            viscous_heating=physics.flow and physics.heat and physics.viscous_heating,
            printed_leapfrog=physics.flow and numerics.integrator == "leapfrog_printed",
        )  # fmt: skip
        d, dx = scene.dimension, scene.spacing
        self.disc = disc = discretise(d, dx, physics, numerics, config.gravity, config.ambient_temperature,
                                      serial, ordered, real)  # fmt: skip
        self.host_tables = tabulate(scene.materials, numerics.solid_density)
        self.limits = StepLimits(config, self.host_tables)
        self.state = state = State(scene.count, d, needs, real)
        self.tables = tables = MaterialTables(self.host_tables, real, needed_tables(state))
        self.ledger = Ledger(d)
        alpha = artificial_viscosity(numerics.artificial_viscosity, disc.h, numerics.sound_speed, d)

        skin = config.performance.skin * dx
        near = disc.flow_kernel.support + skin
        far = disc.surface_kernel.support + skin if needs.surface and needs.flow else None
        margin = 2.0 * dx
        lower, upper = scene.lower - margin, scene.upper + margin
        cells = Cells(state, lower, upper, max(0.5 * (far or near), 1.4 * dx), dx, ordered)
        self.rows = rows = Neighbours(state, cells, near, far, dx, ordered)
        rest, all_hot = self._rest_temperature()
        self.bins = None
        if config.laser and physics.heat:
            self.bins = LaserBins(
                config.laser, state, rows, lower, upper, dx, not config.performance.skip_dark
            )
        self.activity = Activity(state, cells, rows, config, rest, all_hot, self.bins)
        evaporations = tuple(material.evaporation for material in scene.materials)
        self.surface = None
        if needs.surface:
            self.surface = SurfacePasses(state, cells, rows, disc, self.ledger, evaporations,
                                         config.performance.skip_interior)  # fmt: skip
        self.flow_step = None
        if needs.flow:
            flow = FlowPasses(state, rows, disc, self.ledger)
            minimum = numerics.minimum_neighbours
            minimum = (3 if d == 2 else 6) if minimum is None else minimum
            self.activity.flow = flow
            self.activity.surface = self.surface
            self.activity.ejection = Ejection(
                state, rows, disc, self.ledger, scene.lower, scene.upper, minimum
            )
            self.flow_step = FlowStep(
                numerics.integrator, flow, self.surface, self.activity, numerics.surface_every
            )
        self.heat = None
        if needs.heat:
            self.heat = HeatPasses(state, rows, disc, self.ledger, tables, self.host_tables.emissivity,
                                   self.host_tables.band_heat_capacity, evaporations, alpha, WARM_FROM,
                                   rest)  # fmt: skip
            self.activity.heat = self.heat
        self._set_everywhere, self._set_body = self._compile_setters(alpha)

    def _rest_temperature(self) -> tuple[float, bool]:
        """The commonest initial temperature [K], and whether all must count as hot because it is not the ambient's."""
        values, counts = np.unique(self.scene.temperature, return_counts=True)
        rest = float(values[np.argmax(counts)])
        exchanges = self.config.physics.radiation or self.config.physics.evaporation
        return rest, exchanges and abs(rest - self.config.ambient_temperature) > WARM_FROM

    def _compile_setters(self, alpha: float) -> tuple[Any, Any]:
        state = self.state
        set_properties = property_setter(state, self.tables, alpha)
        body = ti.field(ti.i32, shape=state.count)
        body.from_numpy(self.scene.body.astype(np.int32))

        @ti.kernel
        def set_everywhere():
            for a in range(state.count):
                set_properties(a, state.temperature[a])

        @ti.kernel
        def set_body(number: ti.i32, T: ti.f64):
            for a in range(state.count):
                if body[a] == number:
                    set_properties(a, ti.cast(T, state.real))

        return set_everywhere, set_body

    def _start(self) -> None:
        scene, state, tables = self.scene, self.state, self.host_tables
        T, m = scene.temperature, scene.material
        solidus = tables.segment_start[m, 1]
        mobile = (T > solidus) & ~scene.wall & self.config.physics.flow
        density = _look_up(tables, "density", m, T) + self._hydrostatic_excess(mobile)
        mass = density * scene.volume
        velocity = np.where(mobile[:, None], self._initial_velocity(density), 0.0)
        state.load(position=scene.position, temperature=T, material=m, mass=mass, density=density,
                   volume=scene.volume, kind=WALL * scene.wall + HELD * scene.held,
                   velocity=velocity, mobility=np.where(mobile, MOBILE, STILL))  # fmt: skip
        self.initial_momentum = np.sum(mass[:, None] * velocity, axis=0)
        if state.needs.heat:
            H = np.array([enthalpy_at(tables, int(k), float(t)) for k, t in _unique_pairs(m, T)])
            index = _pair_index(m, T)
            state.load(enthalpy=H[index], enthalpy_initial=H[index])
        if state.needs.flow:
            state.load(shepard=np.ones(scene.count))
        self._set_everywhere()
        self.hottest, self.hottest_id = float(T.max()), int(T.argmax())
        self.moving = int(np.count_nonzero(mobile))
        self.accounts = Accounts(self)
        self.initial_mass = self.accounts.present_mass()

    def _hydrostatic_excess(self, mobile: np.ndarray) -> np.ndarray:
        """Density [kg/m^3] above the reference one under which liquid at rest carries what lies above it, shape [n]."""
        excess = np.zeros(self.scene.count)
        if self.config.gravity != 0.0 and mobile.any():
            height = self.scene.position[mobile, -1]
            top = height.max() + 0.5 * self.scene.spacing
            m, T = self.scene.material[mobile], self.scene.temperature[mobile]
            weight = _look_up(self.host_tables, "density", m, T) * self.config.gravity  # [N/m^3]
            excess[mobile] = weight * (top - height) / self.config.numerics.sound_speed**2
        return excess

    def _initial_velocity(self, density: np.ndarray) -> np.ndarray:
        scene = self.scene
        velocity = scene.velocity.copy()
        for number in scene.follows_density:
            own = scene.body == number
            rate = program_rate(scene.programs[number], 0.0)
            T, m = scene.temperature[own], scene.material[own]
            warmer, cooler = (_look_up(self.host_tables, "density", m, T + by) for by in (0.01, -0.01))
            slope = (warmer - cooler) / 0.02
            expansion = -slope * rate / density[own]  # div u = -(1/rho) drho/dt
            centre = scene.position[own].mean(axis=0)
            velocity[own] += (expansion / scene.dimension)[:, None] * (scene.position[own] - centre)
        return velocity

    def compile(self) -> None:
        """Compile every kernel by launching it over no particles; then find the neighbours."""
        began = time.perf_counter()
        if self.flow_step is not None:
            self.flow_step.advance(0.0)
        if self.heat is not None:
            if self.bins is not None and self.beam is not None:
                self.bins.absorb(self.beam.position(0.0), 1e-300)
            self.heat.step(1.0, False, 1.0)
        self.activity.beam_at(self._beam_centre(0.0, 0.0))
        self.activity.build()
        if self.surface is not None:
            self.surface.colour_everywhere()
            self.activity.build()
        self.compile_time_s = time.perf_counter() - began

    # ----------------------------------------------------------------- time

    @property
    def finished(self) -> bool:
        """The end of time, or the beam has passed and everything stands still for good."""
        end = self.config.time.end
        if self.time >= end * (1.0 - 1e-12):
            return True
        beam_over = self.beam is None or self.time >= self.beam.end
        can_finish = (
            self.config.performance.stop_finished and self.beam is not None and self.config.physics.flow
        )
        return bool(can_finish and beam_over and self.moving == 0 and self.steps > 0)

    def run(self) -> None:
        """Advance to the end."""
        self.advance(self.config.time.end)

    def step(self) -> None:
        """One heat step with its flow steps."""
        self._span(self.config.time.end)

    def advance(self, until: float) -> None:
        """Step until ``until`` [s] exactly, or until the scene is finished. Raises BlowUpError."""
        if self.activity.builds == 0:
            self.compile()
        began = time.perf_counter()
        while self.time < until * (1.0 - 1e-12) and not self.finished:
            self._span(until)
        self._search_anew()
        self.solver_time_s += time.perf_counter() - began

    def _search_anew(self) -> None:
        """Have the lists built anew at the next step, so that a run resumed here has the same lists, and bits."""
        self.rows.forget()
        self.activity.stale = True

    def _span(self, until: float) -> None:
        """One heat step, and the flow steps within it."""
        if self.activity.builds == 0:
            self.compile()
        span, steps = self._choose(until - self.time)
        centre = self._beam_centre(self.time, self.time + span)
        self.activity.beam_at(centre)
        dt = span / steps
        for number in range(steps):
            self._impose(self.time + (number + 0.5) * dt)
            if self.flow_step is not None and self.moving:
                self.flow_step(dt)
                self.particle_steps += self.rows.mobile
        if self.heat is not None:
            self._heat(span, centre)
        self.dt = dt
        self.steps += steps
        self.time = until if math.isclose(self.time + span, until, rel_tol=1e-12) else self.time + span

    def _choose(self, remaining: float) -> tuple[float, int]:
        """Length of the heat step and number of flow steps in it: the minimum of all limits, aligned to outputs."""
        performance, numerics = self.config.performance, self.config.numerics
        flow_dt, limiter = math.inf, "output"
        if self.flow_step is not None and self.moving:
            fastest = math.sqrt(self.flow_step.flow.fastest[None])
            limits = self.limits.flow(self.hottest, fastest)
            limiter = min(limits, key=lambda name: limits[name])
            flow_dt = limits[limiter]
            if numerics.step_growth * self._allowed < flow_dt:
                flow_dt, limiter = numerics.step_growth * self._allowed, "growth"
            self._allowed = flow_dt  # not the step taken, which may be shortened to meet an output
        span = FLOW_ONLY_STEPS * flow_dt if self.heat is None else flow_dt
        if self.heat is not None:
            heat_dt, name = self.limits.heat(self.hottest), "heat"
            if self.bins is not None and self._beam_step() < heat_dt:
                heat_dt, name = self._beam_step(), "laser"
            if heat_dt < flow_dt:
                flow_dt, limiter = heat_dt, name
            span = (
                min(heat_dt, performance.heat_steps_at_most * flow_dt) if performance.heat_clock else flow_dt
            )
        if numerics.maximum_step is not None and numerics.maximum_step < flow_dt:
            flow_dt, limiter = numerics.maximum_step, "maximum_step"
            span = min(span, FLOW_ONLY_STEPS * flow_dt)
        if span >= remaining:
            span = remaining
        elif span > 0.5 * remaining:
            span = 0.5 * remaining
        self.dt_limiter = limiter
        return span, max(1, math.ceil(span / flow_dt * (1.0 - 1e-9)))

    def _beam_step(self) -> float:
        """Heat step that the beam allows [s]: half a bin of its way, a bounded rise, and not past its next event."""
        assert self.beam is not None and self.bins is not None
        event = self.beam.next_event(self.time) - self.time
        speed, bounded = self._beam_speed(), self.limits.laser()
        on = self.beam.on_during(self.time, self.time + bounded)
        allowed = min(0.5 * self.bins.size / speed if speed > 0 else math.inf, bounded if on else math.inf)
        return min(allowed, max(event, 1e-2 * bounded))

    def _beam_speed(self) -> float:
        assert self.beam is not None
        ahead = 1e-3 * self.config.time.end
        here, there = self.beam.position(self.time), self.beam.position(self.time + ahead)
        return math.dist(here, there) / ahead

    def _beam_centre(self, start: float, end: float) -> tuple[float, ...] | None:
        """Where the beam is in the middle of [start, end] [s]; None while it is off."""
        if self.beam is None or self.bins is None or not self.beam.on_during(start, max(end, start + 1e-15)):
            return None
        return self.beam.position(0.5 * (start + end))

    def _impose(self, t: float) -> None:
        for number, program in self.scene.programs.items():
            self._set_body(number, program_temperature(program, t))

    def _heat(self, span: float, centre: tuple[float, ...] | None) -> None:
        assert self.heat is not None
        self.activity.neighbours()
        lit = False
        if self.bins is not None and self.beam is not None and centre is not None:
            assert self.config.laser is not None
            share = self.beam.mean_power_fraction(self.time, self.time + span)
            absorptivity = self.config.laser.absorptivity
            absorptivity = self.host_tables.absorptivity[0] if absorptivity is None else absorptivity
            incident = (
                absorptivity * share * self.beam.power * line_power(self.config.laser, self.scene.dimension)
            )
            self.accounts.incident += incident * span
            lit = self.bins.absorb(centre, incident)
        report = self.heat.step(span, lit, self.limits.euler(self.hottest))
        self.hottest, self.hottest_id = float(report[HOTTEST]), int(report[HOTTEST_ID])
        self.moving = int(report[MOVING])
        if report[WAITING] > RELEASE_BY or report[LEFT_RIM]:
            self.activity.stale = True
        top = self.host_tables.segment_start[:, 3].max()
        if not self.hottest < top:
            raise BlowUpError(
                f"heat: particle {self.hottest_id} is at {self.hottest:.0f} K, beyond the end of the property tables "
                f"({top:.0f} K); less power, physics.evaporation or a finer spacing may help"
            )

    # ----------------------------------------------------------------- results

    def arrays(self, names: Sequence[str] = SNAPSHOT_ARRAYS) -> dict[str, np.ndarray]:
        """The particles that are still there, in the order of their ids; SI units, names as in the snapshots."""
        there = self.state.array("mobility") != REMOVED
        return {name: self._array(name)[there] for name in names if self._has(name)}

    def _has(self, name: str) -> bool:
        return name in _OF_THE_SCENE or name in ("id", "pressure") or name in self.state.names

    def _array(self, name: str) -> np.ndarray:
        if name in _OF_THE_SCENE:
            return np.asarray(getattr(self.scene, name)).astype(_OF_THE_SCENE[name])
        if name == "id":
            return np.arange(self.scene.count, dtype=np.int32)
        if name not in self.state.names:  # a pressure that nobody computes
            return np.zeros(self.scene.count)
        values = self.state.array(name)
        return values.astype(np.uint8) if name == "ever_liquid" else values

    def diagnostics(self) -> dict[str, float | int | str]:
        """One row of the history, but for the melt pool's size."""
        return self.accounts.row()

    @property
    def temperature(self) -> np.ndarray:
        """[K], shape [n]."""
        return self.state.array("temperature")

    @property
    def position(self) -> np.ndarray:
        """[m], shape [n, dimension]."""
        return self.state.array("position")

    @property
    def velocity(self) -> np.ndarray:
        """[m/s], shape [n, dimension]."""
        return self.state.array("velocity")

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs; the lists are built anew on both sides, so both go on with the same bits."""
        self._search_anew()
        saved = {f"state.{name}": self.state.array(name) for name in self.state.names}
        saved |= {f"ledger.{name}": getattr(self.ledger, name).to_numpy()
                  for name in ("energy", "momentum", "clamps", "removed", "removed_mass")}  # fmt: skip
        flow = self.flow_step
        fastest = float(flow.flow.fastest[None]) if flow else 0.0
        saved["clock"] = np.array([self.time, self.dt, self.hottest, self.accounts.incident,
                                   flow.dt_before if flow else 0.0, fastest, self._allowed,
                                   self.bins.floor[None] if self.bins else 0.0])  # fmt: skip
        saved["counts"] = np.array([self.steps, self.particle_steps, self.moving, self.hottest_id,
                                    flow.count if flow else 0], np.int64)  # fmt: skip
        return saved

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Continue from a :meth:`checkpoint` of the same config."""
        if self.activity.builds == 0:
            self.compile()
        self.state.load(**{name: saved[f"state.{name}"] for name in self.state.names})
        for name in ("energy", "momentum", "clamps", "removed", "removed_mass"):
            getattr(self.ledger, name).from_numpy(saved[f"ledger.{name}"])
        time_, dt, hottest, incident, dt_before, fastest, allowed, floor = (float(x) for x in saved["clock"])
        self.time, self.dt, self.hottest, self.accounts.incident = time_, dt, hottest, incident
        self._allowed = allowed
        self.steps, self.particle_steps, self.moving, self.hottest_id, count = (
            int(n) for n in saved["counts"]
        )
        if self.flow_step is not None:
            self.flow_step.dt_before, self.flow_step.count = dt_before, count
            self.flow_step.flow.fastest[None] = fastest
        if self.bins is not None:
            self.bins.floor[None] = floor
        self._search_anew()


def _look_up(tables: Any, name: str, material: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    values = np.empty(len(temperature))
    for m in np.unique(material):
        own = material == m
        values[own] = np.interp(temperature[own], tables.temperature[m], getattr(tables, name)[m])
    return values


def _unique_pairs(material: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    return np.unique(np.column_stack([material.astype(float), temperature]), axis=0)


def _pair_index(material: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    pairs = np.column_stack([material.astype(float), temperature])
    index: np.ndarray = np.unique(pairs, axis=0, return_inverse=True)[1]
    return index.reshape(-1)
