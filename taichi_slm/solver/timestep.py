"""The stable step: the minimum of what each term asks for, on the host, without Taichi.

Each limit is a term's own ``stable_dt``; this page only finds the extreme properties that a scene can have.
"""

import math
from collections.abc import Sequence

import numpy as np

from taichi_slm.config.material import Material
from taichi_slm.config.schema import Config
from taichi_slm.materials.tables import PropertyTables, tabulate
from taichi_slm.physics import conduction, equation_of_state, laser, surface_tension, viscosity


def euler_steps(stages: int) -> float:
    """Stable Euler steps that one step of Runge-Kutta-Legendre with ``stages`` stages is worth (Meyer et al. 2014)."""
    return (stages * stages + stages - 2) / 4.0


def stages_for(ratio: float) -> int:
    """Fewest stages of Runge-Kutta-Legendre for a step of ``ratio`` stable Euler steps: 2 (Heun's), or odd."""
    stages = 2
    while euler_steps(stages) < ratio * (1.0 - 1e-9):
        stages += 1 if stages == 2 else 2
    return stages


class StepLimits:
    """Stable steps of every term that a scene has, as functions of how hot and how fast it is.

    Properties are taken at their worst between the coldest state the term can see (the solidus for a liquid's
    properties) and the hottest temperature so far.
    """

    def __init__(self, config: Config, tables: PropertyTables):
        numerics, physics = config.numerics, config.physics
        self._numerics, self._physics = numerics, physics
        self.h = numerics.smoothing * config.spacing
        self.h_surface = numerics.surface_smoothing * config.spacing
        liquid = tables.temperature >= tables.segment_start[:, 1:2]  # from the solidus on
        alpha = viscosity.artificial_viscosity(
            numerics.artificial_viscosity, self.h, numerics.sound_speed, config.dimension
        )
        nu = np.where(liquid, tables.viscosity / tables.density, 0.0) + alpha
        tension = np.where(liquid, tables.surface_tension / tables.density, 0.0)
        diffusivity = tables.conductivity / (tables.density * tables.heat_capacity)
        self._temperature = tables.temperature
        self._nu = np.maximum.accumulate(nu, axis=1)
        self._tension = np.maximum.accumulate(tension, axis=1)
        self._diffusivity = np.maximum.accumulate(diffusivity, axis=1)
        self._first_liquid = np.argmax(liquid, axis=1)
        self._laser = np.inf
        first = np.where(self._first_liquid > 0, 0, self._first_liquid)  # cold metal, or the coldest liquid
        rho_c = (tables.density * tables.heat_capacity)[np.arange(len(first)), first]
        if config.laser is not None:
            absorptivity = config.laser.absorptivity
            self._laser = laser.stable_dt(
                config.laser,
                float(tables.absorptivity[0]) if absorptivity is None else absorptivity,
                config.spacing,
                float(rho_c.min()),
                numerics.temperature_step,
            )

    def _worst(self, running_maximum: np.ndarray, hottest: float, from_liquid: bool) -> float:
        worst = 0.0
        for row, T, first in zip(running_maximum, self._temperature, self._first_liquid, strict=True):
            knot = min(int(np.searchsorted(T, hottest)), len(T) - 1)
            worst = max(worst, float(row[max(knot, first) if from_liquid else knot]))
        return worst

    def flow(self, hottest: float, fastest: float = 0.0) -> dict[str, float]:
        """Limits [s] of the flow passes at ``hottest`` [K] and ``fastest`` [m/s]: sound, viscosity, capillary."""
        numerics = self._numerics
        limits = {
            "sound": equation_of_state.stable_dt(self.h, numerics.sound_speed + fastest, numerics.courant)
        }
        nu = self._worst(self._nu, hottest, True)
        if nu > 0:
            limits["viscosity"] = viscosity.stable_dt(self.h, nu, 1.0, numerics.viscous_factor)
        tension = self._worst(self._tension, hottest, True)
        if self._physics.surface_tension and tension > 0:
            limits["capillary"] = surface_tension.stable_dt(
                self.h_surface, 1.0, tension, numerics.capillary_factor
            )
        return limits

    def heat(self, hottest: float) -> float:
        """Limit [s] of the heat scheme at ``hottest`` [K]."""
        longer = euler_steps(self._numerics.heat_stages) if self._numerics.heat_scheme == "rkl2" else 1.0
        return longer * self.euler(hottest)

    def heat_reach(self, span: float, hottest: float) -> float:
        """How far heat comes in a heat step of ``span`` [s]: [m], five standard deviations, 6e-7 of it beyond."""
        return 5.0 * math.sqrt(2.0 * self._numerics.heat_factor * span / self.euler(hottest)) * self.h

    def without_waste(self, span: float, hottest: float) -> float:
        """The heat step [s], at most ``span``, that gets the most out of its last pair of stages."""
        if self._numerics.heat_scheme != "rkl2" or math.isinf(span):
            return span
        stable = self.euler(hottest)
        stages = stages_for(span / stable)
        full = euler_steps(stages - 2) * stable
        return full if stages > 3 and full / (stages - 2) > span / stages else span

    def euler(self, hottest: float) -> float:
        """Limit [s] of an explicit Euler step of heat at ``hottest`` [K]."""
        diffusivity = self._worst(self._diffusivity, hottest, False)
        return conduction.stable_dt(self.h, 1.0, max(diffusivity, 1e-300), self._numerics.heat_factor)

    def laser(self) -> float:
        """Limit [s] of the heat passes while the beam is on."""
        return float(self._laser)


def limits(config: Config, materials: Sequence[Material], hottest: float = 3500.0) -> dict[str, float]:
    """The stable step of every term [s] by name (sound, viscosity, capillary, heat, laser) up to ``hottest`` [K]."""
    stable = StepLimits(config, tabulate(materials, config.numerics.solid_density))
    found = stable.flow(hottest) if config.physics.flow else {}
    if config.physics.heat:
        found["heat"] = stable.heat(hottest)
        if config.laser is not None and config.laser.power > 0:
            found["laser"] = stable.laser()
    return found
