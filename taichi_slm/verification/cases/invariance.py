"""Nothing depends on where and how a scene stands; what is conserved stays.

Scene    (a) a liquid disc, stretched and stirred, that falls; (b) the same without gravity, turning about its centre;
         (c) a steel drop of R/dx 10 that oscillates by its surface tension for two periods, and the same drop shifted,
         mirrored and turned by 90 degrees; (d) a short laser track in a plate with two grains, and the same three
         spacings further, which is no multiple of a cell, and mirrored in x with the beam reversed
Exact    (a) momentum M (u0 - g t), the centre on its parabola; (b) momentum and angular momentum stay; (c), (d) the
         same answer, shifted, mirrored and turned back
Measured (a), (b) momentum over the sum of m |u|, place over R, angular momentum over the sum of m |x - X| |u - U| (X, U
         of the centre of mass); (c), (d) the largest difference of any particle's place over R or dx, of any
         temperature over 1000 K

Elsewhere a particle's neighbours are summed in another order, so the runs part at 1e-16, and the flow amplifies what
parts them: tenfold in a third of the drop's period (plot). That is round-off, and the limit leaves room for it. The
bins of the beam end at multiples of their size, as the lattice of every plate does, so (d) is shifted by spacings.
"""

from dataclasses import replace

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.scene.build import build_scene
from taichi_slm.scene.scene import Scene
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

UM = 1e-6


def stirred(gravity: float, turn: float) -> dict[str, float]:
    """Errors of momentum, place and angular momentum, relative, of a stretched and stirred disc in flight."""
    radius, end, thrown = 0.8, 0.4, np.array([0.3, 2.0])
    config = configure(
        spacing=0.1, gravity=gravity, materials={"fluid": liquid(viscosity=1.0)},
        bodies=[{"shape": "droplet", "centre": [0, 0], "radius": radius, "material": "fluid", "stretch": 0.1}],
        domain={"lower": [-3, -3], "upper": [3, 3]},
        physics=FLOW_ONLY, numerics={"sound_speed": 30}, time={"end": end},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    mass = sim.state.array("mass")[:, None]
    swirl = np.random.default_rng(4).normal(0.0, 0.3, sim.position.shape)
    swirl += turn * sim.position[:, ::-1] * [-1.0, 1.0]
    sim.state.load(velocity=thrown + swirl - np.average(swirl, axis=0))
    start, spin = sim.position.mean(axis=0), _spin(sim)
    sim.run()
    t = sim.time
    momentum = np.sum(mass * sim.velocity, axis=0) - mass.sum() * (thrown - [0.0, gravity * t])
    way = sim.position.mean(axis=0) - start - thrown * t + [0.0, 0.5 * gravity * t**2]
    scale = np.sum(mass[:, 0] * np.linalg.norm(sim.velocity, axis=1))
    return {
        "momentum": float(np.linalg.norm(momentum) / scale),
        "place": float(np.linalg.norm(way) / radius),
        "angular momentum": abs(_spin(sim)[0] - spin[0]) / spin[1],
    }  # fmt: skip


def _spin(sim: Simulation) -> tuple[float, float]:
    """Angular momentum about the centre of mass, and the sum of its parts' largest possible magnitudes [kg m/s]."""
    mass = sim.state.array("mass")
    x, u = sim.position - sim.position.mean(axis=0), sim.velocity - sim.velocity.mean(axis=0)
    parts = mass * (x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0])
    return float(parts.sum()), float(np.sum(mass * np.linalg.norm(x, axis=1) * np.linalg.norm(u, axis=1)))


def moved(scene: Scene, matrix: np.ndarray, shift: np.ndarray) -> Scene:
    """``scene`` turned or mirrored by ``matrix``, then shifted [m], its domain with it."""
    corners = np.stack([scene.lower @ matrix.T, scene.upper @ matrix.T]) + shift
    return replace(scene, position=scene.position @ matrix.T + shift, velocity=scene.velocity @ matrix.T,
                   lower=corners.min(axis=0), upper=corners.max(axis=0))  # fmt: skip


def oscillate(matrix: np.ndarray, shift: np.ndarray, times: np.ndarray) -> list[np.ndarray]:
    """Places over R, turned back, of a steel drop that oscillates by its tension, at ``times`` [s]."""
    radius = 50 * UM
    config = configure(
        spacing=radius / 10, materials={"steel": liquid(density=7000, viscosity=0.006, surface_tension=1.8)},
        bodies=[{"shape": "droplet", "centre": [0, 0], "radius": radius, "material": "steel", "stretch": 0.08}],
        physics={**FLOW_ONLY, "surface_tension": True}, numerics={"sound_speed": 50}, time={"end": times[-1]},
    )  # fmt: skip
    sim = Simulation(config, moved(build_scene(config), matrix, shift), threads=1)
    found = []
    for t in times:
        sim.advance(t)
        found.append((sim.position - shift) @ matrix / radius)
    return found


