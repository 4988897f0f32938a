"""Scenes drawn at random from the whole schema: each ends accounted for, or is refused in a sentence.

Every key of every section can be drawn. What has a default is drawn around it; the sizes of things hang on the
spacing, so that a scene has some hundred particles; a key without default that is not in ``SIZES`` fails the draw.
"""

import math
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from pydantic_core import PydanticUndefined

from taichi_slm.config import schema
from taichi_slm.config.load import load_config
from taichi_slm.config.material import MaterialOverride
from taichi_slm.errors import BlowUpError, ConfigError
from taichi_slm.materials.library import alloy_names
from taichi_slm.run.simulation import Simulation

UM = 1e-6
STEPS = 300  # a scene that takes more is left at peace: it has been through heating, melting or its fall
DRAWN: set[tuple[str, str]] = set()  # (model, key), to see that none is forgotten


def real(low, high):
    """Without the 1e-300 that hypothesis loves: that is refused at reading, and the fuzz tests ask for it."""
    # Taichi switches subnormal numbers off in its process, and hypothesis refuses to draw any then
    return st.floats(low, high, allow_subnormal=False).map(lambda x: round(x, 3))


def log(low, high):
    return real(math.log10(low), math.log10(high)).map(lambda x: 10**x)


def around(value):
    """Numbers near a default, and what lies far from it."""
    if isinstance(value, int):
        return st.one_of(st.just(value), st.integers(max(value - 3, 0), value + 5))
    return st.one_of(log(0.5, 2), log(0.1, 10)).map(lambda factor: factor * value) if value else log(1e-3, 1)


@st.composite
def of(draw, model, given, likely=0.3):
    """A mapping of ``model``: what is required, and some of the rest; ``given``: strategies by key."""
    found = {}
    for key, field in model.model_fields.items():
        if not field.is_required() and draw(real(0, 1)) > likely:
            continue
        DRAWN.add((model.__name__, key))
        if key in given:
            found[key] = draw(given[key])
        elif get_origin(field.annotation) is Literal:
            found[key] = draw(st.sampled_from(get_args(field.annotation)))
        elif field.annotation is bool:
            found[key] = draw(st.sampled_from((True, True, False)))
        else:
            default = field.get_default(call_default_factory=True)
            assert default not in (None, PydanticUndefined), (model, key)
            found[key] = draw(around(default))
    return found


@st.composite
def scenes(draw, complete=False) -> dict[str, Any]:
    """A scene; ``complete``: with every shape of body, and every key of every section."""

    def part(model, given, likely=0.3):
        return of(model, given, 1.0 if complete else likely)

    d, dx = draw(st.sampled_from((2, 2, 2, 3))), draw(st.sampled_from((5, 8, 12))) * UM
    end = draw(log(1e-7, 2e-5))

    def size(low, high):
        return real(low, high).map(lambda x: x * dx)

    def place(low, high, n=d):
        return st.lists(size(low, high), min_size=n, max_size=n)

    long = 20 if d == 2 else 9
    names = st.sampled_from((*alloy_names(), "own"))
    temperature = st.sampled_from((293, 293, 600, 1700, 1900, 3000))
    ramp = part(schema.RampProgram, {"points": st.just([[0, 293], [0.5 * end, 2500], [end, 300]])})
    sine = part(
        schema.SineProgram, {"mean": temperature, "amplitude": real(0, 1), "frequency": log(1e3, 1e6)}
    )
    body = {
        "material": names,
        "temperature": temperature,
        "velocity": st.lists(real(-5, 5), min_size=d, max_size=d),
        "program": st.one_of(ramp, sine),
    }
    sizes = {"length": size(6, long), "depth": size(4, 8), "radius": size(0.4, 4), "size": place(1, 7),
             "corner": place(-2, 6), "centre": place(0, 9), "height": size(2, 8), "mean_radius": size(1, 2.5),
             "std_radius": size(0, 0.5), "min_radius": size(0.7, 2), "max_radius": size(1.5, 3), "start": size(-2, 4),
             "materials": st.lists(names, min_size=1, max_size=3), "tracers": st.lists(st.integers(0, 3), min_size=1),
             "fractions": st.lists(real(0, 1), min_size=1, max_size=3), "layers": st.integers(1, 3),
             "stretch": real(-0.5, 0.5), "rows": st.integers(1, 2)}  # fmt: skip
    if d == 3:
        sizes["width"] = size(4, 8)

    def some(model, likely=0.25):
        return part(model, {"width": st.none(), **body, **sizes}, likely).map(
            lambda found: found if d == 2 or "width" not in model.model_fields else {"width": 6 * dx, **found}
        )

    plate = some(schema.Plate)
    others = [
        some(kind)
        for kind in (schema.PowderRow, schema.PowderBed, schema.Droplet, schema.Box, schema.Container)
    ]
    if complete:  # one of every shape: hypothesis may leave one out of forty draws
        bodies = [draw(each) for each in (plate, *others)]
    else:
        bodies = [draw(plate)] if draw(st.integers(0, 9)) else []
        bodies += draw(st.lists(st.one_of(others), min_size=not bodies, max_size=2 if d == 2 else 1))
    spot = st.lists(size(-1, long), min_size=1, max_size=1).map(lambda x: x + [0.0] * (d - 2))
    fraction = {"power_fraction": real(0, 2)}
    move = part(schema.Move, {"start": spot, "end": spot, "speed": log(0.1, 100), **fraction})
    dwell = part(schema.Dwell, {"at": spot, "duration": log(1e-8, 2e-5), **fraction})
    pulse = part(schema.Pulse, {"on": log(1e-9, 1e-5), "off": log(1e-9, 1e-5)})
    laser = part(
        schema.Laser,
        {"power": log(1, 1000), "beam_radius": size(1, 6), "absorptivity": real(0, 1), "pulse": pulse,
         "absorption_depth": size(0.5, 4), "bin_size": size(0.5, 2), "start": log(1e-9, 1e-5),
         "path": st.lists(st.one_of(move, dwell), min_size=1, max_size=3)},
    )  # fmt: skip
    interval = log(0.02, 2).map(lambda x: x * end)
    every = {
        "title": st.text(max_size=20),
        "dimension": st.just(d),
        "spacing": st.just(dx),
        "ambient_temperature": temperature,
        "gravity": st.sampled_from((9.81, 0.0, 1e4)),
        "materials": st.just({}),
        "bodies": st.just(bodies),
        "domain": st.just({"lower": [-30 * dx] * d, "upper": [40 * dx] * d}),
        "laser": laser,
        "physics": part(schema.Physics, {}, 0.15),
        "numerics": part(
            schema.Numerics,
            {"sound_speed": st.sampled_from((5, 20, 50)), "maximum_step": log(1e-9, 1e-6), "shifting": real(0, 1),
             "minimum_neighbours": st.integers(0, 8), "heat_stages": st.integers(3, 31),
             "surface_every": st.integers(1, 4), "fixed_point_sweeps": st.integers(1, 4)},
            0.15,
        ),
        "performance": part(schema.Performance, {"heat_steps_at_most": st.integers(1, 100)}, 0.15),
        "time": part(schema.RunTime, {"end": st.just(end), "wall_limit": log(1, 1e3)}),
        "output": part(
            schema.Output,
            {"history_interval": interval, "snapshot_interval": interval, "checkpoint_interval": interval,
             "checkpoint_steps": st.integers(1, 1000), "temperature_range": st.just([300, 3000]),
             "images": st.lists(st.sampled_from(get_args(schema.Picture)), max_size=2)},
            0.2,
        ),
    }  # fmt: skip
    found = draw(part(schema.Config, every, 0.7))
    own = {"extends": st.sampled_from(alloy_names()), "description": st.text(max_size=9), "sources": st.just({}),
           "solidus": real(1300, 1750), "liquidus": real(1600, 1950), "latent_heat": log(1e3, 1e6),
           "emissivity": real(0, 1), "absorptivity": real(0, 1), "maximum_temperature": real(2000, 9000),
           "mushy_viscosity_factor": log(1, 1e3), "surface_tension": st.just({"constant": 1.5}),
           "evaporation": st.just({"latent_heat": 6e6, "molar_mass": 0.056, "boiling_temperature": 3000}),
           "scale": st.dictionaries(st.sampled_from(("density", "conductivity", "surface_tension")), log(0.3, 3)),
           **dict.fromkeys(("density", "heat_capacity", "conductivity", "viscosity"), st.none())}  # fmt: skip
    if '"own"' in repr(found).replace("'", '"'):
        found["materials"] = {"own": {"extends": "steel_304", **draw(part(MaterialOverride, own, 0.2))}}
    return found


