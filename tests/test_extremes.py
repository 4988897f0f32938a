"""Scenes at the edge of sense: each ends in a finite, accounted result or in a plain refusal, never in a third way."""

import json
import math

import numpy as np
import pytest
from conftest import TRACK, UM, merged

from taichi_slm.config.load import load_config
from taichi_slm.errors import BlowUpError, ConfigError
from taichi_slm.run.simulation import Simulation
from taichi_slm.verification.scenes import FLOW_ONLY

PLATE = [{"shape": "plate", "length": 200 * UM, "depth": 60 * UM}]
ONE = {"shape": "box", "corner": [0, 0], "size": [5 * UM, 5 * UM], "temperature": 2000}
DROP = {"shape": "droplet", "radius": 25 * UM, "temperature": 2000}


def track(**changes):
    return merged(TRACK, changes)


def free(*bodies, **changes):
    """A scene without a beam."""
    return merged(
        {"dimension": 2, "spacing": 5 * UM, "bodies": list(bodies), "time": {"end": 20e-6}}, changes
    )


def steel(**laws):
    """Plate and grains of steel with other ``laws``."""
    bodies = [{**body, "material": "a"} for body in TRACK["bodies"]]
    return {"materials": {"a": {"extends": "steel_304", **laws}}, "bodies": bodies}


def line(speed, start=60, end=120):
    return {"path": [{"kind": "line", "start": [start * UM], "end": [end * UM], "speed": speed}]}


SCENES = {
    "no power": track(laser={"power": 0}),
    "1 W": track(laser={"power": 1}),
    "10 kW": track(laser={"power": 1e4}),
    "a pulse of 1 ns": track(laser={"pulse": {"on": 1e-9, "off": 1e-3}}),
    "a beam that stands": track(laser={"path": [{"kind": "dwell", "at": [80 * UM], "duration": 30e-6}]}),
    "50 m/s": track(laser=line(50.0)),
    "a grain is one particle": track(
        spacing=40 * UM, bodies=[{"shape": "plate", "length": 200 * UM, "depth": 240 * UM}, TRACK["bodies"][1]]
    ),
    "one particle": free(ONE, numerics={"minimum_neighbours": 0}),
    "one particle, removed": free(ONE),
    "a drop onto the plate at 10 m/s": free(
        *PLATE, {**DROP, "centre": [100 * UM, 30 * UM], "velocity": [0.0, -10.0]}
    ),
    "conductivity ratio 1e4": track(
        **steel(conductivity={"solid": {"constant": 0.02}, "liquid": {"constant": 200}})
    ),
    "density jump of 10": track(
        materials={"a": {"extends": "steel_304", "density": {"solid": {"constant": 800}, "liquid": {"constant": 700}}}},
        bodies=[TRACK["bodies"][0], {**TRACK["bodies"][1], "material": "a"}],
    ),
    "ten times dsigma/dT, reversed": track(
        **steel(surface_tension={"line": {"value": 1.6, "slope": 4e-3, "at": 1700}})
    ),
    "a melting band of 1 K": track(
        **steel(liquidus=1674.0)
    ),
    "it starts molten": track(bodies=[{**body, "temperature": 2200} for body in TRACK["bodies"]], time={"end": 10e-6}),
    "it starts beyond every table": track(bodies=[{**body, "temperature": 2e4} for body in TRACK["bodies"]]),
    "a particle in the corner of the box": free(
        *PLATE, {**DROP, "centre": [100 * UM, 40 * UM]},
        domain={"lower": [0.0, -60 * UM], "upper": [200 * UM, 62.5 * UM]},
    ),
    "a beam that leaves the bed": track(laser=line(20.0, 60, 400)),
    "ten passes over a line": track(
        laser={**line(10.0, 80, 100), "passes": 10},
    ),
    "two drops in one place": free({**DROP, "centre": [0.0, 0.0]}, {**DROP, "centre": [1 * UM, 0.0]}),
    "ten times as long as needed": track(laser={"power": 20}, time={"end": 3e-3}),
}  # fmt: skip


REFUSED = {  # what is said instead of a result
    "10 kW": "particle [0-9]+ is at [0-9]+ K, beyond the end of the property tables",
    "it starts beyond every table": "20000 K is not below the end of the tables",
    "two drops in one place": "overlaps",
}


def accounted(sim):
    """Everything finite, every account closed to round-off: nothing has come or gone unseen."""
    row = sim.diagnostics()
    assert all(math.isfinite(value) for value in row.values() if isinstance(value, float))
    assert all(np.isfinite(values).all() for values in sim.arrays().values())
    assert row["mass_error"] < 1e-12
    assert row["momentum_error"] < 1e-12
    # a thousandth of a kelvin at the rim of the hot set, of little heat; or round-off of a scene that exchanges none
    assert row["energy_error"] < 1e-5 or abs(row["stored_J"]) < 1e-14
    return row


QUICK = (
    "10 kW",
    "density jump of 10",
    "ten times dsigma/dT, reversed",
    "a drop onto the plate at 10 m/s",
    "one particle",
)


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SCENES]
)
def test_it_ends_accounted_for_or_is_refused(name, tmp_path):
    (tmp_path / "scene.yaml").write_text(json.dumps(SCENES[name]))

    def run():
        sim = Simulation(load_config(tmp_path / "scene.yaml").config)
        sim.run()
        return sim

    if name in REFUSED:
        with pytest.raises((BlowUpError, ConfigError), match=REFUSED[name]):
            run()
    else:
        sim = run()
        accounted(sim)
        assert sim.finished


def test_two_particles_in_one_place(configure, liquid):
    """No list, no force and no gradient is infinite between them; that they part is not asked for."""
    metal = liquid(density=7000, viscosity=0.006, surface_tension=1.8)
    body = {"shape": "droplet", "centre": [0.0, 0.0], "radius": 30 * UM, "material": "metal"}
    config = configure(spacing=5 * UM, materials={"metal": metal}, bodies=[body], time={"end": 10e-6},
                       physics={**FLOW_ONLY, "surface_tension": True})  # fmt: skip
    sim = Simulation(config)
    x = sim.position
    x[1] = x[0]
    sim.state.load(position=x)
    sim.run()
    accounted(sim)


def test_a_scene_too_fine_for_any_memory_is_refused_before_it_is_built(tmp_path):
    block = {"shape": "plate", "length": 200 * UM, "width": 200 * UM, "depth": 60 * UM}
    fine = {"dimension": 3, "spacing": 0.02 * UM, "bodies": [block], "time": {"end": 1e-6}}
    (tmp_path / "scene.yaml").write_text(json.dumps(fine))
    with pytest.raises(ConfigError, match="about 3e\\+11 particles, more than 50,000,000"):
        load_config(tmp_path / "scene.yaml")
