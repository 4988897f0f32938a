"""The four scenes of the map, each small enough to run in seconds, and what may be changed in them.

drop     2-D steel drop, R 50 um, sigma 1.8 N/m, R/dx 10, c0 50 m/s, swinging in its second mode (5 %) for a period and
         a half; for the capillary limit c0 is 10 m/s, or sound would rule
column   2-D liquid column at rest in a container, H/dx 16, c0 = 10 sqrt(g H), nu = 0.02 sqrt(g H^3), for 30 H/c0
weld     3-D spot weld (1967 W, 3 ms) on a plate of 1.2 x 1.2 x 0.6 mm at 100 um, with Marangoni flow, for 1.2 ms
track    2-D, 150 W over two grains on a plate at 5 um, c0 20 m/s, for 50 us

``Setting`` multiplies what is physical (c0, viscosity, spacing); the numerics and the precision are changed beside.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from taichi_slm.benchmark.paper import NO_SKIPS, PAPER_FORMS
from taichi_slm.benchmark.scenes import UM
from taichi_slm.benchmark.scenes import track as powder_track
from taichi_slm.config.schema import Config
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.cases import hydrostatic, static_drop
from taichi_slm.verification.cases.spot_weld import WELD_STEEL
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

STRETCH = 0.05  # of the swinging drop
LIFTED = 1e9  # a factor that makes a limit one that never rules
FACTORS = {"sound": "courant", "viscosity": "viscous_factor", "capillary": "capillary_factor", "heat": "heat_factor",
           "laser": "temperature_step"}  # fmt: skip
HEAT_POWER = 0.4  # of the laser's, where no flow carries the heat away
COOLING = 60  # heat steps of cold metal after the beam, in which an unstable one shows


@dataclass(frozen=True)
class Setting:
    """What is changed in a scene: multiples of c0, viscosity and spacing; precision; keys of numerics."""

    c0: float = 1.0
    viscosity: float = 1.0
    spacing: float = 1.0
    precision: str = "f64"
    numerics: dict[str, Any] = field(default_factory=dict)
    printed: bool = False  # every form of the paper, and no skips

    def physical(self) -> "Setting":
        """The same matter, computed with the default forms in f64."""
        return Setting(self.c0, self.viscosity, self.spacing)


@dataclass(frozen=True)
class Scene:
    """A scene; ``start`` gives it its first velocities; kinetic energy below ``still`` [J, in 2-D J/m] is stillness."""

    build: Callable[[Setting], Config]
    start: Callable[[Simulation], None] = lambda _: None
    still: float = 0.0


def _omega() -> float:
    return math.sqrt(6 * static_drop.SIGMA / (static_drop.RHO * static_drop.RADIUS**3))


def drop(setting: Setting, c0: float = 50.0) -> Config:
    """The swinging drop."""
    radius = static_drop.RADIUS
    metal = liquid(density=static_drop.RHO, viscosity=static_drop.MU * setting.viscosity,
                   surface_tension=static_drop.SIGMA)  # fmt: skip
    return configure(
        spacing=0.1 * radius * setting.spacing, materials={"steel": metal},
        bodies=[{"shape": "droplet", "material": "steel", "centre": [0.0, 0.0], "radius": radius}],
        physics={**FLOW_ONLY, "surface_tension": True}, numerics={"sound_speed": c0 * setting.c0},
        time={"end": 1.5 * 2.0 * math.pi / _omega()},
    )  # fmt: skip


def soft_drop(setting: Setting) -> Config:
    """The swinging drop with a c0 so low that surface tension rules the step."""
    return drop(setting, 10.0)


def swing(sim: Simulation) -> None:
    """Give a drop the velocity of its second mode."""
    sim.state.load(velocity=STRETCH * _omega() * sim.position * [1.0, -1.0])


def column(setting: Setting) -> Config:
    """The column at rest."""
    dx, depth, nu = setting.spacing / 16, hydrostatic.DEPTH, hydrostatic.NU * setting.viscosity
    size = [0.5 * depth, depth]
    return configure(
        spacing=dx, gravity=hydrostatic.GRAVITY,
        materials={"fluid": liquid(density=hydrostatic.RHO, viscosity=hydrostatic.RHO * nu)},
        bodies=[{"shape": "container", "material": "fluid", "corner": [0, 0], "size": [size[0], 1.3 * depth]},
                {"shape": "box", "material": "fluid", "corner": [0, 0], "size": size}],
        physics=FLOW_ONLY, numerics={"sound_speed": hydrostatic.SOUND * setting.c0},
        time={"end": 30.0 * hydrostatic.SOUND_TIME},
    )  # fmt: skip


def weld(setting: Setting) -> Config:
    """The spot weld, coarse and short."""
    steel = (
        {**WELD_STEEL, "scale": {"viscosity": setting.viscosity}} if setting.viscosity != 1.0 else WELD_STEEL
    )
    return configure(
        dimension=3, spacing=100 * UM * setting.spacing, materials={"weld_steel": steel},
        bodies=[{"shape": "plate", "material": "weld_steel", "start": "-0.6 mm", "length": "1.2 mm",
                 "width": "1.2 mm", "depth": "0.6 mm", "cold_layers": 1}],
        laser={"power": 1967, "beam_radius": "0.428 mm", "exponent": 3, "absorptivity": 0.33,
               "path": [{"kind": "dwell", "at": ["6.5 um", "4 um"], "duration": "3 ms"}]},
        numerics={"sound_speed": 20 * setting.c0}, time={"end": 1.2e-3},
    )  # fmt: skip


def track(setting: Setting) -> Config:
    """Two grains under a moving beam."""
    numerics = {"sound_speed": 20 * setting.c0}
    config = powder_track(2, duration=50e-6, spacing=5 * UM * setting.spacing, numerics=numerics)
    if setting.viscosity == 1.0:
        return config
    steel = {"extends": "steel_304", "scale": {"viscosity": setting.viscosity}}
    written = config.model_dump(exclude_unset=True) | {"materials": {"steel": steel}}
    return Config.model_validate(
        written | {"bodies": [{**body, "material": "steel"} for body in written["bodies"]]}
    )


_COLUMN_MASS = hydrostatic.RHO * 0.5 * hydrostatic.DEPTH**2  # [kg/m]
SCENES = {
    "drop": Scene(drop, swing),
    "soft drop": Scene(soft_drop, swing),
    "column": Scene(column, still=1e-4 * _COLUMN_MASS * hydrostatic.GRAVITY * hydrostatic.DEPTH),
    "weld": Scene(weld),
    "track": Scene(track),
}


def with_numerics(
    config: Config, numerics: dict[str, Any], performance: dict[str, Any] | None = None
) -> Config:
    """``config`` with keys of its numerics changed, checked anew."""
    parts: dict[str, Any] = {"numerics": type(config.numerics)(**config.numerics.model_dump() | numerics)}
    if performance:
        parts["performance"] = type(config.performance)(**config.performance.model_dump() | performance)
    return config.model_copy(update=parts)


def stepped(config: Config, setting: Setting, limit: str, multiple: float) -> Config:
    """``config`` with the forms of ``setting``, stepped by ``multiple`` times the default of one limit alone.

    Of the flow's limits the others are lifted. For "heat" the flow is switched off, and the end is late enough after
    the beam that heat rules; for "all" every limit is multiplied, none is lifted.
    """
    default = config.numerics.model_dump()
    forms = (
        {key: value for key, value in PAPER_FORMS.items() if key not in FACTORS.values()}
        if setting.printed
        else {}
    )
    if limit == "all":
        factors = {key: multiple * default[key] for key in FACTORS.values()}
    else:
        others = [] if limit == "heat" else ["sound", "viscosity", "capillary"]
        factors = {FACTORS[name]: LIFTED for name in others}
        factors[FACTORS[limit]] = multiple * default[FACTORS[limit]]
    config = with_numerics(config, forms | setting.numerics | factors, NO_SKIPS if setting.printed else None)
    return _heat_alone(config) if limit == "heat" else config


def _heat_alone(config: Config) -> Config:
    """Without flow, and long enough after the beam that many heat steps are as long as the scheme allows."""
    from taichi_slm.scene.beam import BeamPath
    from taichi_slm.scene.build import build_scene
    from taichi_slm.solver.timestep import limits

    assert config.laser is not None
    default = type(config.numerics)()
    short = with_numerics(
        config, {name: getattr(default, name) for name in ("heat_factor", "heat_stages", "heat_scheme")}
    )
    cooling = COOLING * limits(short, build_scene(config).materials, 300.0)["heat"]
    physics = config.physics.model_copy(update={"flow": False})
    laser = config.laser.model_copy(update={"power": HEAT_POWER * config.laser.power})
    time = config.time.model_copy(update={"end": BeamPath(config.laser, config.dimension).end + cooling})
    return config.model_copy(update={"physics": physics, "laser": laser, "time": time})
