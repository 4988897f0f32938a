"""A drop at rest keeps the Laplace jump and hardly moves.

Scene    a steel drop (R 50 um, sigma 1.8 N/m, rho 7000, mu 6 mPa s) without gravity, on a lattice and on rings
Exact    p = sigma/R (2-D), 2 sigma/R (3-D) above the surroundings; no motion
Measured mean pressure of the inner part (r < R/2) over the second half of the run; the capillary number is mu u/sigma
         of the fastest particle then. The run lasts three periods of the n = 2 mode.
"""

import math

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

RADIUS, SIGMA, RHO, MU = 50e-6, 1.8, 7000.0, 0.006


def history(dimension: int, resolution: int, arrangement: str, periods: float = 3.0,
            **numerics: object) -> dict[str, np.ndarray]:  # fmt: skip
    """Time [periods], pressure over the exact one, capillary number of the fastest particle."""
    omega = math.sqrt((6 if dimension == 2 else 8) * SIGMA / (RHO * RADIUS**3))
    period = 2 * math.pi / omega
    config = configure(
        dimension=dimension, spacing=RADIUS / resolution, time={"end": periods * period},
        materials={"steel": liquid(density=RHO, viscosity=MU, surface_tension=SIGMA)},
        bodies=[{"shape": "droplet", "centre": [0.0] * dimension, "radius": RADIUS, "material": "steel",
                 "arrangement": arrangement}],
        physics={**FLOW_ONLY, "surface_tension": True}, numerics={"sound_speed": 50, **numerics},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    exact = (dimension - 1) * SIGMA / RADIUS
    times = np.linspace(0, 1, 151)[1:] * periods
    inside = np.linalg.norm(sim.position, axis=1) < 0.5 * RADIUS
    pressure, capillary = [], []
    for t in times:
        sim.advance(t * period)
        pressure.append(sim.state.array("pressure")[inside].mean() / exact)
        capillary.append(MU * np.linalg.norm(sim.velocity, axis=1).max() / SIGMA)
    return {"time": times, "pressure": np.array(pressure), "capillary": np.array(capillary)}


def compute(outcome: Outcome) -> None:
    """2-D at R/dx 10, 20, 40 (lattice) and 20 (rings); 3-D at R/dx 12."""
    scenes = [
        ("2-D, lattice, R/dx 10", 2, 10, "lattice", None),
        ("2-D, lattice, R/dx 20", 2, 20, "lattice", 0.03),
        ("2-D, rings, R/dx 20", 2, 20, "rings", 0.03),
        ("2-D, lattice, R/dx 40", 2, 40, "lattice", None),
        ("3-D, R/dx 12", 3, 12, "lattice", 0.05),
    ]
    pressures, speeds = [], []
    for label, dimension, resolution, arrangement, limit in scenes:
        found = history(dimension, resolution, arrangement, periods=3.0 if resolution < 40 else 1.0)
        late = found["time"] > 0.5 * found["time"][-1]
        jump, fastest = found["pressure"][late].mean(), found["capillary"][late].max()
        if limit is None:
            outcome.show(f"Laplace jump, {label}", jump, 1.0, note="trend with the spacing")
            outcome.show(f"capillary number, {label}", fastest)
        else:
            outcome.judge(
                f"Laplace jump, {label}",
                jump,
                1.0,
                limit=limit,
                why="curvature from a few layers of particles",
            )
            outcome.judge(f"capillary number, {label}", fastest, error=fastest, limit=1e-3,
                          why="parasitic currents far below the flow of a melt pool, mu u/sigma 3e-3")  # fmt: skip
        pressures.append(Curve(label, found["time"], found["pressure"]))
        speeds.append(Curve(label, found["time"], found["capillary"]))
    outcome.plot("static_drop_pressure", "Static drop", "time / period", "p / exact", pressures)
    outcome.plot("static_drop_speed", "Static drop", "time / period", "capillary number", speeds, "y")


CASES = [Case("static_drop", "Static drop: Laplace jump and parasitic currents", "exact", "full", compute)]
