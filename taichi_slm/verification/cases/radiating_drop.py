"""A ball of liquid cools by radiation alone.

Scene    R 25 um, rho 7200, c 800, eps 0.4, ambient 293 K, from 2500 K; at rest, R/dx 5 to 16
Exact    dT/dt = -3 eps sigma_SB (T^4 - T_a^4)/(rho c R): 1800 K after 75.8428 ms
Measured time at which the mass's mean temperature passes 1800 K; the ball's area, Sum V A over 4 pi R^2
Remarks  the closed form is for a uniform ball: k = 4 W/(m K) keeps the surface within 1 K of the mean, which is
         0.1 to 0.2 % of the power. `surface_area: plain` (A = |grad c|) is shown beside.
"""

import math
from dataclasses import dataclass

import numpy as np

from taichi_slm.physics.radiation import STEFAN_BOLTZMANN
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import configure, liquid

RADIUS, RHO, HEAT_CAPACITY, EMISSIVITY = 25e-6, 7200.0, 800.0, 0.4
START, END, AMBIENT = 2500.0, 1800.0, 293.0
AREA = 4.0 * math.pi * RADIUS**2
WHY = "the area of a faceted ball: what (34) radiates from, to second order in h_s/R"


@dataclass(frozen=True)
class Cooling:
    """What a run came to."""

    time: np.ndarray  # [s]
    mean: np.ndarray  # temperature [K]
    passed: float  # time at which it passed 1800 K [s]
    area: float  # over the exact one
    radiated: float  # heat, over what the ball lost


def cooling_time(temperature: np.ndarray) -> np.ndarray:
    """Time [s] at which the ball has come down to ``temperature`` [K]."""

    def primitive(T: np.ndarray) -> np.ndarray:  # integral of dT/(T^4 - T_a^4)
        return (0.5 * np.log((T - AMBIENT) / (T + AMBIENT)) - np.arctan(T / AMBIENT)) / (2 * AMBIENT**3)

    rate = 3 * EMISSIVITY * STEFAN_BOLTZMANN / (RHO * HEAT_CAPACITY * RADIUS)
    return np.asarray((primitive(np.asarray(START)) - primitive(np.asarray(temperature))) / rate)


def cool(resolution: int, surface_area: str = "corrected") -> Cooling:
    """Let a ball of ``resolution`` spacings a radius come down to 1800 K."""
    exact = float(cooling_time(np.asarray(END)))
    metal = liquid(density=RHO, heat_capacity=HEAT_CAPACITY, conductivity=4, emissivity=EMISSIVITY)
    config = configure(
        dimension=3, spacing=RADIUS / resolution, ambient_temperature=AMBIENT, time={"end": 1.6 * exact},
        materials={"metal": metal}, physics={"flow": False},
        numerics={"heat_stages": 31, "surface_area": surface_area},
        bodies=[{"shape": "droplet", "centre": [0, 0, 0], "radius": RADIUS, "material": "metal",
                 "temperature": START}],
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    mass, volume = sim.state.array("mass"), sim.state.array("volume")
    times, means = [0.0], [START]
    while means[-1] > END:
        sim.advance(sim.time + exact / 40)
        times.append(sim.time)
        means.append(float(np.average(sim.temperature, weights=mass)))
    area = float(np.sum(volume * sim.state.array("surface_area"))) / AREA
    passed = float(np.interp(-END, -np.array(means), times))
    row = sim.diagnostics()
    radiated = float(row["radiated_J"]) / (float(mass.sum()) * HEAT_CAPACITY * (START - means[-1]))
    return Cooling(np.array(times), np.array(means), passed, area, radiated)


def compute(outcome: Outcome) -> None:
    """R/dx 5, 8, 12, 16, with its trend; the plain area at 8."""
    exact = float(cooling_time(np.asarray(END)))
    resolutions = (5, 8, 12, 16)
    curves: list[Curve] = []
    errors: list[float] = []
    for resolution in resolutions:
        found = cool(resolution)
        outcome.judge(f"cooling time, R/dx {resolution}", found.passed, exact, limit=0.02, why=WHY, unit="s")
        outcome.show(f"area, R/dx {resolution}", found.area, 1.0)
        errors.append(abs(found.passed / exact - 1.0))
        curves.append(Curve(f"R/dx {resolution}", found.time, found.mean, "points"))
    outcome.order("order of the cooling time", [1 / r for r in resolutions], errors,
                  at_least=1.0, why="facets of a ball on a lattice come and go")  # fmt: skip
    plain = cool(8, "plain")
    outcome.show("cooling time, area plain, R/dx 8", plain.passed, exact, unit="s", note="|grad c| alone")
    outcome.show("area, plain, R/dx 8", plain.area, 1.0, note="the parallel surface at depth s is smaller")
    T = np.linspace(END, START, 100)
    curves += [
        Curve("exact", cooling_time(T), T),
        Curve("area plain, R/dx 8", plain.time, plain.mean, "dashed"),
    ]
    outcome.plot("radiating_drop", "Radiating ball", "time [s]", "mean temperature [K]", curves)


def compute_coarse(outcome: Outcome) -> None:
    """R/dx 8, and that what is radiated is what the ball lost."""
    closed = float(cooling_time(np.asarray(END)))
    outcome.judge(
        "closed form: METHOD's number", closed, 75.8428e-3, limit=1e-6, unit="s", why="printed digits"
    )
    found = cool(8)
    outcome.judge("cooling time, R/dx 8", found.passed, closed, limit=0.02, why=WHY, unit="s")
    outcome.judge("radiated over lost heat", found.radiated, 1.0, limit=1e-9, why="an account, to round-off")


CASES = [
    Case("radiating_drop", "Radiating ball: cooling time and its trend", "exact", "full", compute),
    Case("radiating_drop_coarse", "Radiating ball: cooling time at R/dx 8", "exact", "quick", compute_coarse),
]