def track(mirror: float, shift: float, times: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places over dx, turned back, and temperatures [K] of a short track of two grains, at ``times`` [s]."""
    dx = 5 * UM
    way = [[mirror * x + shift] for x in (60 * UM, 125 * UM)]
    config = configure(
        spacing=dx, bodies=[{"shape": "plate", "length": 200 * UM, "depth": 60 * UM},
                            {"shape": "powder_row", "start": 50 * UM, "length": 80 * UM, "radius": 20 * UM}],
        laser={"power": 60, "beam_radius": 30 * UM, "absorptivity": 0.35,
               "path": [{"kind": "line", "start": way[0], "end": way[1], "speed": 2.0}]}, time={"end": times[-1]},
    )  # fmt: skip
    matrix, offset = np.diag([mirror, 1.0]), np.array([shift, 0.0])
    sim = Simulation(config, moved(build_scene(config), matrix, offset), threads=1)
    found = []
    for t in times:
        sim.advance(t)
        found.append(((sim.position - offset) @ matrix / dx, sim.temperature))
    return found


def compute_conserved(outcome: Outcome) -> None:
    """(a) and (b)."""
    for label, found in (("falling", stirred(9.81, 0.0)), ("turning", stirred(0.0, 1.0))):
        for name, why in CONSERVED.items():
            outcome.judge(f"{name}, {label}", found[name], error=found[name], limit=1e-10, why=why)


CONSERVED = {
    "momentum": "forces of pairs cancel to 1e-16, a thousand times",
    "place": "the same, summed once more",
    "angular momentum": "forces of pairs are central, so that they turn nothing, to 1e-16",
}


def compute(outcome: Outcome) -> None:
    """(c) over two periods and (d) to the end of its 30 us."""
    period = 2.0 * np.pi / np.sqrt(6.0 * 1.8 / (7000.0 * (50 * UM) ** 3))
    times = np.linspace(0.0, 2.0 * period, 21)[1:]
    stay, still = np.eye(2), np.zeros(2)
    there = oscillate(stay, still, times)
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    curves = []
    for label, matrix, shift in (("shifted", stay, np.array([12.345, -3.3]) * UM),
                                 ("mirrored", np.diag([-1.0, 1.0]), still), ("turned", turned, still)):  # fmt: skip
        differences = [_apart(a, b) for a, b in zip(there, oscillate(matrix, shift, times), strict=True)]
        outcome.judge(f"places of a drop {label}, over R", differences[-1], error=differences[-1], limit=1e-4,
                      why="round-off and its growth over two periods, with a thousandfold in hand")  # fmt: skip
        curves.append(Curve(label, times / period, differences))
    outcome.plot(
        "invariance_drop", "The same drop elsewhere", "time/period", "largest difference/R", curves, "y"
    )
    _tracks(outcome)


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max())


def _tracks(outcome: Outcome) -> None:
    times = np.linspace(0.0, 30 * UM, 11)[1:]
    there = track(1.0, 0.0, times)
    curves = []
    for label, mirror, shift in (("shifted", 1.0, 15 * UM), ("mirrored", -1.0, 0.0)):
        other = track(mirror, shift, times)
        places = [_apart(a[0], b[0]) for a, b in zip(there, other, strict=True)]
        heats = [_apart(a[1], b[1]) / 1000.0 for a, b in zip(there, other, strict=True)]
        for name, values in (("places, over dx", places), ("temperatures, over 1000 K", heats)):
            outcome.judge(f"{name}, of a track {label}", values[-1], error=values[-1], limit=1e-4,
                          why="round-off and its growth, from the first light to a pool that flows")  # fmt: skip
            curves.append(Curve(f"{name}, {label}", times / UM, values))
    outcome.plot(
        "invariance_track", "The same track elsewhere", "time [us]", "largest difference", curves, "y"
    )


CASES = [
    Case(
        "conserved_in_flight", "Momentum and angular momentum in flight", "exact", "quick", compute_conserved
    ),
    Case("invariance", "A scene shifted, mirrored and turned", "exact", "full", compute),
]
