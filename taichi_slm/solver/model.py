"""A scene on the device, with the passes that it needs and no others: what a Config and a Scene become."""

from typing import Any

import numpy as np

from taichi_slm.backend import Schedule, direct, ti
from taichi_slm.config.schema import Config
from taichi_slm.materials.tables import PropertyTables, tabulate
from taichi_slm.physics.laser import LaserBins
from taichi_slm.physics.material import MaterialTables
from taichi_slm.physics.phase_change import needed_tables, property_setter
from taichi_slm.physics.viscosity import artificial_viscosity
from taichi_slm.scene.scene import Scene
from taichi_slm.solver.activity import AHEAD, AHEAD_STEPS, WARM_FROM, Activity
from taichi_slm.solver.discretisation import discretise
from taichi_slm.solver.ejection import Ejection
from taichi_slm.solver.flow import FlowPasses
from taichi_slm.solver.heat import HeatPasses
from taichi_slm.solver.ledger import Ledger
from taichi_slm.solver.needs import needs_of, shifting_strength
from taichi_slm.solver.step import FlowStep
from taichi_slm.solver.surface import SurfacePasses
from taichi_slm.solver.timestep import StepLimits
from taichi_slm.sph.cells import Cells, cell_size
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import State


def starts_mobile(scene: Scene, tables: PropertyTables) -> np.ndarray:
    """Whether each particle is above its solidus and no wall, shape [n]."""
    return np.asarray((scene.temperature > tables.segment_start[scene.material, 1]) & ~scene.wall)


class Model:
    """State, lists, ledger and passes. A term that the config does not have is None or not compiled.

    ``schedule`` says which loops run on one thread.
    """

    def __init__(self, config: Config, scene: Scene, real: Any, schedule: Schedule):
        numerics, d, dx = config.numerics, scene.dimension, scene.spacing
        self.config, self.scene = config, scene
        self.disc = disc = discretise(
            d, dx, config.physics, numerics, config.gravity, config.ambient_temperature, shifting_strength(config),
            schedule, real,
        )  # fmt: skip
        self.host_tables = tables = tabulate(scene.materials, numerics.solid_density)
        viscous = bool(np.any(tables.viscosity > 0.0)) or numerics.artificial_viscosity > 0.0
        all_move = bool(starts_mobile(scene, tables).all())
        needs = needs_of(config, len(scene.materials), not all_move, viscous)
        self.limits = StepLimits(config, self.host_tables)
        self.state = state = State(scene.count, d, needs, real)
        self.tables = MaterialTables(self.host_tables, real, needed_tables(state))
        self.ledger = Ledger(d)

        skin = config.performance.skin * dx
        still = disc.flow_kernel.support
        near = still + skin
        far = disc.surface_kernel.support + skin if needs.surface and needs.flow else None
        margin = 2.0 * dx
        lower, upper = scene.lower - margin, scene.upper + margin
        widest = max(far or near, disc.surface_kernel.support if needs.surface else 0.0)
        ahead = AHEAD * 0.5 * skin, AHEAD_STEPS
        cells = Cells(state, lower, upper, cell_size(far or near, dx), dx, widest, ahead, schedule)
        self.rows = Neighbours(state, cells, still, near, far, dx, schedule)
        self.bins = None
        if config.laser is not None and needs.laser:
            whole = not config.performance.skip_dark
            self.bins = LaserBins(config.laser, state, self.rows, lower, upper, dx, whole, schedule)
        rest, all_hot = self._rest_temperature()
        self.activity = Activity(state, cells, self.rows, config, rest, all_hot, self.bins)
        self.surface = self._surface_passes(cells)
        self.flow_step = self._flow_step() if needs.flow else None
        self.heat = self._heat_passes(rest) if needs.heat else None
        self.activity.surface, self.activity.heat = self.surface, self.heat
        self.set_everywhere, self.set_body = self._compile_setters()

    @property
    def _alpha(self) -> float:
        """Kinematic artificial viscosity [m^2/s]."""
        numerics = self.config.numerics
        return artificial_viscosity(
            numerics.artificial_viscosity, self.disc.h, numerics.sound_speed, self.scene.dimension
        )

    def _surface_passes(self, cells: Cells) -> SurfacePasses | None:
        if not self.state.needs.surface:
            return None
        evaporations = tuple(material.evaporation for material in self.scene.materials)
        skip = self.config.performance.skip_interior
        return SurfacePasses(self.state, cells, self.rows, self.disc, self.ledger, evaporations, skip)

    def _flow_step(self) -> FlowStep:
        numerics, scene = self.config.numerics, self.scene
        flow = FlowPasses(self.state, self.rows, self.disc, self.ledger)
        minimum = numerics.minimum_neighbours
        minimum = (3 if scene.dimension == 2 else 6) if minimum is None else minimum
        self.activity.flow = flow
        self.activity.ejection = Ejection(
            self.state, self.rows, self.disc, self.ledger, scene.lower, scene.upper, minimum
        )
        return FlowStep(numerics.integrator, flow, self.surface, self.activity, numerics.surface_every)

    def _heat_passes(self, rest: float) -> HeatPasses:
        host = self.host_tables
        evaporations = tuple(material.evaporation for material in self.scene.materials)
        return HeatPasses(self.state, self.rows, self.disc, self.ledger, self.tables, host.emissivity,
                          host.band_heat_capacity, evaporations, self._alpha, WARM_FROM, rest)  # fmt: skip

    def _rest_temperature(self) -> tuple[float, bool]:
        """The commonest initial temperature [K], and whether all must count as hot because it is not the ambient's."""
        values, counts = np.unique(self.scene.temperature, return_counts=True)
        rest = float(values[np.argmax(counts)])
        exchanges = self.config.physics.radiation or self.config.physics.evaporation
        return rest, exchanges and abs(rest - self.config.ambient_temperature) > WARM_FROM

    def _compile_setters(self) -> tuple[Any, Any]:
        state = self.state
        set_properties = property_setter(state, self.tables, self._alpha)
        # set_body is for programs alone
        body = ti.field(ti.i32, shape=state.count if self.scene.programs else 1)
        if self.scene.programs:
            body.from_numpy(np.ascontiguousarray(self.scene.body, np.int32))

        @direct
        @ti.kernel
        def set_everywhere():
            for a in range(state.count):
                set_properties(a, state.temperature[a], True)

        @direct
        @ti.kernel
        def set_body(number: ti.i32, T: ti.f64):
            for a in range(state.count):
                if body[a] == number:
                    set_properties(a, ti.cast(T, state.real), True)

        return set_everywhere, set_body
