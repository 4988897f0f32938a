"""The particle fields: the one place where they are allocated."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.backend import Blocks, direct, ti

STILL, MOBILE, REMOVED = 0, 1, -1  # values of `mobility`
WALL, HELD = 1, 2  # bits of `kind`


@dataclass(frozen=True)
class Needs:
    """Which groups of fields a scene needs; what it does not need is not allocated."""

    flow: bool
    still: bool  # somebody stands still or may come to: what is solid, walls, what is held
    viscosity: bool
    heat: bool
    conductivity: bool  # of a particle: pairs of one material need none, but the integral
    surface: bool  # colour gradient, normals
    tension: bool  # curvature and surface forces
    balanced: bool  # capillary pressure through the operator of the pressure gradient
    body_force: bool  # surface tension along the colour gradient instead
    shifting: bool
    shown_velocity: bool
    laser: bool
    radiation: bool
    evaporation: bool
    viscous_heating: bool
    printed_leapfrog: bool

    @property
    def losses(self) -> bool:
        """Whether heat leaves through the surface."""
        return self.radiation or self.evaporation


class State:
    """Particles, shape [n] each, SI units. Every field says who writes it.

    ``real`` is the precision of the particle fields (f64 or f32); enthalpies and accounts are f64 always, so
    that small increments are not lost.

    Fields that only their own particle reads, and only once it moves or is hot, take memory from then on (`Blocks`,
    in a large scene): cold metal does without them. Those of the surface take it near a surface.
    """

    def __init__(self, count: int, dimension: int, needs: Needs, real: Any):
        self.count = count
        self.dimension = dimension
        self.needs = needs
        self.real = real
        self.names: list[str] = []
        self._copiers: dict[tuple[str, ...], list[Any]] = {}  # by names
        moving, hot, outer = Blocks(count), Blocks(count), Blocks(count)

        def scalar(name: str, kind: Any = None, of: Blocks | None = None) -> Any:
            self.names.append(name)
            return of.field(kind or real) if of else ti.field(kind or real, shape=count)

        def vector(name: str, of: Blocks | None = None) -> Any:
            self.names.append(name)
            return of.vectors(dimension, real) if of else ti.Vector.field(dimension, real, shape=count)

        # constant after the start, but for removal, which sets mass and volume to zero
        self.mass = scalar("mass")  # [kg], 2-D [kg/m]; removal
        self.material = scalar("material", ti.i32)  # index
        self.kind = scalar("kind", ti.i32)  # bits WALL, HELD
        # mechanics
        self.position = vector("position")  # [m]; move
        self.velocity = vector("velocity")  # [m/s]; kick
        self.density = scalar("density")  # [kg/m^3]; move, phase change
        self.volume = scalar("volume")  # [m^d] mass/density; move, phase change
        self.mobility = scalar("mobility", ti.i32)  # STILL, MOBILE, REMOVED; phase change, removal
        # material at the present temperature
        self.temperature = scalar("temperature")  # [K]; phase change, program
        self.liquid_fraction = scalar("liquid_fraction")  # [-]; phase change
        self.ever_liquid = scalar("ever_liquid", ti.i32)  # 1 once s >= 1/2; phase change
        self.reference_density = scalar("reference_density")  # rho0(T) [kg/m^3]; phase change
        if needs.heat:
            self.enthalpy = scalar("enthalpy", ti.f64)  # [J/kg]; heat
            self.enthalpy_initial = scalar("enthalpy_initial", ti.f64)  # [J/kg]; start
            # [J/kg], at the start of a heat step; heat
            self.enthalpy_before = scalar("enthalpy_before", ti.f64, of=hot)
            self.enthalpy_past = scalar("enthalpy_past", ti.f64, of=hot)  # [J/kg], two stages ago; heat
            self.heating = scalar("heating", ti.f64, of=hot)  # [W]; heat rates
            self.heating_before = scalar("heating_before", ti.f64, of=hot)  # [W], first stage; heat
            self.kirchhoff = scalar("kirchhoff")  # integral of k dT [W/m]; phase change
            self.conduction_factor = scalar("conduction_factor")  # [-], of a pair's heat; surroundings
        if needs.conductivity:
            self.conductivity = scalar("conductivity")  # k [W/(m K)]; phase change
        if needs.radiation:
            self.radiated = scalar("radiated", of=hot)  # [W]; heat rates
        if needs.evaporation:
            self.evaporated = scalar("evaporated", of=hot)  # [W]; heat rates
        if needs.laser:
            self.laser = scalar("laser", ti.f64, of=hot)  # absorbed [W]; laser
        if needs.losses:
            self.surface_area = scalar("surface_area", of=hot)  # per volume of metal [1/m]; surroundings
        if needs.viscous_heating:
            # [J] since the last heat step; momentum
            self.viscous_work = scalar("viscous_work", ti.f64, of=hot)
        if needs.flow:
            self.pressure = scalar("pressure")  # [Pa]; equation of state, wall pressure
            self.acceleration = vector("acceleration", of=moving)  # [m/s^2]; momentum
            self.density_rate = scalar("density_rate", of=moving)  # [kg/(m^3 s)]; continuity
            # [m] at which cells and lists have a particle, within half a skin of where it is; cells
            self.reference_position = vector("reference_position")
            self.shepard = scalar("shepard")  # Gamma = Sum V W [-]; continuity
        if needs.flow and needs.still:
            self.wall_force = vector("wall_force", of=moving)  # [N] from walls on a mobile particle; momentum
        if needs.viscosity:
            self.viscosity = scalar("viscosity")  # [Pa s]; phase change
        if needs.shown_velocity:
            # [m/s] that viscosity sees: a mobile particle's own, a still one's by what walls ask for; move, walls
            self.shown_velocity = vector("shown_velocity")
        if needs.printed_leapfrog:
            self.acceleration_before = vector("acceleration_before", of=moving)  # [m/s^2]; kick
        if needs.surface:
            self.colour_strength = scalar("colour_strength", of=outer)  # |grad c| [1/m]; colour gradient
            self.normal = vector("normal", of=outer)  # unit, inward, or zero where cut; colour gradient
        if needs.tension:
            self.surface_tension = scalar("surface_tension")  # [N/m]; phase change
            self.surface_tension_slope = scalar("surface_tension_slope")  # [N/(m K)]; phase change
            self.curvature = scalar("curvature", of=moving)  # [1/m], negative on a drop; surface forces
            self.surface_force = vector("surface_force", of=moving)  # [N/m^d]; surface forces, momentum
        if needs.body_force:
            self.colour_gradient = vector("colour_gradient", of=moving)  # [1/m], inward; colour gradient
        if needs.balanced:
            # [N/m^d], Marangoni; surface forces
            self.tangential_force = vector("tangential_force", of=moving)
            # capillary pressure of the surface [Pa]; surface forces
            self.capillary = scalar("capillary", of=moving)
            self.at_surface = scalar("at_surface", of=moving)  # its weight, 0 inside to 1; surface forces
            self.background = scalar("background")  # its smooth extension inwards [Pa]; move
            self.background_mean = scalar("background_mean", of=moving)  # of the neighbours' [Pa]; continuity
        if needs.shifting:
            self.shift = vector("shift", of=moving)  # [m] of this step; momentum

    def load(self, **arrays: np.ndarray) -> None:
        """Copy numpy arrays of shape [n] or [n, d] into the fields of those names."""
        for name, values in arrays.items():
            target = getattr(self, name)
            whole = np.ascontiguousarray(values, dtype=_NUMPY[str(target.dtype)])
            if target.shape == (self.count,):
                target.from_numpy(whole)
            else:
                _fill_blocks(target, whole)

    def array(self, name: str) -> np.ndarray:
        """The field ``name`` as numpy, shape [n] or [n, d]."""
        return self.arrays([name])[name]

    def arrays(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """The fields ``names`` as numpy, shape [n] or [n, d] each.

        They are copied together: a kernel for each field took 13 ms of Python when it was first used.
        """
        key = tuple(names)
        if key not in self._copiers:
            self._copiers[key] = [
                _Copier({name: getattr(self, name) for name in names if getattr(self, name).dtype == kind})
                for kind in dict.fromkeys(getattr(self, name).dtype for name in names)
            ]
        found = {name: values for copier in self._copiers[key] for name, values in copier(self.count).items()}
        return {name: found[name] for name in names}


def mover(state: State) -> Any:
    """The Taichi function (particle) -> 1 if it moves, 0 if it stands still, of the state's precision."""

    @ti.func
    def moves(a):
        result = ti.cast(1.0, state.real)
        if ti.static(state.needs.still):
            result = ti.cast(state.mobility[a] == MOBILE, state.real)
        return result

    return moves


