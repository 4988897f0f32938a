"""A hundred times melted and frozen by known heat: temperature and liquid fraction follow, and no heat is lost.

Scene    a block without exchange, melting between 1673 and 1773 K, L 2.6e5; the laser's field of powers is loaded with
         the same heat for each particle and the heat passes take it in, 11 steps up and 11 down, between 1473 and
         2173 K; the steps do not meet the solidus or the liquidus
Exact    with Q the heat given so far: T rises by Q/c_s in the solid, by Q/((c_s + c_l)/2 + L/dT) in the band (39), and
         by Q/c_l in the liquid; the liquid fraction is the part of the band that has been crossed (40)
Measured after every step T and the liquid fraction; after 100 cycles the enthalpy over the heat of a melting
Remarks  the enthalpy form is exact for any step. The apparent heat capacity (39) steps over parts of the band: shown
         beside with the same 22 steps a cycle and with five times as many.
"""

import math

import numpy as np

from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.scenes import HEAT_ONLY, configure, melting

SOLIDUS, LIQUIDUS, LATENT, C_SOLID, C_LIQUID = 1673.0, 1773.0, 2.6e5, 711.2, 937.4
START, CYCLES = 1473.0, 100
IN_SOLID = C_SOLID * (SOLIDUS - START)  # [J/kg] from the start to the solidus
IN_BAND = 0.5 * (C_SOLID + C_LIQUID) * (LIQUIDUS - SOLIDUS) + LATENT
WHOLE = IN_SOLID + IN_BAND + C_LIQUID * 400.0  # to 2173 K
# portions of heat are given where a laser's would be; it shines on nothing itself
NEVER_ON = {"power": 1.0, "beam_radius": 1e-5, "absorptivity": 1.0, "absorption_depth": 1e-5,
            "path": [{"kind": "dwell", "at": [1.0], "duration": 1e-9}]}  # fmt: skip


def temperature(heat: np.ndarray) -> np.ndarray:
    """T [K] after ``heat`` [J/kg] from the start."""
    inside = np.clip(heat - IN_SOLID, 0.0, IN_BAND)
    band = (LIQUIDUS - SOLIDUS) * inside / IN_BAND
    return np.asarray(
        np.minimum(START + heat / C_SOLID, SOLIDUS)
        + band
        + np.maximum(heat - IN_SOLID - IN_BAND, 0.0) / C_LIQUID
    )


def cycles(latent_heat: str, count: int, steps: int) -> dict[str, np.ndarray]:
    """Heat given, temperature, liquid fraction and enthalpy since the start, after every step of ``count`` cycles."""
    config = configure(
        spacing=5e-6, materials={"metal": melting()}, physics=HEAT_ONLY, ambient_temperature=START,
        numerics={"latent_heat": latent_heat, "heat_scheme": "heun"}, performance={"skip_cold": False},
        bodies=[{"shape": "box", "corner": [0, 0], "size": [2e-5, 2e-5], "material": "metal", "temperature": START}],
        laser=NEVER_ON,
    )  # fmt: skip
    sim = Simulation(config, threads=1)
    sim.compile()
    assert sim.heat is not None
    mass, before = sim.state.array("mass"), sim.state.array("enthalpy")[0]
    dt, given = 1e-9, 0.0
    found: dict[str, list[float]] = {
        name: [] for name in ("heat", "temperature", "liquid_fraction", "enthalpy")
    }
    half = steps // 2
    for step in range(count * 2 * half):
        portion = WHOLE / half * (1.0 if step % (2 * half) < half else -1.0)
        given = WHOLE * (1 - abs((step + 1) % (2 * half) / half - 1))
        sim.state.load(laser=mass * portion / dt)
        sim.heat.step(dt, True, dt)
        found["heat"].append(given)
        found["enthalpy"].append(sim.state.array("enthalpy").mean() - before)
        found["temperature"].append(sim.temperature.mean())
        found["liquid_fraction"].append(sim.state.array("liquid_fraction").mean())
    return {name: np.array(values) for name, values in found.items()}


def compute(outcome: Outcome) -> None:
    """Enthalpy for 100 cycles; the apparent heat capacity beside."""
    found = cycles("enthalpy", CYCLES, 22)
    drift = float(np.abs(found["enthalpy"] - found["heat"]).max() / (IN_BAND))
    outcome.judge("heat lost in 100 cycles, of one melting", drift, error=drift, limit=1e-10,
                  why="2200 additions of doubles")  # fmt: skip
    exact = temperature(found["heat"])
    off = float(np.abs(found["temperature"] - exact).max())
    outcome.judge("T - H^-1(Q), worst", off, error=off, limit=1e-8, unit="K",
                  why="an enthalpy of 2e6 J/kg to 1e-15 a step, 2200 times, over c")  # fmt: skip
    fraction = np.clip((exact - SOLIDUS) / (LIQUIDUS - SOLIDUS), 0, 1)
    off = float(np.abs(found["liquid_fraction"] - fraction).max())
    outcome.judge("liquid fraction, worst", off, error=off, limit=1e-10, why="it follows from T over 100 K")
    curves = [Curve("exact", found["heat"][:11], exact[:11]),
              Curve("enthalpy", found["heat"][-22:], found["temperature"][-22:], "points")]  # fmt: skip
    for steps in (22, 110):
        other = cycles("apparent", 2, steps)
        missed = float(np.abs(other["enthalpy"] - other["heat"]).max() / IN_BAND)
        outcome.show(f"apparent heat capacity, {steps} steps a cycle: heat missed of one melting", missed)
        if steps == 22:
            curves.append(Curve("apparent", other["heat"][:22], other["temperature"][:22], "dashed"))
    assert math.isclose(float(exact.max()), 2173.0)
    outcome.plot(
        "adiabatic_cycles", "Melted and frozen by known heat", "heat [J/kg]", "temperature [K]", curves
    )


CASES = [
    Case("adiabatic_cycles", "A hundred adiabatic cycles of melting and freezing", "exact", "quick", compute)
]
