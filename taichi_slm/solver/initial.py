"""The state at time zero: properties, masses, phases and velocities from the scene."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.materials.tables import PropertyTables, enthalpy_at
from taichi_slm.scene.program import program_rate
from taichi_slm.solver.model import Model, starts_mobile
from taichi_slm.state import HELD, MOBILE, STILL, WALL


@dataclass(frozen=True)
class Beginning:
    """What the loop and the accounts must know of the start."""

    momentum: np.ndarray  # [N s], shape [d]
    hottest: float  # [K]
    hottest_id: int
    moving: int  # particles that can move


def load_initial_state(model: Model) -> Beginning:
    """Fill the fields of ``model`` from its scene.

    A particle above its solidus is mobile. Its mass is its volume times the reference density at its temperature; under
    gravity the density is that of liquid at rest under what lies above it.
    """
    scene, state, tables = model.scene, model.state, model.host_tables
    T, m = scene.temperature, scene.material
    mobile = starts_mobile(scene, tables) & state.needs.flow
    density = look_up(tables, "density", m, T) + _hydrostatic_excess(model, mobile)
    mass = density * scene.volume
    velocity = _initial_velocity(model, density)
    velocity[~mobile] = 0.0
    start = {
        "position": scene.position, "temperature": T, "material": m, "mass": mass, "density": density,
        "volume": scene.volume, "kind": WALL * scene.wall + HELD * scene.held, "velocity": velocity,
        "mobility": np.where(mobile, MOBILE, STILL),
    }  # fmt: skip
    state.load(**{name: values for name, values in start.items() if np.any(values)})  # the others are zero
    if state.needs.heat:
        H = _enthalpy(tables, m, T)
        state.load(enthalpy=H, enthalpy_initial=H)
    if state.needs.flow:
        state.load(shepard=np.ones(scene.count))
    model.set_everywhere()
    momentum = np.sum(mass[:, None] * velocity, axis=0)
    return Beginning(momentum, float(T.max()), int(T.argmax()), int(np.count_nonzero(mobile)))


def impose_temperature(model: Model, temperature: np.ndarray) -> None:
    """Give all particles temperatures [K], shape [n], and all that follows; the accounts of energy begin here."""
    state = model.state
    state.load(temperature=temperature)
    if state.needs.heat:
        H = _enthalpy(model.host_tables, model.scene.material, temperature)
        state.load(enthalpy=H, enthalpy_initial=H)
        model.ledger.energy.fill(0.0)
    model.set_everywhere()


def _enthalpy(tables: PropertyTables, material: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """Enthalpy [J/kg] of particles of ``material`` at ``temperature`` [K], shape [n]."""
    H = np.empty(len(temperature))
    for number in np.unique(material):
        own = material == number
        different, index = np.unique(temperature[own], return_inverse=True)
        H[own] = np.asarray(enthalpy_at(tables, int(number), different))[index.reshape(-1)]
    return H


def look_up(tables: PropertyTables, name: str, material: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """Property ``name`` of particles of ``material`` at ``temperature`` [K], shape [n]."""
    values = np.empty(len(temperature))
    for number in np.unique(material):
        own = material == number
        values[own] = np.interp(temperature[own], tables.temperature[number], getattr(tables, name)[number])
    return values


def _hydrostatic_excess(model: Model, mobile: np.ndarray) -> Any:
    """Density [kg/m^3] above the reference one under which liquid at rest carries what lies above it, shape [n]."""
    scene, config = model.scene, model.config
    excess = np.zeros(scene.count)
    if config.gravity != 0.0 and mobile.any() and scene.wall.any():  # a free drop carries nothing
        height = scene.position[mobile, -1]
        top = height.max() + 0.5 * scene.spacing
        density = look_up(model.host_tables, "density", scene.material[mobile], scene.temperature[mobile])
        excess[mobile] = density * config.gravity * (top - height) / config.numerics.sound_speed**2
    return excess


def _initial_velocity(model: Model, density: np.ndarray) -> np.ndarray:
    """The bodies' velocities [m/s]; a body that follows its density starts with the rate that this asks for."""
    scene, tables = model.scene, model.host_tables
    velocity = scene.velocity.copy()
    for number in scene.follows_density:
        own = scene.body == number
        T, m = scene.temperature[own], scene.material[own]
        warmer, cooler = (look_up(tables, "density", m, T + by) for by in (0.01, -0.01))
        rate = (warmer - cooler) / 0.02 * program_rate(scene.programs[number], 0.0)
        expansion = -rate / density[own]  # div u = -(1/rho) drho/dt
        centre = scene.position[own].mean(axis=0)
        velocity[own] += (expansion / scene.dimension)[:, None] * (scene.position[own] - centre)
    return velocity
