"""Which terms exist, how each is discretised, what a step may skip: their keys, units and defaults."""

from typing import Annotated, Literal

from pydantic import Field

from taichi_slm.config.material import Frozen
from taichi_slm.config.units import NO_SWITCH, NonNegativeNumber, PositiveNumber, PositiveSpeed, PositiveTime


class Physics(Frozen):
    """Which terms exist. A term that is off is not compiled, allocated or launched."""

    flow: bool = True
    heat: bool = True
    surface_tension: bool = True
    marangoni: bool = True
    radiation: bool = True
    viscous_heating: bool = True
    evaporation: bool = Field(
        False, description="heat loss by evaporation; needs evaporation data of the materials"
    )
    recoil: bool = Field(False, description="recoil pressure of evaporation on the surface")


class Numerics(Frozen):
    """How each term is discretised. Defaults are the better forms; configs/paper.yaml selects the paper's."""

    smoothing: PositiveNumber = Field(1.2, description="h/dx of flow and heat", le=3)
    surface_smoothing: PositiveNumber = Field(1.8, description="h_s/dx of surface terms", le=3)
    sound_speed: PositiveSpeed = Field(20.0, description="c0 of the equation of state (9) [m/s]")
    integrator: Literal["verlet", "kick_drift", "leapfrog_printed"] = "verlet"
    courant: PositiveNumber = Field(0.4, description="dt <= courant h/c0 (41)")
    viscous_factor: PositiveNumber = Field(
        0.08, description="dt <= factor h^2/nu (42); 0.125 is printed, the edge is 0.135"
    )
    capillary_factor: PositiveNumber = Field(
        0.25, description="dt <= factor sqrt(rho h_s^3/(2 pi sigma)) (43)"
    )
    heat_factor: PositiveNumber = Field(
        0.2, description="dt_heat <= factor rho c h^2/k (44); 0.125 is printed"
    )
    temperature_step: PositiveNumber = Field(
        400.0,
        description="largest rise by the laser in one heat step [K]; bounds the heat step while the beam is on",
    )
    maximum_step: PositiveTime | None = None
    step_growth: Annotated[PositiveNumber, Field(ge=1)] = Field(
        1.1, description="largest ratio of successive steps"
    )
    delta: NonNegativeNumber = Field(0.1, description="delta-SPH density diffusion (13)")
    delta_form: Literal["standard", "printed"] = Field(
        "standard", description="printed: times rho_a once more"
    )
    pressure_form: Literal["sum", "gamma"] = Field(
        "sum", description="gamma: p_b/Gamma_a + p_a/Gamma_b as printed in (11)"
    )
    gradient_correction: bool = Field(
        True, description="divide the pressure gradient and the divergence by their lattice moment"
    )
    packing_correction: NonNegativeNumber = Field(
        0.05, description="rate of the packing correction, in c0/h; 0: none"
    )
    viscosity_form: Literal["isotropic", "printed"] = Field(
        "isotropic",
        description="isotropic: weighted so that all directions of a lattice are alike; printed: (12)",
    )
    viscosity_correction: bool = Field(
        True, description="divide the printed form of (12) by its lattice moment"
    )
    artificial_viscosity: NonNegativeNumber = Field(
        0.0, description="alpha: adds rho alpha h c0/(2(d+2)) to mu"
    )
    walls: Literal["no_slip", "no_slip_centres", "free_slip"] = Field(
        "no_slip", description="no_slip: at the face of a wall; no_slip_centres: where its particles are"
    )
    tension: Literal["balanced", "body_force"] = Field(
        "balanced",
        description="balanced: the capillary pressure enters through the operator of the pressure gradient; "
        "body_force: (25) as printed",
    )
    shifting: NonNegativeNumber | None = Field(
        None,
        description="strength of particle shifting, per h^2 of shear; default 200 under surface tension, else 0",
    )
    colour_gradient: Literal["plain", "gamma"] = Field("plain", description="gamma: (20) as printed")
    normal_cut: NonNegativeNumber = Field(
        0.2, description="normals exist where h_s |grad c| exceeds this (21)"
    )
    curvature: Literal["restricted", "printed"] = Field(
        "restricted", description="printed: (23) sums over all neighbours"
    )
    curvature_clip: Literal["two_sided", "printed"] = Field(
        "two_sided", description="(24); printed: min() alone"
    )
    depth_correction: bool = Field(
        True, description="curvature of the surface, not of the parallel surface at depth s"
    )
    temperature_gradient: Literal["renormalised", "gamma"] = Field(
        "renormalised", description="gamma: (26), sign mended"
    )
    surface_times_liquid: bool = Field(True, description="surface forces times the liquid fraction")
    surface_every: Annotated[int, Field(ge=1, le=4), NO_SWITCH] = Field(
        2, description="steps between surface forces"
    )
    latent_heat: Literal["enthalpy", "apparent"] = Field(
        "enthalpy", description="apparent: heat capacity method (39)"
    )
    heat_scheme: Literal["rkl2", "heun", "euler", "trapezoid"] = Field(
        "rkl2", description="rkl2: Runge-Kutta-Legendre, explicit; trapezoid: fixed point of Algorithm 1"
    )
    heat_stages: Annotated[int, Field(ge=3, le=31), NO_SWITCH] = Field(
        5, description="of rkl2, at most; its stable step grows as their square"
    )
    fixed_point_tolerance: PositiveNumber = Field(1e-8, description="of the trapezoid, relative")
    fixed_point_sweeps: Annotated[int, Field(ge=1), NO_SWITCH] = Field(
        10, description="largest number of sweeps of the trapezoid"
    )
    conduction: Literal["kirchhoff", "harmonic"] = Field("kirchhoff", description="harmonic: (38)")
    conduction_correction: bool = Field(True, description="divide (38) by its moment")
    conduction_moment: Literal["own", "lattice"] = Field(
        "own", description="the moment of the particle's own neighbours, or that of a full lattice"
    )
    radiation_law: Literal["stefan_boltzmann", "printed"] = Field(
        "stefan_boltzmann", description="printed: (T - T_inf)^4"
    )
    surface_area: Literal["corrected", "plain"] = Field(
        "corrected",
        description="of radiation and evaporation; plain: |grad c|, short by 19 % on a ball of R/dx 5",
    )
    solid_density: Literal["solidus", "true"] = Field(
        "solidus", description="mechanical density of the solid"
    )
    minimum_neighbours: Annotated[int, Field(ge=0), NO_SWITCH] | None = Field(
        None,
        description="a mobile particle with fewer neighbours within 2h is ejected: removed and counted; "
        "default 3 (2-D), 6 (3-D); 0: never",
    )


