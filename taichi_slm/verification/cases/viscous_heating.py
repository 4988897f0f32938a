"""What viscosity takes from the motion becomes heat, at the rate 2 mu D:D.

Scene    (a) a free square of liquid with a linear velocity, a strain of rate s whose axis of extension is turned by 0,
         22.5 and 45 degrees from the lattice; (b) the Taylor-Green vortex of that case at its start; (c) that vortex
         without pressure (c0 = 1e-9 U), step by step
Exact    (a) dT/dt = 2 mu D:D/(rho c) = mu s^2/(rho c), whatever the direction; (b) 4 mu (k U cos kx cos ky)^2/(rho c);
         (c) heat gained = kinetic energy lost but for the order of the step: of what a step takes from the motion,
         -m u.a dt - m a^2 dt^2/2, the first part is heat
Measured rise of temperature over one step, of the particles with a full support; in (c) the kinetic energy and the
         accelerations of every step

The printed sum (12) is anisotropic on a lattice, 0.750 along its axes, 1.157 across them (taylor_green).
"""

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.cases import taylor_green as vortex
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

HEATED: dict[str, bool] = {**FLOW_ONLY, "heat": True, "viscous_heating": True}
MU, RHO, HEAT_CAPACITY, RATE = 1e3, 1000.0, 1000.0, 100.0  # [Pa s], [kg/m^3], [J/(kg K)], [1/s]

SHORT = 1e-6  # [s]: nothing has moved, and the rise is still ten thousand times the last digit of T


def strained(degrees: float) -> float:
    """dT/dt over 2 mu D:D/(rho c) in a free square under a pure strain, mean over the inner particles."""
    n, dx = 24, 0.05
    config = configure(
        spacing=dx, materials={"oil": liquid(viscosity=MU, density=RHO, heat_capacity=HEAT_CAPACITY, conductivity=0)},
        bodies=[{"shape": "box", "material": "oil", "corner": [-0.5 * n * dx] * 2, "size": [n * dx] * 2}],
        physics=HEATED, numerics={"sound_speed": 20, "maximum_step": SHORT}, performance={"heat_clock": False},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    angle = 2.0 * np.radians(degrees)
    D = (
        0.5
        * RATE
        * np.sqrt(2.0)
        * np.array([[np.cos(angle), np.sin(angle)], [np.sin(angle), -np.cos(angle)]])
    )
    sim.state.load(velocity=sim.position @ D)
    inner = np.abs(sim.position).max(axis=1) < (0.5 * n - 3) * dx
    before = sim.temperature
    sim.step()
    rise = (sim.temperature - before)[inner].mean() / sim.time
    return float(rise / (2.0 * MU * np.sum(D * D) / (RHO * HEAT_CAPACITY)))


def heated(resolution: int) -> tuple[float, float]:
    """Of the vortex's first rates, relative: the error of their mean, and the root mean square of their errors."""
    sim = vortex.box(resolution, HEATED, {"maximum_step": SHORT}, performance={"heat_clock": False})
    x, y = vortex.K * sim.position.T
    reach = 3 * vortex.SIDE / resolution
    inner = np.all((sim.position > reach) & (sim.position < vortex.SIDE - reach), axis=1)
    before = sim.temperature
    sim.step()
    rate = ((sim.temperature - before) / sim.time)[inner]
    power = 4.0 * vortex.RHO * vortex.NU * (vortex.K * vortex.SPEED * np.cos(x) * np.cos(y)) ** 2
    density = vortex.RHO * (1.0 + vortex.DENSER)
    exact = (power / (density * HEAT_CAPACITY))[inner]
    return float(rate.mean() / exact.mean() - 1.0), float(
        np.linalg.norm(rate - exact) / np.linalg.norm(exact)
    )


def accounts(factor: float) -> dict[str, float]:
    """The vortex without pressure, a tenth of its decay, steps of ``factor`` h^2/nu: energy lost and gained [J/m]."""
    sim = vortex.box(
        16, HEATED, {"sound_speed": 1e-9, "viscous_factor": factor}, performance={"heat_clock": False}
    )
    mass = sim.state.array("mass")[~sim.scene.wall]
    start, extra = vortex.kinetic_energy(sim), 0.0
    while sim.time < 0.1 * vortex.DECAY:
        sim.step()
        squares = np.sum(sim.state.array("acceleration")[~sim.scene.wall] ** 2, axis=1)
        extra += 0.5 * sim.dt**2 * float(np.sum(mass * squares))
    row = sim.diagnostics()
    return {"lost": start - vortex.kinetic_energy(sim), "heat": float(row["viscous_J"]), "extra": extra,
            "stored": float(row["stored_J"]), "steps": sim.steps}  # fmt: skip


def compute_accounts(outcome: Outcome) -> None:
    """(c) in three steps."""
    factors = [0.08, 0.04, 0.02]
    rows = [accounts(factor) for factor in factors]
    for row in rows:
        closed = abs(row["lost"] - row["heat"] + row["extra"]) / row["lost"]
        label = f"{row['steps']} steps"
        outcome.judge(f"energy lost = heat - sum m a^2 dt^2/2, {label}", closed, error=closed, limit=1e-13,
                      why="round-off: differences of energies, 1e-16 of them a step")  # fmt: skip
        outcome.judge(f"heat gained = heat booked, {label}", row["stored"], row["heat"], limit=1e-7,
                      why="enthalpies of 3e5 J/kg hold a rise of 0.2 J/kg to 1e-10, once a step")  # fmt: skip
    missing = [row["heat"] / row["lost"] - 1.0 for row in rows]
    for row, value in zip(rows, missing, strict=True):
        outcome.show(f"heat gained over energy lost, {row['steps']} steps", 1.0 + value, 1.0)
    steps = [row["steps"] for row in rows]
    outcome.plot("viscous_account", "Viscous heat of a vortex", "steps", "heat/energy lost - 1",
                 [Curve("", steps, missing, "points")], "xy")  # fmt: skip
    outcome.order("order in the step of heat - energy lost", factors, missing, at_least=0.9,
                  why="the heat is the power at the start of the step: first order")  # fmt: skip


def compute(outcome: Outcome) -> None:
    """(a), (b) at L/dx 12, 24 and 48."""
    for degrees in (0.0, 22.5, 45.0):
        outcome.judge(f"rate of a strain at {degrees:g} degrees to the lattice", strained(degrees), 1.0, limit=0.02,
                      why="one viscosity in every direction")  # fmt: skip
    along = (12, 24, 48)
    found = {n: heated(n) for n in along}
    for n in along[:-1]:
        outcome.show(f"rate in a vortex, L/dx {n}", 1.0 + found[n][0], 1.0)
    outcome.judge(f"rate in a vortex, L/dx {along[-1]}", 1.0 + found[along[-1]][0], 1.0, limit=0.02,
                  why="second order in dx, and one viscosity in every direction")  # fmt: skip
    outcome.order("order in the spacing", [1.0 / n for n in along], [found[n][1] for n in along],
                  why="shown: at the finest the error is that of the time step")  # fmt: skip
    outcome.plot("viscous_heating", "Viscous heat in a vortex", "L/dx", "relative error of the first rate",
                 [Curve("mean", list(along), [abs(found[n][0]) for n in along]),
                  Curve("root mean square", list(along), [found[n][1] for n in along])], "xy")  # fmt: skip


CASES = [
    Case("viscous_heating", "Viscous heating: rate of temperature", "exact", "full", compute),
    Case("viscous_account", "Viscous heating: account of energy", "exact", "quick", compute_accounts),
]
