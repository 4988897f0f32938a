"""Two-phase melting of a half space (Neumann): the front moves as the root of time.

Scene    2-D strip of solid at 293 K on layers held at 2500 K; rho 7200, L 2.6e5, c 711.2 | 937.4, melting within 1 K of
         1723 K; k 20.9 in both, and 209 in the liquid; until the front has come 10, 20 and 40 dx
Exact    s = 2 lambda sqrt(kappa_l t), lambda 0.342112 and 0.458334 (METHOD)
Measured lambda from the times at which layers are half molten, fitted as s = 2 lambda sqrt(kappa_l t) + s_0 over the
         second half of the way: s_0 is where the held side begins for the particles, a part of a spacing. The front
         waits between two layers for the next one to warm up, so it is looked at once a layer.
Remarks  the strip is eight particles wide, and as long as the heat comes. The apparent heat capacity (39) steps over a
         band of 1 K, which is shown; it is judged with one of 20 K, narrower than that of any alloy here, which moves
         the front of the enthalpy form by 0.3 % at most.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import erf, erfc

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import HEAT_ONLY, configure, melting

DX, WIDTH = 5e-6, 8
HELD, MELTING, COLD, RHO, LATENT = 2500.0, 1723.0, 293.0, 7200.0, 2.6e5
K_SOLID, C_SOLID, C_LIQUID = 20.9, 711.2, 937.4
BAND = 20.0  # between solidus and liquidus, for the apparent heat capacity [K]


def exact_lambda(k_liquid: float) -> float:
    """lambda of the two-phase Stefan problem."""
    kappa_l, kappa_s = k_liquid / (RHO * C_LIQUID), K_SOLID / (RHO * C_SOLID)
    nu = math.sqrt(kappa_l / kappa_s)

    def balance(x: float) -> float:
        solid = (
            K_SOLID * (MELTING - COLD) * nu * math.exp(-((nu * x) ** 2)) / (math.sqrt(math.pi) * erfc(nu * x))
        )
        molten = k_liquid * (HELD - MELTING) * math.exp(-(x**2)) / (math.sqrt(math.pi) * erf(x))
        return float(molten - solid - RHO * LATENT * x * kappa_l)

    return float(brentq(balance, 1e-6, 3.0, xtol=1e-14))


def front(
    k_liquid: float, travelled: int, band: float = 1.0, **numerics: Any
) -> tuple[float, np.ndarray, np.ndarray]:
    """lambda, and sqrt(t) [s^0.5] at which each layer was half molten, with its distance [m]."""
    exact, kappa = exact_lambda(k_liquid), k_liquid / (RHO * C_LIQUID)
    end = ((travelled + 1) * DX / (2 * exact)) ** 2 / kappa
    reach = 2 * math.sqrt(K_SOLID / (RHO * C_SOLID) * end)
    layers = travelled + math.ceil(3.5 * reach / DX)  # erfc(3.5) = 7e-7
    metal = melting(
        solidus=MELTING - 0.5 * band, liquidus=MELTING + 0.5 * band, conductivity=(K_SOLID, k_liquid)
    )
    side = {"shape": "plate", "length": WIDTH * DX, "depth": 3 * DX, "material": "metal", "temperature": HELD}
    config = configure(
        spacing=DX, materials={"metal": metal}, physics=HEAT_ONLY, time={"end": end}, numerics=numerics,
        bodies=[side, {"shape": "box", "corner": [0, 0], "size": [WIDTH * DX, layers * DX], "material": "metal"}],
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    free = ~sim.scene.held
    layer = np.floor(sim.position[:, 1] / DX).astype(int)
    molten, times = [np.zeros(layers)], np.linspace(0.0, 1.0, 30 * travelled + 1) ** 2 * end
    for t in times[1:]:
        sim.advance(t)
        fraction = sim.state.array("liquid_fraction")
        molten.append(np.bincount(layer[free], fraction[free], layers) / WIDTH)
    table = np.array(molten)
    first = travelled // 2
    roots = [np.interp(0.5, np.maximum.accumulate(table[:, n]), np.sqrt(times)) for n in range(travelled)]
    places = (np.arange(travelled) + 0.5) * DX
    slope = float(np.polyfit(roots[first:], places[first:], 1)[0])
    return slope / (2 * math.sqrt(kappa)), np.array(roots), places


def judge(
    outcome: Outcome, k_liquid: float, number: float, limit: float, why: str, ways: tuple[int, ...]
) -> None:
    """One conductivity of the liquid."""
    exact, ratio = exact_lambda(k_liquid), f"k_l/k_s {k_liquid / K_SOLID:.3g}"
    outcome.judge(f"host lambda, {ratio}", exact, number, limit=2e-6, why="the printed digits of METHOD")
    curves = []
    for way in ways:
        found, roots, places = front(k_liquid, way)
        if way == ways[-1]:
            outcome.judge(f"lambda, {ratio}, {way} dx travelled", found, exact, limit=limit, why=why)
        else:
            outcome.show(f"lambda, {ratio}, {way} dx travelled", found, exact)
        curves.append(Curve(f"{way} dx travelled", roots / roots[-1], places / places[-1], "points"))
    found = front(k_liquid, ways[-1], BAND, latent_heat="apparent")[0]
    outcome.judge(
        f"lambda, {ratio}, apparent, {BAND:g} K, {ways[-1]} dx travelled", found, exact, limit=limit, why=why
    )
    forms: tuple[dict[str, Any], ...] = ({"latent_heat": "apparent"}, {"conduction": "harmonic"})
    for form in forms:
        name = next(iter(form.values()))
        found = front(k_liquid, ways[1], **form)[0]
        outcome.show(f"lambda, {ratio}, {name}, 1 K, {ways[1]} dx travelled", found, exact)
    kappa = k_liquid / (RHO * C_LIQUID)
    line = 2 * exact * math.sqrt(kappa) * roots
    curves.append(Curve("exact", roots / roots[-1], line / places[-1]))
    outcome.plot(f"neumann_{k_liquid / K_SOLID:.0f}", f"Melting front, {ratio}", "sqrt(t / end)",
                 "front / its last place", curves)  # fmt: skip


def compute(outcome: Outcome) -> None:
    """Equal conductivities, and the liquid's ten times the solid's."""
    judge(outcome, 20.9, 0.342112, 0.005, "what a front through 40 layers is known to: an eighth of a layer",
          (10, 20, 40))  # fmt: skip
    judge(outcome, 209.3, 0.458334, 0.015, "within the layer that melts k jumps by ten: a third of a layer of 40",
          (10, 20, 40))  # fmt: skip


def compute_short(outcome: Outcome) -> None:
    """20 dx, equal conductivities."""
    exact = exact_lambda(20.9)
    outcome.judge(
        "lambda, 16 dx travelled", front(20.9, 16)[0], exact, limit=0.01, why="a sixth of a layer of 16"
    )


CASES = [
    Case("neumann", "Two-phase melting front", "exact", "full", compute),
    Case("neumann_short", "Two-phase melting front, 16 dx", "exact", "quick", compute_short),
]
