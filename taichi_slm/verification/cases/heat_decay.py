"""A wave of temperature dies away in a solid, of one conductivity and of two.

Scene    rho c 5.12e6 J/(m^3 K), all sides insulated. One k (20.9): a square or cube of side L with the product of
         cos(pi x/L) in every direction. Two (2.09 | 20.9, side by side, L each): the first mode of the pair
Exact    one: the amplitude falls by exp(-d kappa (pi/L)^2 t), here to exp(-1/2); two: cos(b1 x) | B cos(b2 (2L - x)),
         falling by exp(-k1 b1^2 t/(rho c)), with k1 b1 tan(b1 L) + k2 b2 tan(b2 L) = 0 and k1 b1^2 = k2 b2^2
Measured L2 error over L2 of the wave, over the whole body. The step is as long as the scheme allows, a fixed share of
         dx^2/kappa, so time and space are refined together.
Remarks  a particle at a side lacks the neighbours beyond it. Across the side that is the insulation itself. Along the
         side they would have carried heat too: with the lattice's moment a layer of about one spacing conducts too
         little, an error of first order in dx/L, and the order falls to 1.2 (shown beside). With the moment of its own
         neighbours along the side the order is two, sides and corners included. Without correction at all the error
         of the lattice moment stays, whatever the spacing.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import HEAT_ONLY, configure, liquid

LENGTH, MEAN, HEIGHT = 100e-6, 800.0, 300.0
K, RHO, HEAT_CAPACITY = 20.9, 7200.0, 711.2
KAPPA = K / (RHO * HEAT_CAPACITY)
STEPS = {"heat_stages": 3, "heat_factor": 0.1}  # short enough that the coarsest run has several steps
SECOND = "a symmetric kernel sum over its moment is of second order, sides included"


def solid(conductivity: float) -> dict[str, object]:
    """A material of constant properties; heat alone does not care that it is a liquid."""
    return liquid(
        density=RHO, heat_capacity=HEAT_CAPACITY, conductivity=conductivity, maximum_temperature=3000
    )


def l2(found: np.ndarray, exact: np.ndarray) -> float:
    """Root mean square of the difference over that of ``exact``."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def decay(dimension: int, per_length: int, **numerics: object) -> float:
    """L2 error with one conductivity, ``per_length`` particles along a side."""
    end = 0.5 / (dimension * KAPPA * (math.pi / LENGTH) ** 2)
    config = configure(
        dimension=dimension, spacing=LENGTH / per_length, materials={"metal": solid(K)}, physics=HEAT_ONLY,
        bodies=[{"shape": "box", "corner": [0] * dimension, "size": [LENGTH] * dimension, "material": "metal"}],
        performance={"skip_cold": False}, numerics={**STEPS, **numerics}, time={"end": end},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    wave = np.prod(np.cos(np.pi * sim.position / LENGTH), axis=1)
    sim.impose(MEAN + HEIGHT * wave)
    sim.run()
    return l2((sim.temperature - MEAN) / (HEIGHT * math.exp(-0.5)), wave)


def first_mode(ratio: float) -> tuple[float, float, float]:
    """b1 L, b2 L and B of two slabs, the second conducting ``ratio`` times as well."""
    root = math.sqrt(ratio)

    def balance(b: float) -> float:
        return math.tan(b) + root * math.tan(b / root)

    b = brentq(balance, 0.5 * math.pi + 1e-9, math.pi, xtol=1e-14)
    return b, b / root, math.cos(b) / math.cos(b / root)


def jump(per_length: int, **numerics: object) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """L2 error with two conductivities; x [m], temperature over the amplitude, exact."""
    b1, b2, B = first_mode(10.0)
    end = 0.5 / (0.1 * KAPPA * (b1 / LENGTH) ** 2)
    dx = LENGTH / per_length
    config = configure(
        spacing=dx, materials={"poor": solid(0.1 * K), "good": solid(K)}, physics=HEAT_ONLY,
        bodies=[{"shape": "box", "corner": [0, 0], "size": [LENGTH, 8 * dx], "material": "poor"},
                {"shape": "box", "corner": [LENGTH, 0], "size": [LENGTH, 8 * dx], "material": "good"}],
        performance={"skip_cold": False}, numerics={**STEPS, **numerics}, time={"end": end},
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    x = sim.position[:, 0] / LENGTH
    wave = np.where(x < 1, np.cos(b1 * np.minimum(x, 1)), B * np.cos(b2 * (2 - x)))
    sim.impose(MEAN + HEIGHT * wave)  # both materials have the same enthalpy
    sim.run()
    found = (sim.temperature - MEAN) / (HEIGHT * math.exp(-0.5))
    order = np.argsort(x)
    return l2(found, wave), x[order] * LENGTH, found[order], wave[order]


def trend(outcome: Outcome, dimension: int, counts: tuple[int, ...]) -> Curve:
    """Errors and order of the default forms; the finest and the order are judged."""
    name, errors = f"{dimension}-D", [decay(dimension, count) for count in counts]
    for count, error in zip(counts, errors, strict=True):
        if count == counts[-1]:
            outcome.judge(f"L2 error, {name}, L/dx {count}", error, error=error, limit=0.005,
                          why="below what the conductivity of a steel is known to")  # fmt: skip
        else:
            outcome.show(f"L2 error, {name}, L/dx {count}", error)
    spacings = [1 / count for count in counts]
    outcome.order(f"order, {name}", spacings, errors, at_least=1.8, why=SECOND)
    return Curve(name, spacings, errors)


def beside(outcome: Outcome, dimension: int, counts: tuple[int, ...]) -> list[Curve]:
    """The same with the lattice's moment for all, and with none."""
    spacings, curves = [1 / count for count in counts], []
    forms: dict[str, dict[str, Any]] = {
        "moment of the lattice": {"conduction_moment": "lattice"},
        "no moment": {"conduction_correction": False},
    }
    for form, numerics in forms.items():
        errors = [decay(dimension, count, **numerics) for count in counts]
        for count, error in zip(counts, errors, strict=True):
            outcome.show(f"L2 error, {form}, {dimension}-D, L/dx {count}", error)
        outcome.order(f"order, {form}, {dimension}-D", spacings, errors)
        curves.append(Curve(f"{dimension}-D, {form}", spacings, errors, "dashed"))
    return curves


def compute_quick(outcome: Outcome) -> None:
    """2-D."""
    trend(outcome, 2, (10, 20, 40))


def compute(outcome: Outcome) -> None:
    """2-D and 3-D with the other forms beside, and two conductivities."""
    curves = [trend(outcome, 2, (10, 20, 40)), *beside(outcome, 2, (10, 20, 40))]
    curves += [trend(outcome, 3, (12, 18, 27)), *beside(outcome, 3, (12, 18, 27))]
    outcome.plot("heat_decay", "Decay of a wave", "dx / L", "L2 error", curves, "xy")
    counts, errors = (10, 20, 40), []
    for count in counts:
        error, x, found, exact = jump(count)
        errors.append(error)
        if count < counts[-1]:
            outcome.show(f"L2 error, k 1 : 10, L/dx {count}", error)
    outcome.judge(f"L2 error, k 1 : 10, L/dx {counts[-1]}", errors[-1], error=errors[-1], limit=0.02,
                  why="across a jump of k the harmonic mean of (38) is consistent to first order")  # fmt: skip
    outcome.order("order, k 1 : 10", [1 / count for count in counts], errors)
    slabs = [Curve("exact", x, exact), Curve(f"L/dx {counts[-1]}", x, found, "points")]
    outcome.plot("heat_decay_jump", "Two conductivities, 1 : 10", "x [m]", "(T - mean) / amplitude", slabs)


CASES = [
    Case("heat_decay_2d", "Decay of a wave of temperature, 2-D", "exact", "quick", compute_quick),
    Case(
        "heat_decay", "Decay of a wave of temperature; conductivity jumping by 10", "exact", "full", compute
    ),
]
