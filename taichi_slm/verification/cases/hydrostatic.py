"""A column at rest in a container: its pressure, its weight, its stillness.

Scene    a liquid of depth H and width H/2 in a container open at the top, g = 1 m/s^2, c0 = 10 sqrt(g H),
         nu = 0.02 sqrt(g H^3); it starts on the lattice with the density that its weight asks for
Exact    p = rho0 c0^2 (exp(g depth/c0^2) - 1), which is rho0 g (depth) but for 0.5 % at the floor; nothing moves; the
         walls carry M g; the centre of mass stays where it is
Measured slope of the pressure against the exact one between 0.1 H and 0.9 H, and the root mean square of the
         difference over rho0 g H, for the mean over the last quarter of the run; there also the force of the walls over
         M g and the kinetic energy over M g H. The full case lasts 100 sound times H/c0 and also measures how far the
         pressure and the centre of mass drift between its second and its last quarter
"""

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

DEPTH, GRAVITY, RHO, SOUND = 1.0, 1.0, 1000.0, 10.0
NU = 0.02 * np.sqrt(GRAVITY * DEPTH**3)
SOUND_TIME = DEPTH / SOUND
SCALE = RHO * GRAVITY * DEPTH  # [Pa]


def rest(resolution: int, sound_times: float, **numerics: object) -> dict[str, np.ndarray]:
    """Time [H/c0], kinetic energy over M g H, force of the walls over M g, heights [m] and pressures [Pa] of all."""
    dx = DEPTH / resolution
    config = configure(
        spacing=dx, gravity=GRAVITY, materials={"fluid": liquid(density=RHO, viscosity=RHO * NU)},
        bodies=[{"shape": "container", "material": "fluid", "corner": [0, 0], "size": [0.5 * DEPTH, 1.3 * DEPTH]},
                {"shape": "box", "material": "fluid", "corner": [0, 0], "size": [0.5 * DEPTH, DEPTH]}],
        physics=FLOW_ONLY, numerics={"sound_speed": SOUND, **numerics},
        time={"end": sound_times * SOUND_TIME},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    moves = ~sim.scene.wall
    mass = sim.state.array("mass")[moves]
    weight = mass.sum() * GRAVITY
    times = np.linspace(0.0, sound_times, 81)
    kinetic, impulse, heights, pressures = [], [], [], []
    for t in times[1:]:
        sim.advance(t * SOUND_TIME)
        kinetic.append(0.5 * np.sum(mass * np.sum(sim.velocity[moves] ** 2, axis=1)) / (weight * DEPTH))
        impulse.append(sim.ledger.impulses()["walls"][1] / weight)
        heights.append(sim.position[moves, 1])
        pressures.append(sim.state.array("pressure")[moves])
    carried = np.diff(impulse) / np.diff(times[1:] * SOUND_TIME)
    return {"time": times[1:], "kinetic": np.array(kinetic), "weight": carried,
            "height": np.array(heights), "pressure": np.array(pressures)}  # fmt: skip


def exact(height: np.ndarray) -> np.ndarray:
    """Pressure [Pa] at ``height`` [m]."""
    return np.asarray(RHO * SOUND**2 * np.expm1(GRAVITY * (DEPTH - height) / SOUND**2))


def quarter(found: dict[str, np.ndarray], number: int) -> dict[str, float]:
    """Means over one quarter of the run, 0 to 3."""
    part = slice(20 * number, 20 * (number + 1))
    y, p = found["height"][part].mean(axis=0), found["pressure"][part].mean(axis=0)
    inner = (y > 0.1 * DEPTH) & (y < 0.9 * DEPTH)
    slope = np.polyfit(y[inner], p[inner], 1)[0] / np.polyfit(y[inner], exact(y[inner]), 1)[0]
    return {
        "slope": float(slope), "difference": float(np.sqrt(np.mean((p - exact(y))[inner] ** 2)) / SCALE),
        "pressure": float(p.mean() / SCALE), "height": float(y.mean() / DEPTH),
        "kinetic": float(found["kinetic"][part].max()), "weight": float(found["weight"][part].mean()),
    }  # fmt: skip


def _judge(outcome: Outcome, late: dict[str, float], label: str) -> None:
    outcome.judge(f"slope of the pressure, {label}", late["slope"], 1.0, limit=0.01,
                  why="the gradient of a linear pressure is exact on a lattice")  # fmt: skip
    outcome.judge(f"difference of the pressure over rho g H, {label}", late["difference"], error=late["difference"],
                  limit=0.01, why="the same, and the floor's extrapolated pressure")  # fmt: skip
    outcome.judge(f"force of the walls over M g, {label}", late["weight"], 1.0, limit=1e-3,
                  why="what is at rest is carried: only the change of its momentum is missing")  # fmt: skip
    outcome.judge(f"kinetic energy over M g H, {label}", late["kinetic"], error=late["kinetic"], limit=1e-4,
                  why="speeds of 1 % of a fall through H: the rearranging of particles, no more")  # fmt: skip


def compute_quick(outcome: Outcome) -> None:
    """H/dx 16, 40 sound times."""
    found = rest(16, 40.0)
    _judge(outcome, quarter(found, 3), "H/dx 16")


def compute(outcome: Outcome) -> None:
    """H/dx 10, 20 and 40, 100 sound times; without the packing correction beside."""
    across = (10, 20, 40)
    runs = {n: rest(n, 100.0) for n in across}
    late = {n: quarter(runs[n], 3) for n in across}
    for n in across[:-1]:
        outcome.show(f"slope of the pressure, H/dx {n}", late[n]["slope"], 1.0)
        outcome.show(f"difference of the pressure over rho g H, H/dx {n}", late[n]["difference"])
    _judge(outcome, late[across[-1]], f"H/dx {across[-1]}")
    outcome.order(
        "order of the difference", [1.0 / n for n in across], [late[n]["difference"] for n in across]
    )
    for n in across:
        early = quarter(runs[n], 1)
        moved = abs(late[n]["height"] - 0.5)
        outcome.judge(f"mean pressure, last over second quarter, H/dx {n}", late[n]["pressure"], early["pressure"],
                      limit=0.01, why="a drift goes on: no more than the pressure's own limit")  # fmt: skip
        outcome.judge(f"sinking of the centre of mass over H, H/dx {n}", moved, error=moved, limit=2e-3,
                      why="the packing holds the volume that the density says")  # fmt: skip
    loose = quarter(rest(20, 100.0, packing_correction=0.0), 3)
    outcome.show(
        "sinking of the centre of mass over H without packing_correction, H/dx 20", abs(loose["height"] - 0.5)
    )
    _plot(outcome, runs)


def _plot(outcome: Outcome, runs: dict[int, dict[str, np.ndarray]]) -> None:
    y = np.linspace(0.0, DEPTH, 50)
    curves = [Curve("exact", exact(y) / SCALE, y / DEPTH)]
    for n, found in runs.items():
        height, pressure = found["height"][60:].mean(axis=0), found["pressure"][60:].mean(axis=0)
        curves.append(Curve(f"H/dx {n}", pressure / SCALE, height / DEPTH, "points"))
    outcome.plot("hydrostatic_pressure", "Column at rest", "p/(rho g H)", "y/H", curves)
    still = [Curve(f"H/dx {n}", found["time"], found["kinetic"]) for n, found in runs.items()]
    outcome.plot("hydrostatic_stillness", "Column at rest", "t c0/H", "kinetic energy/(M g H)", still, "y")


CASES = [
    Case("hydrostatic", "Column at rest: pressure and stillness", "exact", "quick", compute_quick),
    Case("hydrostatic_long", "Column at rest: spacing and drift", "exact", "full", compute),
]
