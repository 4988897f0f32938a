"""Thermocapillary return flow: a shallow layer is drawn to the cold side at its surface and comes back below.

Scene    a layer of depth d = 1 that fills a groove of length 6 d to its brim, rho = mu = 1, |sigma_T| G = 0.2,
         T = T0 + G x frozen in space; sigma = 20 keeps the surface flat, no gravity
Exact    far from the ends u = (sigma_T G d/mu)(3/4 e^2 - e/2), e = y/d; at the surface sigma_T G d/(4 mu) (Levich 1962)
Measured in the middle third of the layer, layer by layer, the mean from two to six diffusion times d^2/nu (the layer
         still sloshes a little): the difference from the exact profile, root mean square over the surface speed, and
         the speed of the outermost layer over the exact one at its height

The wall below is what the isolated drop does not have: liquid beside a solid, at its no-slip face. (Gravity would
keep the surface flat, too, but then the pressure that drives the return is a tilt of a hundredth of a spacing per
spacing, which layers of particles do not make: the flow comes out at 0.6 of the exact one.)
"""

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

STRESS, T0, G, LENGTH, SIGMA = 0.2, 2000.0, 100.0, 6.0, 20.0
TOP = STRESS / 4.0  # speed of the surface
END = 6.0


def exact(height: np.ndarray) -> np.ndarray:
    """Velocity along the layer [m/s] at ``height`` [m]; the surface runs to the cold side."""
    return np.asarray(-STRESS * (0.75 * height**2 - 0.5 * height))


def profile(resolution: int, **numerics: object) -> tuple[np.ndarray, np.ndarray]:
    """Mean heights [m] and velocities [m/s] of the layers of particles in the middle third."""
    dx = 1.0 / resolution
    law = {"line": {"value": SIGMA, "slope": -STRESS / G, "at": T0}}
    config = configure(
        spacing=dx, time={"end": END}, gravity=0.0, ambient_temperature=T0,
        materials={"oil": liquid(density=1.0, viscosity=1.0, surface_tension=law)},
        bodies=[{"shape": "container", "material": "oil", "corner": [-LENGTH / 2, 0.0], "size": [LENGTH, 1.0]},
                {"shape": "box", "material": "oil", "corner": [-LENGTH / 2, 0.0], "size": [LENGTH, 1.0]}],
        physics={**FLOW_ONLY, "surface_tension": True, "marangoni": True},
        numerics={"sound_speed": 40.0, **numerics},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    moves = ~sim.scene.wall
    heights, speeds = [], []
    while sim.time < END * (1 - 1e-9):
        sim.impose(T0 + G * sim.position[:, 0])
        for _ in range(4):
            sim.step()
        if sim.time > END / 3:
            middle = moves & (np.abs(sim.position[:, 0]) < LENGTH / 6)
            heights.append(sim.position[middle, 1])
            speeds.append(sim.velocity[middle, 0])
    y, u = np.concatenate(heights), np.concatenate(speeds)
    layer = np.minimum(np.floor(y * resolution).astype(int), resolution - 1)
    count = np.bincount(layer)
    return np.bincount(layer, y) / count, np.bincount(layer, u) / count


def compute(outcome: Outcome) -> None:
    """10, 15 and 20 particles over the depth; the printed body force shown."""
    curves, resolutions = [], (10, 15, 20)
    for n in resolutions:
        y, u = profile(n)
        difference = float(np.sqrt(np.mean((u - exact(y)) ** 2)) / TOP)
        surface = u[-1] / exact(y[-1])
        if n == resolutions[-1]:
            outcome.judge(
                f"profile, d/dx {n}",
                difference,
                error=difference,
                limit=0.05,
                why="what a melt pool's width takes from the force",
            )
            outcome.judge(
                f"speed of the surface, d/dx {n}",
                surface,
                1.0,
                limit=0.05,
                why="what a melt pool's width takes from the force",
            )
        else:
            outcome.show(f"profile, d/dx {n}", difference)
            outcome.show(f"speed of the surface, d/dx {n}", surface, 1.0)
        curves.append(Curve(f"d/dx {n}", y, u / TOP, "points"))
    y, u = profile(resolutions[-1], tension="body_force", shifting=0.0)
    outcome.show(
        f"profile, d/dx {resolutions[-1]}, body force", float(np.sqrt(np.mean((u - exact(y)) ** 2)) / TOP)
    )
    e = np.linspace(0.0, 1.0, 50)
    outcome.plot("return_flow", "Thermocapillary return flow", "height / d", "velocity / surface speed",
                 [Curve("exact", e, exact(e) / TOP, "dashed"), *curves])  # fmt: skip


CASES = [Case("return_flow", "Thermocapillary return flow over a wall", "exact", "full", compute)]
