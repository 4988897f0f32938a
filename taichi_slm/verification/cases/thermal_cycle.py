"""Test 1 of the paper: a free drop whose reference density follows an imposed temperature, ten cycles.

Scene    a disc of R = 1 m, dx = R/20, rho0(T) = 1000 (2 - T/1000) kg/m^3, T = 1000 (1 + sin(2 pi t)/20) K (46); it
         starts with the radial velocity that the first rate of rho0 asks for; the scene of
         configs/droplet_thermal_cycle.yaml
Answer   the volume of any part is its mass over rho0(T). The weakly compressible density lags behind rho0 by at most
         0.49/c0^2 (R = 1, 2-D), 0.03 % at c0 = 40
Measured area of the Voronoi cells of the inside (r < 0.5 R) and near the surface (0.8 R < r < 0.9 R) over its exact
         value, less one (47), 16 times a cycle; r is measured from the middle, R is that of the moment

What decides is the half of the cycle in tension: without viscosity the drop is torn apart. Monaghan's artificial
viscosity alpha = 0.13 (mu = rho alpha h c0/8) is in the scene; the runs with other alpha and c0 show what it does.
The paper's h/dx = 1.2 is shown beside 1.5: its sums see 0.9638 of a divergence on a lattice, so a drop that has to
expand by 5 % expands by 5 %/0.9638, an error of 0.19 %; at 1.5 they see 0.9974. The density, which only knows the
sums, is right in both.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.analysis.voronoi import cell_volumes
from taichi_slm.config.schema import Config
from taichi_slm.errors import BlowUpError
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import FLOW_ONLY, configure, liquid

CYCLES, A_CYCLE = 10, 16  # cycles of 1 s; measurements in each
NUMERICS = {"smoothing": 1.5, "sound_speed": 40, "artificial_viscosity": 0.13, "packing_correction": 0}


def scene(cycles: int = CYCLES, **numerics: Any) -> Config:
    """The drop for ``cycles`` seconds, its numerics changed by ``numerics``."""
    return configure(
        spacing=0.05,
        materials={
            "fluid": liquid(
                density={"liquid": {"line": {"value": 1000, "slope": -1.0, "at": 1000}}},
                viscosity=0,
                maximum_temperature=1500,
            )
        },
        bodies=[
            {
                "shape": "droplet",
                "material": "fluid",
                "centre": [0, 0],
                "radius": 1.0,
                "follow_density": True,
                "program": {"kind": "sine", "mean": 1000, "amplitude": 0.05, "frequency": 1.0},
            }
        ],
        physics=FLOW_ONLY,
        numerics={**NUMERICS, **numerics},
        time={"end": float(cycles)},
    )


@dataclass(frozen=True)
class Found:
    """Relative errors over time, shape [n] each; shorter than asked for if the run blew up."""

    time: np.ndarray  # [s]
    inside: np.ndarray
    surface: np.ndarray
    density: np.ndarray  # the worst particle's


def errors(config: Config) -> Found:
    """Errors of volume and density, 16 times a cycle."""
    sim = Simulation(config, threads=1)
    mass, rows = sim.state.array("mass"), []
    for t in np.arange(1, round(config.time.end) * A_CYCLE + 1) / A_CYCLE:
        try:
            sim.advance(t)
        except BlowUpError:
            break
        exact = mass / sim.state.array("reference_density")
        rows.append(
            [
                t,
                *volume_errors(sim.position, exact),
                np.abs(sim.state.array("density") * exact / mass - 1.0).max(),
            ]
        )
    return Found(*np.array(rows).reshape(-1, 4).T)


def volume_errors(position: np.ndarray, exact: np.ndarray) -> tuple[float, float]:
    """Relative errors of the volume inside and near the surface, at ``position`` [m], shape [n, 2].

    ``exact`` [m^2], shape [n], are the areas that the particles should have.
    """
    gap = position - np.average(position, axis=0, weights=exact)
    place = np.linalg.norm(gap, axis=1) / np.sqrt(exact.sum() / np.pi)
    area = cell_volumes(position)
    inside, surface = (
        float(np.nansum(area[part]) / exact[part].sum() - 1.0)
        for part in (place < 0.5, (place > 0.8) & (place < 0.9))
    )
    return inside, surface


def worst(values: np.ndarray, time: np.ndarray, first: int = 1, last: int = CYCLES) -> float:
    """Largest magnitude of ``values`` in the cycles ``first`` to ``last``; infinite if the run ended before."""
    chosen = (time > first - 1) & (time <= last)
    return float(np.abs(values[chosen]).max()) if len(time) >= last * A_CYCLE else np.inf


def compute(outcome: Outcome) -> None:
    """The scene for ten cycles, the same with the paper's h/dx; then alpha and c0 for three cycles."""
    found, paper = errors(scene()), errors(scene(smoothing=1.2))
    _judge(outcome, found)
    for name, values in (("inside", paper.inside), ("near the surface", paper.surface)):
        outcome.show(f"volume error at the paper's h/dx 1.2, {name}", worst(values, paper.time),
                     note="the sums see 0.9638 of a divergence: 0.19 % too much volume at +-5 %")  # fmt: skip
        outcome.show(f"its cycles 9 and 10 over 2 and 3, {name}", _growth(values, paper.time))
    _viscosity(outcome)
    curves = [
        Curve("inside", found.time, 100 * found.inside),
        Curve("near the surface", found.time, 100 * found.surface),
        Curve("inside, h/dx 1.2", paper.time, 100 * paper.inside, "dashed"),
        Curve("near the surface, h/dx 1.2", paper.time, 100 * paper.surface, "dashed"),
    ]
    outcome.plot("thermal_cycle", "Test 1: volume error", "time / cycle", "error / %", curves)


