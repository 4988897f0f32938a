"""What a scene needs: which fields, and with them which terms, follow from a config."""

from taichi_slm.config.schema import Config
from taichi_slm.physics.shifting import UNDER_TENSION
from taichi_slm.state import Needs


def needs_of(config: Config, materials: int = 1, still: bool = True, viscous: bool = True) -> Needs:
    """Which groups of fields the terms of this config need, for particles of so many ``materials``.

    ``still``: somebody stands still at the start; ``viscous``: a material, or the numerics, have a viscosity.
    """
    physics, numerics = config.physics, config.numerics
    tension = physics.flow and (physics.surface_tension or physics.marangoni or physics.recoil)
    radiation, evaporation = physics.heat and physics.radiation, physics.heat and physics.evaporation
    balanced = tension and physics.surface_tension and numerics.tension == "balanced"
    still = still or physics.heat  # what is warm may freeze
    viscous = physics.flow and viscous
    packing = physics.flow and numerics.packing_correction > 0
    return Needs(
        flow=physics.flow,
        still=still,
        viscosity=viscous,
        heat=physics.heat,
        conductivity=physics.heat and (materials > 1 or numerics.conduction != "kirchhoff"),
        surface=tension or radiation or evaporation or packing or shifting_strength(config) > 0,
        tension=tension,
        balanced=balanced,
        body_force=tension and not balanced,
        shifting=physics.flow and shifting_strength(config) > 0,
        shown_velocity=viscous and still and numerics.walls != "no_slip_centres",
        laser=physics.heat and config.laser is not None,
        radiation=radiation,
        evaporation=evaporation,
        viscous_heating=viscous and physics.heat and physics.viscous_heating,
        printed_leapfrog=physics.flow and numerics.integrator == "leapfrog_printed",
    )


def shifting_strength(config: Config) -> float:
    """The strength of the particle shifting, by default that of a scene with or without surface tension."""
    given = config.numerics.shifting
    if given is None:
        return UNDER_TENSION if config.physics.flow and config.physics.surface_tension else 0.0
    return given
