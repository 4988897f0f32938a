"""The paper's settings (Russell, Souto-Iglesias, Zohdi 2018) as changes of a config; configs/paper.yaml explains."""

from typing import Any

PAPER_RUN = "all off, paper's steps"  # among the skips
NO_SKIPS: dict[str, Any] = {
    "skip_solid": False, "skip_cold": False, "skip_interior": False, "skip_dark": False, "heat_clock": False,
    "keep_neighbours": False, "stop_finished": False,
}  # fmt: skip
PAPER_STEPS: dict[str, Any] = {
    "courant": 0.05, "viscous_factor": 0.125, "heat_factor": 0.125, "surface_every": 1, "latent_heat": "apparent",
    "heat_scheme": "trapezoid",
}  # fmt: skip
PAPER_FORMS: dict[str, Any] = {
    "smoothing": 1.2, "surface_smoothing": 1.8, "integrator": "leapfrog_printed", "courant": 0.05,
    "viscous_factor": 0.125, "capillary_factor": 0.25, "heat_factor": 0.125, "delta": 1e-4, "delta_form": "printed",
    "pressure_form": "gamma", "gradient_correction": False, "packing_correction": 0, "shifting": 0,
    "viscosity_form": "printed", "viscosity_correction": False, "artificial_viscosity": 0,
    "walls": "no_slip_centres", "tension": "body_force", "colour_gradient": "gamma", "normal_cut": 0,
    "curvature": "printed", "curvature_clip": "printed", "depth_correction": False, "temperature_gradient": "gamma",
    "surface_times_liquid": False, "surface_every": 1, "latent_heat": "apparent", "heat_scheme": "trapezoid",
    "conduction": "harmonic", "conduction_correction": False, "conduction_moment": "lattice",
    "radiation_law": "printed", "surface_area": "plain", "solid_density": "true",
}  # fmt: skip