def _judge(outcome: Outcome, found: Found) -> None:
    """The error of either part, its growth, and the lag of the density."""
    parts = (("inside", found.inside, 2.5e-3), ("near the surface", found.surface, 3e-3))
    for name, values, limit in parts:
        error = worst(values, found.time)
        outcome.judge(f"volume error, {name}", error, error=error, limit=limit,
                      why="the paper: 0.4 and 0.8 %; prototypes of the method: 0.23 and 0.29 %")  # fmt: skip
    for name, values, _ in parts:
        ratio = _growth(values, found.time)
        outcome.judge(f"error of cycles 9 and 10 over that of 2 and 3, {name}", ratio, error=max(0.0, ratio - 1.0),
                      limit=0.1, why="no growth; a tenth is 0.015 % of the volume, for some 200 particles that "
                      "leave their lattice")  # fmt: skip
    lag = worst(found.density, found.time, 2)
    outcome.judge("density lag, worst particle", lag, error=lag, limit=2 * 0.49 / 40**2,
                  why="twice the bound 0.49/c0^2 of the middle: particles are not where the continuum is")  # fmt: skip


def _growth(values: np.ndarray, time: np.ndarray) -> float:
    """Largest error of cycles 9 and 10 over that of cycles 2 and 3."""
    return worst(values, time, 9, 10) / worst(values, time, 2, 3)


def _viscosity(outcome: Outcome) -> None:
    """What the artificial viscosity is for."""
    for sound in (20, 40):
        for alpha in (0.0, 0.05, 0.13, 0.3):
            found = errors(scene(3, sound_speed=sound, artificial_viscosity=alpha))
            for name, values in (("inside", found.inside), ("near the surface", found.surface)):
                outcome.show(
                    f"volume error in 3 cycles, alpha {alpha}, c0 {sound}, {name}",
                    worst(values, found.time, 1, 3),
                    note="the tensile half of the cycle tears an inviscid drop apart" if alpha == 0 else "",
                )


CASES = [Case("thermal_cycle", "Test 1: a drop under thermal cycling", "paper", "full", compute)]
