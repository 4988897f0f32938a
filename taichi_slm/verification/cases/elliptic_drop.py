"""A drop that a pure strain stretches without end: Monaghan's elliptic drop.

Scene    a disc of inviscid liquid of radius R, no gravity, no tension, u = (-A x, A y) at the start, c0 = 15 A R
Exact    it stays an ellipse, u = (-A(t) x, A(t) y), with da/dt = -A a, a b = R^2, dA/dt = A^2 (a^2 - b^2)/(a^2 + b^2);
         its kinetic energy is constant
Measured the semi-axes 2 sqrt(mean x^2), which is exact for an ellipse, at A0 t = 1, where a = 0.44 R and b = 2.28 R;
         kinetic plus elastic energy, c0^2 (rho - rho0)^2/(2 rho^2) per mass, against that of the start

The pressure of the exact drop at the start, rho A^2 (R^2 - r^2)/2, is loaded with the velocity: without it the drop
rings. Particles start on rings: those of a lattice that is squeezed along its rows stay in rows, with gaps between
(shown). Particles that are squeezed one way and drawn out the other take that for a divergence, and the drop swells;
particle shifting (strength 20 here; without surface tension the default is none, shown) keeps them in order.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from taichi_slm.errors import BlowUpError
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

RADIUS, STRAIN, RHO, SOUND = 1.0, 1.0, 1000.0, 15.0
TIMES = np.linspace(0.0, 1.0, 41) / STRAIN


@lru_cache(maxsize=1)
def semi_axes() -> np.ndarray:
    """Exact a and b [m] at TIMES, shape [2, n]."""

    def rates(_: float, y: np.ndarray) -> list[float]:
        a, b, A = y
        return [-A * a, A * b, A**2 * (a**2 - b**2) / (a**2 + b**2)]

    way = solve_ivp(rates, (0.0, TIMES[-1]), [RADIUS, RADIUS, STRAIN], t_eval=TIMES, rtol=1e-10, atol=1e-12)
    return np.asarray(way.y[:2])


def start(resolution: int, arrangement: str = "rings", **numerics: object) -> Simulation:
    """The drop at time zero, its velocity and pressure loaded; ``resolution`` is R/dx."""
    config = configure(
        spacing=RADIUS / resolution, materials={"liquid": liquid(density=RHO, viscosity=0.0)},
        bodies=[{"shape": "droplet", "centre": [0, 0], "radius": RADIUS, "material": "liquid",
                 "arrangement": arrangement}],
        physics=FLOW_ONLY, numerics={"sound_speed": SOUND, "shifting": 20.0, **numerics}, time={"end": TIMES[-1]},
        domain={"lower": [-2.5, -2.5], "upper": [2.5, 2.5]},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    x = sim.position
    mass = sim.state.array("mass")
    pressure = 0.5 * RHO * STRAIN**2 * (RADIUS**2 - np.sum(x**2, axis=1))
    density = RHO + pressure / SOUND**2
    sim.state.load(velocity=STRAIN * x * [-1.0, 1.0], density=density, volume=mass / density)
    return sim


def measured_axes(position: np.ndarray) -> np.ndarray:
    """Semi-axes a and b [m] of particles that fill an ellipse evenly; ``position`` [m], shape [n, 2]."""
    return np.asarray(2.0 * np.sqrt(np.mean(position**2, axis=0)))


def stretch(resolution: int, arrangement: str = "rings", **numerics: object) -> dict[str, np.ndarray]:
    """Semi-axes [m] and energies over the kinetic energy of the start, at TIMES; NaN after a blow-up."""
    sim = start(resolution, arrangement, **numerics)
    mass = sim.state.array("mass")
    rows: list[list[float]] = []
    for t in TIMES:
        try:
            if t > 0:
                sim.advance(t)
        except BlowUpError:
            rows += [[np.nan] * 4] * (len(TIMES) - len(rows))
            break
        density = sim.state.array("density")
        kinetic = 0.5 * np.sum(mass * np.sum(sim.velocity**2, axis=1))
        elastic = 0.5 * SOUND**2 * np.sum(mass * ((density - RHO) / density) ** 2)
        rows.append([*measured_axes(sim.position), kinetic, elastic])
    a, b, kinetic, elastic = np.array(rows).T
    return {"a": a, "b": b, "kinetic": kinetic / kinetic[0], "total": (kinetic + elastic) / kinetic[0]}


PRINTED = {
    "integrator": "leapfrog_printed",
    "pressure_form": "gamma",
    "delta": 1e-4,
    "packing_correction": 0.0,
    "shifting": 0.0,
    "gradient_correction": False,
}
SHOWN: dict[str, dict[str, Any]] = {
    "no shifting": {"shifting": 0.0},
    "lattice": {"arrangement": "lattice"},
    "delta 0": {"delta": 0.0},
    "delta 0, no packing correction": {"delta": 0.0, "packing_correction": 0.0},
    "kick-drift": {"integrator": "kick_drift"},
    "h/dx 1.5": {"smoothing": 1.5},
    "printed forms and integrator": PRINTED,
}


def errors(found: dict[str, np.ndarray]) -> tuple[float, float, float]:
    """Of a, b and the energy in the end, relative."""
    a, b = semi_axes()[:, -1]
    return found["a"][-1] / a - 1.0, found["b"][-1] / b - 1.0, found["total"][-1] / found["total"][0] - 1.0


def compute(outcome: Outcome) -> None:
    """R/dx 10, 20 and 40; other forms at 20."""
    resolutions = (10, 20, 40)
    runs = {n: stretch(n) for n in resolutions}
    for n in resolutions:
        for name, value in zip(("semi-axis a", "semi-axis b", "energy"), errors(runs[n]), strict=True):
            if n == resolutions[-1]:
                limit = 0.02 if name == "energy" else 0.01
                outcome.judge(f"{name}, R/dx {n}", 1.0 + value, 1.0, limit=limit, why=WHY[name])
            else:
                outcome.show(f"{name}, R/dx {n}", 1.0 + value, 1.0)
    outcome.order("order of the semi-axis a", [1.0 / n for n in resolutions],
                  [abs(errors(runs[n])[0]) for n in resolutions], at_least=1.0,
                  why="a surface that is made of particles is known to a part of dx")  # fmt: skip
    for label, forms in SHOWN.items():
        shown = errors(stretch(20, **forms))
        for name, value in zip(("semi-axis a", "semi-axis b", "energy"), shown, strict=True):
            outcome.show(
                f"{name}, R/dx 20, {label}", 1.0 + value, 1.0, note="blew up" if np.isnan(value) else ""
            )
    _plot(outcome, runs)


WHY = {
    "semi-axis a": "the volume is kept to 1 %",
    "semi-axis b": "the flow is the exact one to 1 %",
    "energy": "the diffusion of density takes energy, the steps of the integrator none in the mean",
}


def _plot(outcome: Outcome, runs: dict[int, dict[str, np.ndarray]]) -> None:
    t = STRAIN * TIMES
    axes = [Curve("exact", t, semi_axes()[0], "dashed"), Curve("", t, semi_axes()[1], "dashed")]
    for n, found in runs.items():
        axes += [Curve(f"R/dx {n}", t, found["a"]), Curve("", t, found["b"])]
    outcome.plot("elliptic_drop_axes", "Elliptic drop", "A0 t", "semi-axes/R", axes)
    energy = [Curve(f"R/dx {n}", t, found["total"] / found["total"][0]) for n, found in runs.items()]
    outcome.plot("elliptic_drop_energy", "Elliptic drop", "A0 t", "energy over its start", energy)


CASES = [Case("elliptic_drop", "Elliptic drop: shape and energy without viscosity", "exact", "full", compute)]
