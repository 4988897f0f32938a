"""Start-up of the flow between two plates, driven by gravity.

Scene    a column of liquid slides down a channel of width D between two walls, open at both ends, from rest; length
         L = 5 D, Re = u_max D/nu = 0.5; the fall of the middle within the run is D/4, the pressure is zero
Exact    u = (g/(2 nu)) (D^2/4 - x^2) - sum over n of 4 g D^2/(nu pi^3) (-1)^n/(2n+1)^3 cos((2n+1) pi x/D)
             exp(-(2n+1)^2 pi^2 nu t/D^2): the series of the start-up
Measured the speeds of the particles of the middle third against the series at their places, root mean square over that
         of the series, the worst of five times; from a parabola through the last profile the viscosity that the
         particles feel and the plane where they stand still, counted from the wall's face into the wall

Two things decide, and the printed form misses both. A wall particle is a centre, not a face: if it shows the liquid
its own speed, zero, the liquid stands still half a spacing inside the wall, and the flow is faster by 2.2 dx/D. And the
sum (12) is not isotropic on a lattice at h/dx 1.2: it makes 0.750 of a shear along the lattice, 1.157 of one at 45
degrees to it, 0.953 in the mean over all directions.
"""

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

WIDTH, NU, RHO, REYNOLDS, LENGTH = 1.0, 0.1, 1000.0, 0.5, 5.0
TOP = REYNOLDS * NU / WIDTH  # largest velocity in the end [m/s]
GRAVITY = 8.0 * NU * TOP / WIDTH**2
PRINTED = {"viscosity_form": "printed", "viscosity_correction": False, "walls": "no_slip_centres"}
TIMES = np.array([0.02, 0.05, 0.1, 0.2, 0.5]) * WIDTH**2 / NU


def series(x: np.ndarray, t: float) -> np.ndarray:
    """Speed down the channel [m/s] at ``x`` [m] from its middle, ``t`` [s] after the start."""
    steady = GRAVITY / (2.0 * NU) * (WIDTH**2 / 4.0 - x**2)
    odd = 2 * np.arange(60)[:, None] + 1
    decaying = np.exp(-((odd * np.pi / WIDTH) ** 2) * NU * t) * np.cos(odd * np.pi * x / WIDTH) / odd**3
    signs = (-1.0) ** np.arange(60)[:, None]
    return np.asarray(steady - 4.0 * GRAVITY * WIDTH**2 / (NU * np.pi**3) * np.sum(signs * decaying, axis=0))


def profiles(resolution: int, **numerics: object) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places x [m] and speeds down [m/s] of the middle third at TIMES, with ``resolution`` particles across."""
    dx = WIDTH / resolution
    wall, height = 4 * dx, LENGTH * WIDTH
    plate = {"shape": "box", "material": "oil", "wall": True, "size": [wall, height + 2 * WIDTH]}
    config = configure(
        spacing=dx, gravity=GRAVITY, materials={"oil": liquid(density=RHO, viscosity=RHO * NU)},
        bodies=[{"shape": "box", "material": "oil", "corner": [0.0, 0.0], "size": [WIDTH, height]},
                {**plate, "corner": [-wall, -1.5 * WIDTH]}, {**plate, "corner": [WIDTH, -1.5 * WIDTH]}],
        physics=FLOW_ONLY, numerics={"sound_speed": 40.0 * TOP, "packing_correction": 0, **numerics},
        time={"end": TIMES[-1]},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    moves = ~sim.scene.wall
    # a column that falls carries nothing: not the pressure of liquid at rest with which a scene under gravity starts
    sim.state.load(density=np.full(sim.scene.count, RHO), mass=np.full(sim.scene.count, RHO * dx**2))
    sim.weigh()
    middle = moves & (np.abs(sim.position[:, 1] - 0.5 * height) < height / 6)
    found = []
    for t in TIMES:
        sim.advance(t)
        found.append((sim.position[middle, 0] - 0.5 * WIDTH, -sim.velocity[middle, 1]))
    return found


def error(profile: tuple[np.ndarray, np.ndarray], t: float) -> float:
    """Root mean square of speed less series, over that of the series."""
    exact = series(profile[0], t)
    return float(np.linalg.norm(profile[1] - exact) / np.linalg.norm(exact))


def parabola(profile: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Viscosity felt over the true one, and where the flow stands still [m into the wall], of a steady profile."""
    curvature, slope, middle = np.polyfit(*profile, 2)
    half = np.sqrt(slope**2 - 4.0 * curvature * middle) / (2.0 * abs(curvature))
    return float(GRAVITY / (2.0 * NU) / -curvature), float(half - 0.5 * WIDTH)


def compute(outcome: Outcome) -> None:
    """10, 20 and 40 particles across; each with the printed form beside it."""
    across = (10, 20, 40)
    corrected = {n: profiles(n) for n in across}
    errors = {n: max(map(error, corrected[n], TIMES)) for n in across}
    for n in across:
        plain = profiles(n, **PRINTED)
        if n == across[-1]:
            outcome.judge(f"profile, D/dx {n}", errors[n], error=errors[n], limit=0.02,
                          why="second order in dx inside, and walls whose face is where they say")  # fmt: skip
        else:
            outcome.show(f"error of the profile, D/dx {n}", errors[n])
        outcome.show(f"the same with the printed form and walls, D/dx {n}", max(map(error, plain, TIMES)))
        viscosity, plane = parabola(corrected[n][-1])
        outcome.show(f"viscosity felt in the end, D/dx {n}", viscosity, 1.0)
        outcome.show(
            f"plane of no slip, D/dx {n}", plane * n / WIDTH, unit="dx into the wall", note="0 is the face"
        )
    early = [max(map(error, corrected[n][:3], TIMES[:3])) for n in across]
    outcome.order("order of the start-up, nu t/D^2 up to 0.1", [1.0 / n for n in across], early, at_least=1.5,
                  why="2 while particles are in order; a plane of no slip off by a share of dx gives 1")  # fmt: skip
    _plot(outcome, corrected[across[-1]], across[-1])


def _plot(outcome: Outcome, found: list[tuple[np.ndarray, np.ndarray]], n: int) -> None:
    fine = np.linspace(-0.5, 0.5, 101) * WIDTH
    curves = []
    for t, (x, speed) in zip(TIMES, found, strict=True):
        curves.append(Curve(f"series, nu t/D^2 = {t * NU / WIDTH**2:g}", fine / WIDTH, series(fine, t) / TOP))
        some = slice(None, None, max(1, len(x) // 150))
        curves.append(Curve("", x[some] / WIDTH, speed[some] / TOP, "points"))
    outcome.plot("poiseuille_profiles", f"Start-up between two plates, D/dx {n}", "x/D", "u/u_max", curves)


CASES = [Case("poiseuille", "Poiseuille flow: start-up between two plates", "exact", "full", compute)]
