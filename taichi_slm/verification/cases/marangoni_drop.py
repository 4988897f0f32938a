"""The isolated drop in a temperature gradient: the force that drives the melt pool, and nothing else.

Scene    a viscous drop without surroundings, R = rho = mu = 1, sigma_T G = -0.2, sigma = 4 (2-D) or 2 (3-D), so that the
         Laplace pressure is 20 times the Marangoni stress; T = T0 + G x, frozen in space
Exact    Stokes flow. 2-D: u = B [1 - (x^2 + 3 y^2)/R^2, 2 x y/R^2], B = |sigma_T| G R/(4 mu), surface speed 2 B.
         3-D: u = B [1 - (x^2 + 2 s^2)/R^2, x s/R^2] along the axis and away from it, B = |sigma_T| G R/(3 mu), surface speed B
Measured the amplitude of the exact flow (projection, in the frame of the drop), the L2 norm of what is left, and the largest
         speed over the largest exact one, when the surface has slid by 2 dx (early) and by 10 dx (steady)
"""

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.scenes import FLOW_ONLY, configure, impose, liquid

STRESS, T0, G = 0.2, 2000.0, 100.0  # |sigma_T| G [N/m^2], [K], [K/m]


def exact(position: np.ndarray) -> np.ndarray:
    """Velocity [m/s] at ``position`` [m] relative to the drop's centre, shape [n, d]."""
    d = position.shape[1]
    x, rest = position[:, :1], position[:, 1:]
    s2 = np.sum(rest**2, axis=1, keepdims=True)
    if d == 2:
        return STRESS / 4 * np.hstack([1 - x**2 - 3 * s2, 2 * x * rest])
    return STRESS / 3 * np.hstack([1 - x**2 - 2 * s2, x * rest])


def history(dimension: int, resolution: int, arrangement: str, slide: float, sigma: float | None = None,
            **numerics: object) -> dict[str, np.ndarray]:  # fmt: skip
    """Against the slid distance [dx]: amplitude, L2 error, speed ratio, Laplace pressure over the exact one."""
    sigma = sigma or {2: 4.0, 3: 2.0}[dimension]
    speed = STRESS / (dimension if dimension == 3 else 2)
    law = {"line": {"value": sigma, "slope": -STRESS / G, "at": T0}}
    config = configure(
        dimension=dimension, spacing=1.0 / resolution, time={"end": slide / resolution / speed}, ambient_temperature=T0,
        materials={"oil": liquid(density=1.0, viscosity=1.0, surface_tension=law)},
        bodies=[{"shape": "droplet", "centre": [0.0] * dimension, "radius": 1.0, "material": "oil",
                 "arrangement": arrangement}],
        domain={"lower": [-20.0] * dimension, "upper": [20.0] * dimension},  # the drop may drift
        physics={**FLOW_ONLY, "surface_tension": True, "marangoni": True},
        numerics={"sound_speed": 20.0, **numerics},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    found: dict[str, list[float]] = {
        "slid": [],
        "drift": [],
        "amplitude": [],
        "error": [],
        "speed": [],
        "pressure": [],
    }
    record = np.arange(1, 2 * slide + 1) / 2
    while sim.time < config.time.end * (1 - 1e-9):
        x, present = sim.position, sim.state.array("mobility") >= 0
        impose(sim, np.where(present, T0 + G * x[:, 0], T0))
        for _ in range(4):
            sim.step()
        slid = sim.time * speed * resolution
        if slid >= record[0] - 1e-9:
            record = np.append(record[record > slid], np.inf)
            present = sim.state.array("mobility") >= 0
            x, u = sim.position[present], sim.velocity[present]
            found["drift"].append(np.linalg.norm(np.mean(u, axis=0)) / speed)
            x, u = x - np.mean(x, axis=0), u - np.mean(u, axis=0)
            v, inside = exact(x), np.linalg.norm(x, axis=1) < 0.5
            found["slid"].append(slid)
            found["amplitude"].append(np.sum(u * v) / np.sum(v * v))
            found["error"].append(np.sqrt(np.sum((u - v) ** 2) / np.sum(v * v)))
            found["speed"].append(np.linalg.norm(u, axis=1).max() / np.linalg.norm(v, axis=1).max())
            found["pressure"].append(
                sim.state.array("pressure")[present][inside].mean() / (sigma * (dimension - 1))
            )
    return {name: np.array(values) for name, values in found.items()}
