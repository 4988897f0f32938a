"""What several test files share: configs from plain dictionaries, a few materials, a tiny laser track.

Only one Simulation lives at a time (building one resets Taichi), so fixtures hand out configs and numpy results,
never a simulation.
"""

from collections.abc import Callable
from typing import Any

import pytest

from taichi_slm.config.schema import Config

UM = 1e-6

OFF = {"surface_tension": False, "marangoni": False, "radiation": False, "viscous_heating": False}


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes`` laid over it, mapping by mapping."""
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        result[key] = merged(old, value) if isinstance(value, dict) and isinstance(old, dict) else value
    return result


def liquid(density: Any = 1000.0, **laws: Any) -> dict[str, Any]:
    """A material without a solid; every law is a constant, or a mapping of the config."""
    constants = {"density": density, "heat_capacity": 1000.0, "conductivity": 1.0, "viscosity": 1e-3, **laws}
    material: dict[str, Any] = {"maximum_temperature": 5000}
    for name, value in constants.items():
        phase = name in ("density", "heat_capacity", "conductivity", "viscosity")
        law = value if isinstance(value, dict) else {"constant": value}
        if name in ("emissivity", "absorptivity", "maximum_temperature"):
            material[name] = value
        else:
            material[name] = {"liquid": law} if phase else law
    return material


@pytest.fixture(scope="session")
def configure() -> Callable[..., Config]:
    """A config from keyword arguments; 2-D, and one second long, unless they say otherwise."""

    def build(**keys: Any) -> Config:
        return Config.model_validate(merged({"dimension": 2, "time": {"end": 1.0}}, keys))

    return build


@pytest.fixture(scope="session")
def track() -> Callable[..., Config]:
    """A tiny melting track of 584 particles: plate 0.2 x 0.06 mm, two grains, 60 W; changes laid over it."""
    base = {
        "dimension": 2,
        "spacing": 5 * UM,
        "bodies": [
            {"shape": "plate", "length": 200 * UM, "depth": 60 * UM},
            {"shape": "powder_row", "start": 50 * UM, "length": 80 * UM, "radius": 20 * UM},
        ],
        "laser": {
            "power": 60,
            "beam_radius": 30 * UM,
            "absorptivity": 0.35,
            "path": [{"kind": "line", "start": [60 * UM], "end": [120 * UM], "speed": 2.0}],
        },
        "time": {"end": 30e-6},
    }

    def build(**keys: Any) -> Config:
        return Config.model_validate(merged(base, keys))

    return build
