"""What several test files share: configs from plain dictionaries, a few materials, a tiny laser track.

Only one Simulation lives at a time (building one resets Taichi), so fixtures hand out configs and numpy results,
never a simulation.
"""

import subprocess
import sys
from collections.abc import Callable
from typing import Any, Literal, get_args, get_origin

import pytest
from fake_run import FakeSimulation
from rich.console import Console

from taichi_slm.config.schema import Config
from taichi_slm.run import driver
from taichi_slm.run.pictures import GL_PACKAGES

UM = 1e-6
TRACK: dict[str, Any] = {
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


def choices(model: Any) -> dict[str, list[Any]]:
    """Field -> its values, of every field of a config that is a choice between words or a switch."""
    found: dict[str, list[Any]] = {}
    for name, field in model.model_fields.items():
        if get_origin(field.annotation) is Literal:
            found[name] = list(get_args(field.annotation))
        elif field.annotation is bool:
            found[name] = [False, True]
    return found


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes`` laid over it, mapping by mapping."""
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        result[key] = merged(old, value) if isinstance(value, dict) and isinstance(old, dict) else value
    return result


def phase_laws(**laws: Any) -> dict[str, Any]:
    """A material from numbers (a constant law), pairs of numbers (solid and liquid) and mappings (as in a config)."""
    material: dict[str, Any] = {}
    for name, value in laws.items():
        if name in ("density", "heat_capacity", "conductivity", "viscosity") and not isinstance(value, dict):
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


@pytest.fixture(scope="session")
def liquid() -> Callable[..., dict[str, Any]]:
    """A material without a solid, of constant properties unless they say otherwise."""
    plain = {"density": 1000, "heat_capacity": 1000, "conductivity": 1, "viscosity": 1e-3}
    return lambda **laws: phase_laws(**{**plain, "maximum_temperature": 5000, **laws})


@pytest.fixture(scope="session")
def melting() -> Callable[..., dict[str, Any]]:
    """A metal that melts between 1673 and 1773 K, its properties constant in either phase (METHOD, exact answers)."""
    plain = {
        "solidus": 1673, "liquidus": 1773, "latent_heat": 2.6e5, "density": 7200, "heat_capacity": (711.2, 937.4),
        "conductivity": 20.9, "viscosity": 0.006, "maximum_temperature": 6000,
    }  # fmt: skip
    return lambda **laws: phase_laws(**{**plain, **laws})


@pytest.fixture(scope="session")
def configure() -> Callable[..., Config]:
    """A config from keyword arguments; 2-D, and one second long, unless they say otherwise."""

    def build(**keys: Any) -> Config:
        return Config.model_validate(merged({"dimension": 2, "time": {"end": 1.0}}, keys))

    return build


@pytest.fixture(scope="session")
def track() -> Callable[..., Config]:
    """A tiny melting track of 584 particles: plate 0.2 x 0.06 mm, two grains, 60 W; changes laid over it."""

    def build(**keys: Any) -> Config:
        return Config.model_validate(merged(TRACK, keys))

    return build


@pytest.fixture
def console(tmp_path):
    """What a run says, in the file said.txt."""
    with open(tmp_path / "said.txt", "w") as file:
        yield Console(file=file)


@pytest.fixture
def fake(monkeypatch) -> None:
    """Runs have the comet for a solver."""
    monkeypatch.setattr(driver, "_build", lambda config, *_: FakeSimulation(config))


PROBE = (
    "import pyvista; p = pyvista.Plotter(off_screen=True, window_size=[8, 8]); p.screenshot(return_img=True)"
)


@pytest.fixture(scope="session")
def gl() -> None:
    """Pictures can be made here; a test that asks for this is skipped where they cannot."""
    probe = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, check=False)
    if probe.returncode != 0:
        pytest.skip(f"no OpenGL library on this machine (apt install {GL_PACKAGES})")