_NUMPY = {"f64": np.float64, "f32": np.float32, "i32": np.int32, "i64": np.int64}


class _Copier:
    """Copies ``fields`` of one type to numpy in one pass."""

    def __init__(self, fields: dict[str, Any]):
        self._sizes = {
            name: 0 if isinstance(field, ti.ScalarField) else field.n for name, field in fields.items()
        }
        self._kind = _NUMPY[str(next(iter(fields.values())).dtype)]
        parts = [(field, axis) for name, field in fields.items() for axis in range(self._sizes[name] or 1)]
        columns = [(column, field, axis) for column, (field, axis) in enumerate(parts)]
        self._columns = len(columns)

        @direct
        @ti.kernel
        def copy(values: ti.types.ndarray(ndim=2)):
            for a in range(values.shape[1]):
                for c, source, axis in ti.static(columns):
                    if ti.static(isinstance(source, ti.ScalarField)):
                        values[c, a] = source[a]
                    else:
                        values[c, a] = source[a][axis]

        self._copy: Any = copy

    def __call__(self, count: int) -> dict[str, np.ndarray]:
        values, result, first = np.empty((self._columns, count), self._kind), {}, 0
        self._copy(values)
        for name, size in self._sizes.items():
            result[name] = np.ascontiguousarray(values[first : first + size].T) if size else values[first]
            first += size or 1
        return result


def _fill_blocks(target: Any, values: np.ndarray) -> None:
    """Copy ``values`` into a field of `Blocks`: a zero where there is no memory yet takes none."""

    @direct
    @ti.kernel
    def fill_scalars(given: ti.types.ndarray(ndim=1)):
        for a in range(given.shape[0]):
            if given[a] != 0 or target[a] != 0:
                target[a] = given[a]

    @direct
    @ti.kernel
    def fill_vectors(given: ti.types.ndarray(ndim=2)):
        for a in range(given.shape[0]):
            for axis in ti.static(range(target.n)):
                if given[a, axis] != 0 or target[a][axis] != 0:
                    target[a][axis] = given[a, axis]

    (fill_scalars if values.ndim == 1 else fill_vectors)(values)
