"""The scenes that are timed: a melting track of any plate, a drop of any resolution."""

from typing import Any

import numpy as np

from taichi_slm.config.schema import Config
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.scenes import configure, merged

UM = 1e-6


def track(grains: int = 6, plate: float = 1.0, duration: float = 60e-6, spacing: float = 4 * UM,
          **changes: Any) -> Config:  # fmt: skip
    """A beam of 150 W over a row of grains (2-D, steel 304) for ``duration`` [s]; a plate of ``plate`` times 100 um."""
    length = grains * 50 * UM
    scene = {
        "spacing": spacing,
        "bodies": [
            {"shape": "plate", "start": -100 * UM, "length": length + 200 * UM, "depth": 100 * UM * plate},
            {"shape": "powder_row", "length": length, "radius": 25 * UM},
        ],
        "laser": {"power": 150, "beam_radius": 54 * UM, "absorptivity": 0.75, "absorption_depth": 1.5 * spacing,
                  "path": [{"kind": "line", "start": [40 * UM], "end": [length], "speed": 2.0}]},
        "numerics": {"sound_speed": 20},
        "time": {"end": duration},
    }  # fmt: skip
    return configure(**merged(scene, changes))


def weld(width: float) -> Config:
    """A beam of 100 W that stands on a steel plate of ``width`` [m] and 100 um (3-D, spacing 5 um)."""
    return configure(
        dimension=3, spacing=5 * UM, numerics={"sound_speed": 20}, time={"end": 1e-3},
        physics={"evaporation": True, "recoil": True},
        bodies=[{"shape": "plate", "start": -0.5 * width, "length": width, "width": width, "depth": 100 * UM}],
        laser={"power": 100, "beam_radius": 50 * UM, "absorptivity": 0.4,
               "path": [{"kind": "dwell", "at": [0.0, 0.0], "duration": 1e-3}]},
    )  # fmt: skip


def drop(resolution: int = 40, end: float = 1e-4, dimension: int = 2, **changes: Any) -> Config:
    """A liquid steel drop of R 50 um with heat, surface tension and Marangoni flow; ``resolution`` is R/dx."""
    scene = {
        "dimension": dimension,
        "spacing": 50 * UM / resolution,
        "bodies": [{"shape": "droplet", "material": "steel_304", "centre": dimension * [0.0], "radius": 50 * UM,
                    "temperature": 2400.0}],
        "physics": {"radiation": False, "viscous_heating": False},
        "numerics": {"sound_speed": 50},
        "time": {"end": end},
    }  # fmt: skip
    return configure(**merged(scene, changes))


def warm(sim: Simulation) -> None:
    """Give the drop a gradient of temperature, so that it conducts and flows [K]: 200 K across its radius."""
    sim.impose(2400.0 + 200.0 * np.asarray(sim.position)[:, 0] / (50 * UM))
