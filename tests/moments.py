"""Moments of particles on a lattice, for tests of the analysis: what is not given is cold, solid and at rest."""

import numpy as np

from taichi_slm.analysis.recording import Moment

SOLIDUS, LIQUIDUS, MELTING, COLD = 1673.0, 1773.0, 1723.0, 293.0
DENSITY = 7000.0  # [kg/m^3]


def lattice(spacing: float, low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    """Points at (i + 1/2) dx between the corners ``low`` and ``high`` [m], shape [n, dimension]."""
    axes = [
        (np.arange(round(a / spacing), round(b / spacing)) + 0.5) * spacing
        for a, b in zip(low, high, strict=True)
    ]
    return np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)


def moment(position: np.ndarray, spacing: float, time: float = 0.0, **given: np.ndarray) -> Moment:
    """The particles at ``position``; ``temperature`` decides who is liquid, other arrays are as given."""
    count = len(position)
    temperature = given.get("temperature", np.full(count, COLD))
    wall = given.get("wall", np.zeros(count, dtype=bool))
    excess = np.where(wall, -np.inf, temperature - MELTING)
    liquid = excess >= 0.0
    mass = np.full(count, DENSITY * spacing ** position.shape[1])
    return Moment(
        time=time,
        spacing=spacing,
        id=given.get("id", np.arange(count)),
        position=position,
        velocity=given.get("velocity", np.zeros_like(position)),
        temperature=temperature,
        excess=excess,
        liquid=liquid,
        ever_liquid=given.get("ever_liquid", liquid) & ~wall,
        wall=wall,
        material=given.get("material", np.zeros(count, dtype=int)),
        tracer=given.get("tracer", np.zeros(count, dtype=int)),
        mass=mass,
        volume=mass / DENSITY,
    )
