"""Scenes drawn at random from the schema: each ends accounted for, or is refused in a sentence."""

import json
import math
import random

import numpy as np
import pytest
from conftest import choices

from taichi_slm.config.load import load_config
from taichi_slm.config.numerics import Numerics
from taichi_slm.errors import BlowUpError, ConfigError
from taichi_slm.materials.library import alloy_names
from taichi_slm.run.simulation import Simulation

UM = 1e-6
FORMS = {
    name: values for name, values in choices(Numerics).items() if True not in values
}  # words, no switches
PHYSICS = (
    {}, {}, {"marangoni": False}, {"radiation": False}, {"evaporation": True, "recoil": True}, {"evaporation": True},
    {"surface_tension": False, "marangoni": False}, {"flow": False}, {"viscous_heating": False}, {"recoil": True},
)  # fmt: skip


def scene(rng):
    """A scene of some hundred particles; every part of it may be odd, and some of it does not fit together."""
    d = rng.choice((2, 2, 2, 3))
    spacing = rng.choice((5, 8, 12)) * UM
    length = rng.uniform(8, 24 if d == 2 else 10) * spacing
    plate = {"shape": "plate", "length": length, "depth": rng.uniform(4, 8) * spacing}
    if d == 3:
        plate |= {"width": rng.uniform(5, 9) * spacing}
    bodies = [plate] if rng.random() < 0.9 else []
    if rng.random() < 0.6:
        centre = [rng.uniform(0, length), *([0.0] * (d - 2)), rng.uniform(1, 12) * spacing]
        bodies.append({"shape": "droplet", "centre": centre, "radius": rng.uniform(0.4, 4) * spacing,
                       "velocity": [rng.uniform(-5, 5) for _ in range(d)], "arrangement": "lattice",
                       "temperature": rng.choice((293, 1700, 1900, 3000))})  # fmt: skip
    for body in bodies:
        body["material"] = rng.choice(alloy_names())
        if rng.random() < 0.2:
            body["temperature"] = rng.uniform(200, 2500)
    found = {
        "dimension": d, "spacing": spacing, "bodies": bodies, "gravity": rng.choice((9.81, 0.0, 1e4)),
        "time": {"end": 10 ** rng.uniform(-7, -4.7)}, "seed": rng.randrange(100),
        "physics": rng.choice(PHYSICS),
        "numerics": {name: rng.choice(FORMS[name]) for name in rng.sample(sorted(FORMS), 4)},
    }  # fmt: skip
    found["numerics"]["sound_speed"] = rng.choice((5, 20, 50))
    if rng.random() < 0.8:
        path = {"kind": "line", "start": [rng.uniform(-0.2, 1) * length], "end": [rng.uniform(0, 1.2) * length],
                "speed": 10 ** rng.uniform(-1, 2)}  # fmt: skip
        for end in ("start", "end"):
            path[end] += [0.0] * (d - 2)
        found["laser"] = {
            "power": 10 ** rng.uniform(0, 3),
            "beam_radius": rng.uniform(1, 6) * spacing,
            "absorptivity": rng.random(),
            "profile": rng.choice(("gaussian", "top_hat")),
            "path": [path],
        }
    if rng.random() < 0.3:
        found["performance"] = {
            rng.choice(("skip_solid", "skip_cold", "skip_interior", "heat_clock", "keep_neighbours")): False
        }
    return found


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(n, marks=pytest.mark.slow) for n in range(2, 16))])
def test_there_is_no_third_ending(tmp_path, seed):
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps(scene(random.Random(seed)), indent=1))
    refused = ""
    try:
        sim = Simulation(load_config(path).config)
        sim.run()
    except (BlowUpError, ConfigError) as refusal:
        refused = str(refusal)
    if refused:
        assert len(refused) > 20
        return
    row = sim.diagnostics()
    assert all(math.isfinite(value) for value in row.values() if isinstance(value, float))
    assert all(np.isfinite(values).all() for values in sim.arrays().values())
    assert row["mass_error"] < 1e-11
    if (
        sim.config.numerics.latent_heat == "enthalpy"
    ):  # the apparent heat capacity loses some, and its account says so
        assert (
            row["energy_error"] < 1e-3
        )  # what README promises; the rim of the hot set keeps a thousandth of a kelvin