def settled(examples):
    return settings(max_examples=examples, deadline=None, derandomize=True, database=None,
                    phases=[Phase.generate], suppress_health_check=list(HealthCheck))  # fmt: skip


def test_what_is_drawn_is_the_whole_schema():
    """Or the test below would look at a corner of it."""

    @settled(40)
    @given(found=scenes(complete=True))
    def draw(found):
        assert found

    DRAWN.clear()
    draw()
    models = (schema.Config, schema.RunTime, schema.Output, schema.Laser, schema.Pulse, schema.Move, schema.Dwell,
              schema.Physics, schema.Numerics, schema.Performance, schema.Plate, schema.PowderRow, schema.PowderBed,
              schema.Droplet, schema.Box, schema.Container, schema.RampProgram, schema.SineProgram,
              MaterialOverride)  # fmt: skip
    assert {(model.__name__, key) for model in models for key in model.model_fields} <= DRAWN


def ends(found):
    """Whether ``found`` was run; it must be accounted for then, and else refused in a sentence."""
    refused = ""
    try:
        sim = Simulation(load_config(found).config, threads=1)
        while not sim.finished and sim.steps < STEPS:
            sim.step()
    except (BlowUpError, ConfigError) as refusal:
        refused = str(refusal)
    if refused:
        assert len(refused) > 20
        return False
    row = sim.diagnostics()
    assert all(math.isfinite(value) for value in row.values() if isinstance(value, float))
    assert all(np.isfinite(values).all() for values in sim.arrays().values())
    assert row["mass_error"] < 1e-11
    if sim.config.numerics.latent_heat == "enthalpy":  # the apparent heat capacity loses some, and says so
        # what README promises; the rim of the hot set keeps a thousandth of a kelvin, of no heat to speak of
        assert row["energy_error"] < 1e-3 or sim.accounts.books().unexplained < 0.1 * sim.initial_mass
    return True


@pytest.mark.parametrize("runs", [2, pytest.param(40, marks=pytest.mark.slow)])
def test_there_is_no_third_ending(runs):
    """As many draws as it takes for ``runs`` scenes that are no refusal at reading."""
    done = []

    @settled(20 * runs)
    @given(found=scenes())
    def draw(found):
        if len(done) == runs:
            return
        try:
            load_config(found)
        except ConfigError:
            return
        done.append(ends(found))

    draw()
    assert len(done) == runs
    assert any(done)
