"""The particle fields: the one place where they are allocated."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.backend import Blocks, direct, ti

STILL, MOBILE, REMOVED = 0, 1, -1  # values of `mobility`
WALL, HELD = 1, 2  # bits of `kind`
REAL = "real"  # kind of a field of the state's precision; the others are "f64" and "i32"
ALWAYS, MOVING, HOT, OUTER = (
    "always",
    "moving",
    "hot",
    "outer",
)  # since when a particle has a field: see `Blocks`


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

    def __init__(self, count: int, dimension: int, needs: Needs, real: Any, make: Any = None):
        """``real``: ti.f64 or ti.f32; ``make``: what makes the fields, by default `_OnDevice`."""
        self.count = count
        self.dimension = dimension
        self.needs = needs
        self.real = real
        self.names: list[str] = []
        self._copiers: dict[tuple[str, ...], list[Any]] = {}  # by names
        make = make or _OnDevice(count, dimension, real)

        def scalar(name: str, kind: str = REAL, of: str = ALWAYS) -> Any:
            self.names.append(name)
            return make.scalar(kind, of)

        def vector(name: str, of: str = ALWAYS) -> Any:
            self.names.append(name)
            return make.vector(of)

        # constant after the start, but for removal, which sets mass and volume to zero
        self.mass = scalar("mass")  # [kg], 2-D [kg/m]; removal
        self.material = scalar("material", "i32")  # index
        self.kind = scalar("kind", "i32")  # bits WALL, HELD
        # mechanics
        self.position = vector("position")  # [m]; move
        self.velocity = vector("velocity")  # [m/s]; kick
        self.density = scalar("density")  # [kg/m^3]; move, phase change
        self.volume = scalar("volume")  # [m^d] mass/density; move, phase change
        self.mobility = scalar("mobility", "i32")  # STILL, MOBILE, REMOVED; phase change, removal
        # material at the present temperature
        self.temperature = scalar("temperature")  # [K]; phase change, program
        self.liquid_fraction = scalar("liquid_fraction")  # [-]; phase change
        self.ever_liquid = scalar("ever_liquid", "i32")  # 1 once s >= 1/2; phase change
        self.reference_density = scalar("reference_density")  # rho0(T) [kg/m^3]; phase change
        if needs.heat:
            self.enthalpy = scalar("enthalpy", "f64")  # [J/kg]; heat
            self.enthalpy_initial = scalar("enthalpy_initial", "f64")  # [J/kg]; start
            # [J/kg], at the start of a heat step; heat
            self.enthalpy_before = scalar("enthalpy_before", "f64", of=HOT)
            self.enthalpy_past = scalar("enthalpy_past", "f64", of=HOT)  # [J/kg], two stages ago; heat
            self.heating = scalar("heating", "f64", of=HOT)  # [W]; heat rates
            self.heating_before = scalar("heating_before", "f64", of=HOT)  # [W], first stage; heat
            self.kirchhoff = scalar("kirchhoff")  # integral of k dT [W/m]; phase change
            self.conduction_factor = scalar("conduction_factor")  # [-], of a pair's heat; surroundings
        if needs.conductivity:
            self.conductivity = scalar("conductivity")  # k [W/(m K)]; phase change
        if needs.radiation:
            self.radiated = scalar("radiated", of=HOT)  # [W]; heat rates
        if needs.evaporation:
            self.evaporated = scalar("evaporated", of=HOT)  # [W]; heat rates
        if needs.laser:
            self.laser = scalar("laser", "f64", of=HOT)  # absorbed [W]; laser
        if needs.losses:
            self.surface_area = scalar("surface_area", of=HOT)  # per volume of metal [1/m]; surroundings
        if needs.viscous_heating:
            # [J] since the last heat step; momentum
            self.viscous_work = scalar("viscous_work", "f64", of=HOT)
        if needs.flow:
            self.pressure = scalar("pressure")  # [Pa]; equation of state, wall pressure
            self.acceleration = vector("acceleration", of=MOVING)  # [m/s^2]; momentum
            self.density_rate = scalar("density_rate", of=MOVING)  # [kg/(m^3 s)]; continuity
            # [m] at which cells and lists have a particle, within half a skin of where it is; cells
            self.reference_position = vector("reference_position")
            self.shepard = scalar("shepard")  # Gamma = Sum V W [-]; continuity
        if needs.flow and needs.still:
            self.wall_force = vector("wall_force", of=MOVING)  # [N] from walls on a mobile particle; momentum
        if needs.viscosity:
            self.viscosity = scalar("viscosity")  # [Pa s]; phase change
        if needs.shown_velocity:
            # [m/s] that viscosity sees: a mobile particle's own, a still one's by what walls ask for; move, walls
            self.shown_velocity = vector("shown_velocity")
        if needs.printed_leapfrog:
            self.acceleration_before = vector("acceleration_before", of=MOVING)  # [m/s^2]; kick
        if needs.surface:
            self.colour_strength = scalar("colour_strength", of=OUTER)  # |grad c| [1/m]; colour gradient
            self.normal = vector("normal", of=OUTER)  # unit, inward, or zero where cut; colour gradient
        if needs.tension:
            self.surface_tension = scalar("surface_tension")  # [N/m]; phase change
            self.surface_tension_slope = scalar("surface_tension_slope")  # [N/(m K)]; phase change
            self.curvature = scalar("curvature", of=MOVING)  # [1/m], negative on a drop; surface forces
            self.surface_force = vector("surface_force", of=MOVING)  # [N/m^d]; surface forces, momentum
        if needs.body_force:
            self.colour_gradient = vector("colour_gradient", of=MOVING)  # [1/m], inward; colour gradient
        if needs.balanced:
            # [N/m^d], Marangoni; surface forces
            self.tangential_force = vector("tangential_force", of=MOVING)
            # capillary pressure of the surface [Pa]; surface forces
            self.capillary = scalar("capillary", of=MOVING)
            self.at_surface = scalar("at_surface", of=MOVING)  # its weight, 0 inside to 1; surface forces
            self.background = scalar("background")  # its smooth extension inwards [Pa]; move
            self.background_mean = scalar("background_mean", of=MOVING)  # of the neighbours' [Pa]; continuity
        if needs.shifting:
            self.shift = vector("shift", of=MOVING)  # [m] of this step; momentum

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


class _OnDevice:
    """Makes the fields of `State` in Taichi."""

    def __init__(self, count: int, dimension: int, real: Any):
        self._count, self._dimension, self._real = count, dimension, real
        self._blocks = {of: Blocks(count) for of in (MOVING, HOT, OUTER)}

    def scalar(self, kind: str, of: str) -> Any:
        """A field of numbers."""
        made = self._real if kind == REAL else getattr(ti, kind)
        return ti.field(made, shape=self._count) if of == ALWAYS else self._blocks[of].field(made)

    def vector(self, of: str) -> Any:
        """A field of vectors."""
        if of == ALWAYS:
            return ti.Vector.field(self._dimension, self._real, shape=self._count)
        return self._blocks[of].vectors(self._dimension, self._real)


class _Counted:
    """Makes no field, but counts the bytes that it would take a particle, by since when it has them."""

    def __init__(self, dimension: int, real: int):
        self._dimension, self._sizes = dimension, {REAL: real, "f64": 8, "i32": 4}
        self.taken = dict.fromkeys((ALWAYS, MOVING, HOT, OUTER), 0)

    def scalar(self, kind: str, of: str) -> None:
        """Count a number."""
        self.taken[of] += self._sizes[kind]

    def vector(self, of: str) -> None:
        """Count a vector."""
        self.taken[of] += self._dimension * self._sizes[REAL]


def bytes_of_a_particle(needs: Needs, dimension: int, real: int = 8) -> tuple[int, int]:
    """(bytes of all fields of a particle, of them those that it takes once it moves, is hot or near a surface).

    Without Taichi; ``real``: 8 for f64, 4 for f32.
    """
    counted = _Counted(dimension, real)
    State(0, dimension, needs, None, counted)
    whole = sum(counted.taken.values())
    return whole, whole - counted.taken[ALWAYS]


def reader(state: State, name: str) -> Any:
    """The Taichi function (particle) -> the field ``name``; 0 where the scene needs no such field."""
    has = name in state.names
    field: Any = getattr(state, name) if has else None

    @ti.func
    def read(a):
        result = ti.cast(0.0, state.real)
        if ti.static(has):
            result = field[a]
        return result

    return read


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
