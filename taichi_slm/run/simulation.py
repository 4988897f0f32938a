"""A simulation: a scene on the device, the passes that it needs, and the loop over time."""

import math
import time
import zlib
from collections.abc import Sequence

import numpy as np

from taichi_slm import backend
from taichi_slm.backend import ti
from taichi_slm.config.schema import Config
from taichi_slm.errors import BlowUpError
from taichi_slm.physics.laser import line_power
from taichi_slm.physics.phase_change import RELEASE_BY
from taichi_slm.run.accounts import Accounts
from taichi_slm.run.guards import Guards
from taichi_slm.scene.beam import BeamPath
from taichi_slm.scene.build import build_scene
from taichi_slm.scene.program import program_temperature
from taichi_slm.scene.scene import Scene
from taichi_slm.solver.flow import LOST
from taichi_slm.solver.heat import HOTTEST, HOTTEST_ID, LEFT_RIM, MOVING, WAITING
from taichi_slm.solver.initial import impose_temperature, load_initial_state
from taichi_slm.solver.model import Model
from taichi_slm.state import REMOVED

SNAPSHOT_ARRAYS = (
    "position", "velocity", "temperature", "liquid_fraction", "density", "pressure", "surface_force", "material",
    "tracer", "id", "ever_liquid", "wall", "held",
)  # fmt: skip
_OF_THE_SCENE = {"material": np.int32, "tracer": np.int32, "wall": np.uint8, "held": np.uint8}
FROZEN_ROWS = 0.1  # share of the mobile rows that may have frozen before they are gathered anew
FLOW_ONLY_STEPS = 8  # flow steps between looks at the clock in a scene without heat


