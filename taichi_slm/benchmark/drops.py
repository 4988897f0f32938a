"""The two drops that this program and PySPH both run: where they start, and what their error is.

Elliptic  a disc of inviscid liquid with the velocity of a pure strain (taichi_slm/verification/cases/elliptic_drop.py);
          its error is that of the semi-axis that is further from the exact one, at A0 t = 1
Square    a square of 0.3 x 0.3, surface tension 1, density 1 and kinematic viscosity 0.2, becomes a disc of radius R;
          its error is the root mean square, over the second half of the time, of the pressure within R/2 less that
          of the surroundings, over sigma/R, less 1
"""

import math
from typing import Any

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.cases import elliptic_drop
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

BOX, CORNER, SIDE = 1.0, 0.35, 0.3  # of PySPH's example [m]
SIGMA, RHO, NU, SOUND = 1.0, 1.0, 0.2, 20.0  # [N/m], [kg/m^3], [m^2/s], [m/s]
RADIUS = SIDE / math.sqrt(math.pi)  # of the disc of the same area [m]
OUTSIDE = 0.35  # from here on surroundings are asked for their pressure [m]
SAMPLES = 25
WARM_STEPS = 16


def square_times(end: float) -> np.ndarray:
    """When the pressure is looked at [s]: the second half of the time."""
    return np.linspace(0.5 * end, end, SAMPLES + 1)[1:]


def square(per_unit: int, end: float) -> Simulation:
    """The liquid square in empty surroundings, on a lattice of spacing 1/``per_unit``."""
    return Simulation(configure(
        spacing=1.0 / per_unit, time={"end": end},
        materials={"liquid": liquid(density=RHO, viscosity=RHO * NU, surface_tension=SIGMA)},
        bodies=[{"shape": "box", "corner": [CORNER, CORNER], "size": [SIDE, SIDE], "material": "liquid"}],
        domain={"lower": [0.0, 0.0], "upper": [BOX, BOX]},
        physics={**FLOW_ONLY, "surface_tension": True}, numerics={"sound_speed": SOUND},
    ), threads=1)  # fmt: skip


def started(drop: str, level: int, arrangement: str, end: float) -> Simulation:
    """The drop of that name at time zero; ``level``: spacings per radius (elliptic) or per length (square).

    ``end`` [s] is the square's; the elliptic drop has that of its exact answer.
    """
    return elliptic_drop.start(level, arrangement) if drop == "elliptic" else square(level, end)


def ours(drop: str, level: int, arrangement: str = "", end: float = 1.0) -> dict[str, Any]:
    """Run it with default settings: particles, seconds without compiling, steps, and its error.

    A few steps of a simulation that is thrown away come first, so that no kernel is compiled in the time measured.
    """
    thrown_away = started(drop, level, arrangement, end)
    for _ in range(WARM_STEPS):
        thrown_away.step()
    sim = started(drop, level, arrangement, end)
    sim.compile()
    if drop == "elliptic":
        sim.run()
        found = elliptic_error(sim.position)
    else:
        jumps = []
        for t in square_times(end):
            sim.advance(t)
            r = np.linalg.norm(sim.position - sim.position.mean(axis=0), axis=1)
            jumps.append(float(sim.state.array("pressure")[r < 0.5 * RADIUS].mean()))
        found = square_error(jumps)
    count = sim.scene.count
    return {"particles": count, "liquid": count, "steps": sim.steps, "seconds": sim.solver_time_s} | found


def elliptic_error(position: Any) -> dict[str, float]:
    """Errors of the semi-axes at the end; ``position`` [m], shape [n, 2]."""
    a, b = elliptic_drop.measured_axes(np.asarray(position)) / elliptic_drop.semi_axes()[:, -1] - 1.0
    return {"semi-axis a": float(a), "semi-axis b": float(b), "error": float(max(abs(a), abs(b)))}


def square_error(jumps: list[float]) -> dict[str, float]:
    """Of the pressures [N/m^2] in the drop above its surroundings, at :func:`square_times`."""
    off = np.asarray(jumps) * RADIUS / SIGMA - 1.0
    return {"mean jump": float(off.mean()), "error": float(np.sqrt(np.mean(off**2)))}


def for_pysph(
    drop: str, level: int, arrangement: str, end: float, alpha: float, delta_sph: bool
) -> dict[str, Any]:
    """The job for pysph_drop.py: the particles of :func:`started`, in the square's case with surroundings."""
    sim = started(drop, level, arrangement, end)
    job: dict[str, Any] = {"drop": drop, "spacing": 1.0 / level, "end": sim.config.time.end}
    if drop == "elliptic":
        arrays = {
            name: sim.state.array(name).tolist() for name in ("position", "velocity", "density", "mass")
        }
        fastest = elliptic_drop.STRAIN * elliptic_drop.RADIUS
        return job | arrays | {"rest_density": elliptic_drop.RHO, "sound_speed": elliptic_drop.SOUND,
                               "fastest": fastest, "alpha": alpha, "delta_sph": delta_sph}  # fmt: skip
    position, colour = with_surroundings(sim.position, level)
    return job | {
        "position": position.tolist(), "colour": colour.tolist(), "box": BOX, "rest_density": RHO,
        "sound_speed": SOUND, "kinematic_viscosity": NU, "surface_tension": SIGMA, "inside": 0.5 * RADIUS,
        "outside": OUTSIDE, "sample_times": square_times(end).tolist(),
    }  # fmt: skip


def with_surroundings(liquid_position: np.ndarray, per_unit: int) -> tuple[np.ndarray, np.ndarray]:
    """The liquid's particles [m], then those of the lattice around it up to the box; 1 for liquid, 0 for others."""
    sites = np.arange(per_unit) + 0.5
    lattice = np.stack(np.meshgrid(sites, sites, indexing="ij"), axis=-1).reshape(-1, 2) / per_unit
    middle = np.abs(lattice - (CORNER + 0.5 * SIDE))
    around = lattice[(middle > 0.5 * SIDE).any(axis=1)]
    assert len(around) + len(liquid_position) == per_unit**2, "a square that the lattice does not divide"
    colour = np.repeat([1.0, 0.0], [len(liquid_position), len(around)])
    return np.concatenate([liquid_position, around]), colour