class Performance(Frozen):
    """What a step may skip. All off is the reference every skip is tested against."""

    skip_solid: bool = Field(
        True, description="flow passes only over particles that can move and the walls beside them"
    )
    skip_cold: bool = Field(
        True, description="heat only where the temperature differs from the initial one, or the beam is"
    )
    skip_interior: bool = Field(True, description="surface passes only near the surface")
    skip_dark: bool = Field(True, description="laser bins only under the beam, and only while it is on")
    heat_clock: bool = Field(True, description="heat on its own, longer step")
    heat_steps_at_most: Annotated[int, Field(ge=1, le=100), NO_SWITCH] = Field(
        10,
        description="flow steps per heat step, at most; at 18 the lagging Marangoni force widens a weld by 12 %",
    )
    heat_motion: NonNegativeNumber = Field(
        0.1,
        description="a heat step may be longer than heat_steps_at_most as long as nobody moves farther [dx] in it",
    )
    keep_neighbours: bool = Field(True, description="Verlet lists kept until somebody is half a skin off")
    skin: PositiveNumber = Field(0.4, description="skin of the neighbour lists [dx]", le=2)
    serial_below: Annotated[int, Field(ge=0), NO_SWITCH] = Field(
        600,
        description="loops over the neighbours of fewer particles (in 3-D: of a quarter as many) run on one thread, "
        "plain ones of ten times as many",
    )
    stop_finished: bool = Field(True, description="end when the beam has passed and everything is solid")
