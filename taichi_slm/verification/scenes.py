"""What the cases build their scenes from: configs from plain mappings, metals of a few numbers."""

from typing import Any

from taichi_slm.config.schema import Config

_BY_PHASE = ("density", "heat_capacity", "conductivity", "viscosity")
FLOW_ONLY: dict[str, Any] = {
    "heat": False, "surface_tension": False, "marangoni": False, "radiation": False, "viscous_heating": False,
}  # fmt: skip
HEAT_ONLY: dict[str, Any] = {"flow": False, "radiation": False}


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes`` laid over it, mapping by mapping."""
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        result[key] = merged(old, value) if isinstance(value, dict) and isinstance(old, dict) else value
    return result


def configure(**keys: Any) -> Config:
    """A config from keyword arguments as in a YAML file; 2-D, and one second long, unless they say otherwise."""
    return Config.model_validate(merged({"dimension": 2, "time": {"end": 1.0}}, keys))


def metal(**laws: Any) -> dict[str, Any]:
    """A material from numbers (a constant law), pairs of numbers (solid, liquid) and mappings (as in a config)."""
    material: dict[str, Any] = {}
    for name, value in laws.items():
        if name in _BY_PHASE and not isinstance(value, dict):
            pair = value if isinstance(value, tuple) else (None, value)
            material[name] = {
                phase: {"constant": number}
                for phase, number in zip(("solid", "liquid"), pair, strict=True)
                if number is not None
            }
        elif name == "surface_tension" and not isinstance(value, dict):
            material[name] = {"constant": value}
        else:
            material[name] = value
    return material


def liquid(**laws: Any) -> dict[str, Any]:
    """A material without a solid, of constant properties unless they say otherwise."""
    plain = {"density": 1000, "heat_capacity": 1000, "conductivity": 1, "viscosity": 1e-3}
    return metal(**{**plain, "maximum_temperature": 5000, **laws})


def melting(**laws: Any) -> dict[str, Any]:
    """A metal that melts between 1673 and 1773 K, its properties constant in either phase (METHOD, exact answers)."""
    plain = {
        "solidus": 1673, "liquidus": 1773, "latent_heat": 2.6e5, "density": 7200, "heat_capacity": (711.2, 937.4),
        "conductivity": 20.9, "viscosity": 0.006, "maximum_temperature": 6000,
    }  # fmt: skip
    return metal(**{**plain, **laws})