class Simulation:
    """Build with a ``Config``; then ``step()``, ``advance(until)`` or ``run()``.

    One per process at a time: building one resets Taichi, and an earlier one's fields are gone.
    ``temperature``, ``position``, ``velocity`` ... are numpy copies of all particles, removed ones included.
    ``scene``: particles of one's own instead of those that the config describes; ``arch``: cpu, cuda, vulkan or metal;
    ``precision``: f64 or f32; ``threads``: of the CPU, by default all; ``debug``: indices are checked, slowly.
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
        serial_below = config.performance.serial_below // (4 if config.dimension == 3 else 1)
        schedule = backend.Schedule(cpu, cpu and threads == 1, serial_below)
        self.model = model = Model(config, self.scene, real, schedule)
        self.disc, self.state, self.rows, self.ledger = model.disc, model.state, model.rows, model.ledger
        self.activity, self.surface, self.flow_step = model.activity, model.surface, model.flow_step
        self.heat, self.bins, self.limits, self.host_tables = (
            model.heat,
            model.bins,
            model.limits,
            model.host_tables,
        )
        beginning = load_initial_state(model)
        self.initial_momentum, self.moving = beginning.momentum, beginning.moving
        self.hottest, self.hottest_id = beginning.hottest, beginning.hottest_id
        self.accounts = Accounts(self)
        self.weigh()
        self.guards = Guards(self)

    def compile(self) -> None:
        """Compile the kernels of a step by launching them over no particles; then find the neighbours."""
        began = time.perf_counter()
        if self.flow_step is not None:
            self.flow_step.advance(0.0)
        if self.surface is not None:
            self.surface.refresh()
        if self.heat is not None:
            if self.bins is not None and self.beam is not None:
                self.bins.absorb(self.beam.position(0.0), 1e-300)
            self.heat.step(1.0, False, 0.1)  # so long that it has stages between the first and the last
        self.activity.beam_at(self._beam_centre(0.0, 0.0))
        self.activity.renew()
        self.activity.compile()
        if self.surface is not None:
            self.surface.colour_everywhere()
        self.activity.build()
        self.accounts.survey()
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
        """One heat step with its flow steps. Raises BlowUpError."""
        with self.guards.told():
            self._span(self.config.time.end)

    def advance(self, until: float, pause: int | None = None) -> None:
        """Step until ``until`` [s] exactly, until the scene is finished, or past step ``pause``. Raises BlowUpError."""
        if self.activity.builds == 0:
            self.compile()
        began = time.perf_counter()
        with self.guards.told():
            while (
                self.time < until * (1.0 - 1e-12) and not self.finished and self.steps < (pause or math.inf)
            ):
                self._span(until)
            if self.flow_step is not None and self.flow_step.flow.moved >= LOST:
                self.activity.build()  # names who is lost
        self.solver_time_s += time.perf_counter() - began

    def _span(self, until: float) -> None:
        """One heat step, and the flow steps within it; nothing once the scene is finished."""
        if self.finished:
            return
        if self.activity.builds == 0:
            self.compile()
        span, steps = self._choose(until - self.time)
        centre = self._beam_centre(self.time, self.time + span)
        self.activity.beam_at(centre)
        if self.heat is not None:
            self.activity.heat_reaches(self.limits.heat_reach(span, self.hottest))
        dt = span / steps
        for number in range(steps):
            self._follow_programs(self.time + (number + 0.5) * dt)
            if self.flow_step is not None and self.moving:
                self.flow_step(dt)
                self.particle_steps += self.rows.mobile
                self.guards.accounts(self.steps + number + 1, heat=False)
        if self.heat is not None:
            self._heat(span, centre)
        self.dt = dt
        self.steps += steps
        self.guards.accounts(self.steps, heat=True)
        self.time = until if math.isclose(self.time + span, until, rel_tol=1e-12) else self.time + span

    def _choose(self, remaining: float) -> tuple[float, int]:
        """Length of the heat step and number of flow steps in it: the minimum of all limits, aligned to outputs."""
        performance, numerics = self.config.performance, self.config.numerics
        flow_dt, limiter = math.inf, "output"
        if self.flow_step is not None and self.moving:
            fastest = math.sqrt(self.flow_step.flow.fastest)
            self.guards.speed(fastest)
            limits = self.limits.flow(self.hottest, fastest)
            limiter = min(limits, key=lambda name: limits[name])
            flow_dt = limits[limiter]
            if numerics.step_growth * self._allowed < flow_dt:
                flow_dt, limiter = numerics.step_growth * self._allowed, "growth"
            self._allowed = flow_dt  # not the step taken, which may be shortened to meet an output
        span = FLOW_ONLY_STEPS * flow_dt if self.heat is None else flow_dt
        if self.heat is not None:
            heat_dt, name = self.limits.heat(self.hottest), "heat"
            beam_dt = self._beam_step() if self.bins is not None else math.inf
            if beam_dt < heat_dt:
                heat_dt, name = beam_dt, "laser"
            if heat_dt < flow_dt:
                flow_dt, limiter = heat_dt, name
            span = flow_dt
            if performance.heat_clock:
                span = min(heat_dt, max(performance.heat_steps_at_most * flow_dt, self._while_at_rest()))
                span = self.limits.without_waste(span, self.hottest)
        if numerics.maximum_step is not None and numerics.maximum_step < flow_dt:
            flow_dt, limiter = numerics.maximum_step, "maximum_step"
            span = min(
                span, FLOW_ONLY_STEPS * flow_dt if self.flow_step is not None and self.moving else flow_dt
            )
        if span >= remaining * (1.0 - 1e-9):  # a step to the end, not one and a crumb of round-off
            span = remaining
        elif span > 0.5 * remaining:
            span = 0.5 * remaining
        self.dt_limiter = limiter
        return span, max(1, math.ceil(span / flow_dt * (1.0 - 1e-9)))

    def _while_at_rest(self) -> float:
        """Time in which nobody moves by more than a small part of a spacing [s]: hardly any heat is carried in it."""
        if self.flow_step is None or not self.moving:
            return math.inf
        fastest = math.sqrt(self.flow_step.flow.fastest)
        return self.config.performance.heat_motion * self.config.spacing / max(fastest, 1e-30)

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

    def _follow_programs(self, t: float) -> None:
        for number, program in self.scene.programs.items():
            self.model.set_body(number, program_temperature(program, t))

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
        frozen = self.rows.mobile - self.moving
        self.activity.stale |= bool(report[WAITING] > RELEASE_BY or frozen > FROZEN_ROWS * self.rows.mobile)
        self.activity.outgrown |= bool(report[LEFT_RIM])
        top = self.host_tables.segment_start[:, 3].max()
        if not self.hottest < top:
            if self.hottest >= LOST:
                raise BlowUpError(f"heat: particle {self.hottest_id} has no finite temperature")
            raise BlowUpError(
                f"heat: particle {self.hottest_id} is at {self.hottest:.0f} K, beyond the end of the property tables "
                f"({top:.0f} K); less power, physics.evaporation or a finer spacing may help"
            )

    def weigh(self) -> None:
        """Begin the account of mass with what is there now: to be called after masses were loaded."""
        self.activity.warmed()
        self.initial_mass = self.accounts.present_mass()

    def impose(self, temperature: np.ndarray) -> None:
        """Give the particles temperatures [K], shape [n], and all that follows; energy is counted from here."""
        impose_temperature(self.model, temperature)
        self.activity.warmed()

    # ----------------------------------------------------------------- results

    def arrays(self, names: Sequence[str] = SNAPSHOT_ARRAYS) -> dict[str, np.ndarray]:
        """The particles that are still there, in the order of their ids; SI units, names as in the snapshots."""
        count, kinds = self.scene.count, _OF_THE_SCENE
        found = self.state.arrays(["mobility", *(name for name in names if name in self.state.names)])
        there = np.flatnonzero(found["mobility"] != REMOVED)
        found |= {
            name: np.asarray(getattr(self.scene, name)).astype(kinds[name]) for name in names if name in kinds
        }
        found["id"] = np.arange(count, dtype=np.int32)
        found.setdefault("pressure", np.zeros(count))  # that nobody computes
        if "ever_liquid" in found:
            found["ever_liquid"] = found["ever_liquid"].astype(np.uint8)
        # of vectors numpy takes the same rows by a mask, or by numbers in brackets, in ten times the time
        return {name: found[name].take(there, axis=0) for name in names if name in found}

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

    def pause(self) -> None:
        """Have rows and lists built anew next, as a run must that is resumed here: so both go on with the same bits."""
        self.activity.renew()

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs; with a ``pause``."""
        self.pause()
        saved = {f"state.{name}": values for name, values in self.state.arrays(self.state.names).items()}
        saved |= {f"ledger.{name}": getattr(self.ledger, name).to_numpy()
                  for name in ("energy", "momentum", "clamps", "removed", "removed_mass")}  # fmt: skip
        flow = self.flow_step
        fastest = flow.flow.fastest if flow else 0.0
        saved["scene"] = self._scene_sum()
        saved["clock"] = np.array([self.time, self.dt, self.hottest, self.accounts.incident,
                                   flow.flow.dt if flow else 0.0, fastest, self._allowed,
                                   self.bins.floor[None] if self.bins else 0.0])  # fmt: skip
        saved["counts"] = np.array([self.steps, self.particle_steps, self.moving, self.hottest_id,
                                    flow.count if flow else 0,
                                    self.surface.evaluations if self.surface else 0,
                                    self.activity.builds], np.int64)  # fmt: skip
        return saved

    def _scene_sum(self) -> np.ndarray:
        """A check sum of where which particle began."""
        return np.array([zlib.crc32(np.ascontiguousarray(self.scene.position).data)])

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Continue from a ``checkpoint`` of the same config; ValueError if its particles began elsewhere."""
        if not np.array_equal(saved["scene"], self._scene_sum()):
            raise ValueError("its particles are numbered in another way")
        if self.activity.builds == 0:
            self.compile()
        self.state.load(**{name: saved[f"state.{name}"] for name in self.state.names})
        for name in ("energy", "momentum", "clamps", "removed", "removed_mass"):
            getattr(self.ledger, name).from_numpy(saved[f"ledger.{name}"])
        time_, dt, hottest, incident, dt_before, fastest, allowed, floor = (float(x) for x in saved["clock"])
        self.time, self.dt, self.hottest, self.accounts.incident = time_, dt, hottest, incident
        self._allowed = allowed
        counts = [int(n) for n in saved["counts"]]
        self.steps, self.particle_steps, self.moving, self.hottest_id, count, evaluations, builds = counts
        self.activity.builds = builds
        if self.surface is not None:
            self.surface.evaluations = evaluations
        if self.flow_step is not None:
            self.flow_step.count = count
            self.flow_step.flow.dt, self.flow_step.flow.fastest = dt_before, fastest
        if self.bins is not None:
            self.bins.floor[None] = floor
        self.activity.restart()
        self.guards.restart()
