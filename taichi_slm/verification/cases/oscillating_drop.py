"""A drop swings in its second mode: surface tension against inertia, and what viscosity takes.

Scene    a round steel drop (R 50 um, sigma 1.8 N/m, rho 7000, mu 6 mPa s) that starts with the velocity of the mode,
         u = A (x, -y) or A (x, -y/2, -z/2), which stretches it by 5 %
Exact    omega^2 = 6 sigma/(rho R^3) (2-D), 8 sigma/(rho R^3) (3-D) (Rayleigh 1879); damping 4 nu/R^2, 5 nu/R^2 (Lamb 1932)
Measured a decaying cosine fitted to the second moment x^2 - (others)/(d - 1) over three periods, the first half swing left out
"""

import math

import numpy as np
from scipy.optimize import curve_fit

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.cases.static_drop import MU, RADIUS, RHO, SIGMA
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

STRETCH, PERIODS = 0.05, 3.0


def swing(dimension: int, resolution: int, arrangement: str, **numerics: object) -> dict[str, np.ndarray]:
    """Time [exact periods] and second moment [R^2] of a swinging drop; its fitted period and damping over the exact ones."""
    d = dimension
    omega = math.sqrt((6 if d == 2 else 8) * SIGMA / (RHO * RADIUS**3))
    damping = (4 if d == 2 else 5) * MU / RHO / RADIUS**2
    period = 2 * math.pi / omega
    config = configure(
        dimension=d, spacing=RADIUS / resolution, time={"end": PERIODS * period},
        materials={"steel": liquid(density=RHO, viscosity=MU, surface_tension=SIGMA)},
        bodies=[{"shape": "droplet", "centre": [0.0] * d, "radius": RADIUS, "material": "steel",
                 "arrangement": arrangement}],
        physics={**FLOW_ONLY, "surface_tension": True}, numerics={"sound_speed": 50, **numerics},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    mode = np.full(d, -1.0 / (d - 1))
    mode[0] = 1.0
    sim.state.load(velocity=STRETCH * omega * sim.position * mode)
    t, moment = np.linspace(0, PERIODS, int(60 * PERIODS) + 1), [0.0]
    for until in t[1:]:
        sim.advance(until * period)
        moment.append(float(np.mean((sim.position - sim.position.mean(axis=0)) ** 2 @ mode)) / RADIUS**2)
    q, late = np.array(moment), t > 0.25

    def decaying(
        t: np.ndarray, a: float, phase: float, ratio: float, gamma: float, mean: float
    ) -> np.ndarray:
        return a * np.exp(-gamma * t) * np.sin(2 * np.pi * t / ratio + phase) + mean

    guess = (q.max(), 0.0, 1.0, damping * period, 0.0)
    fitted, _ = curve_fit(decaying, t[late], q[late], p0=guess)
    return {"time": t, "moment": q, "period": fitted[2], "damping": fitted[3] / (damping * period),
            "exact": decaying(t, *guess)}  # fmt: skip
