"""Every form that a config may choose compiles and runs; what may be skipped or split changes nothing that counts."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from conftest import choices

from taichi_slm.analysis.melt_pool import measure
from taichi_slm.config.load import load_config
from taichi_slm.config.numerics import Numerics, Performance, Physics
from taichi_slm.run.simulation import Simulation
from taichi_slm.scene.build import build_scene

UM = 1e-6
CONFIGS = Path(__file__).parents[1] / "configs"
MELTING = 1723.0


def outcome(sim):
    """What a run came to, as numpy; the simulation itself does not outlive the next one."""
    arrays = sim.arrays()
    pool = measure(
        arrays["position"], arrays["temperature"], arrays["liquid_fraction"], MELTING, sim.config.spacing
    )
    return {
        "temperature": sim.temperature, "position": sim.position, "velocity": sim.velocity,
        "pool": pool, "row": sim.diagnostics(), "arrays": arrays,
    }  # fmt: skip


def run(config, **settings):
    sim = Simulation(config, **settings)
    sim.run()
    return outcome(sim)


def check_sound(found, end):
    """Finite, melted, moving; mass exact."""
    for name, values in found["arrays"].items():
        assert np.isfinite(values).all(), name
    row = found["row"]
    assert row["time_s"] == pytest.approx(end)
    assert row["mobile"] > 0
    assert row["max_speed_m_s"] > 0
    assert row["max_temperature_K"] < 6000
    assert row["mass_error"] < 1e-13  # a sum of 600 masses in another order
    assert row["absorbed_J"] > 0


# --------------------------------------------------------------------------- forms


def others(model):
    """Field -> its values other than the default, of every field that is a choice."""
    return {
        name: [value for value in values if value != model.model_fields[name].default]
        for name, values in choices(model).items()
    }


FORMS = [(name, value) for name, values in others(Numerics).items() for value in values]
# also numbers that switch a term off or on
FORMS += [("packing_correction", 0), ("artificial_viscosity", 0.2), ("delta", 0), ("surface_every", 1)]
FORMS += [("minimum_neighbours", 0), ("normal_cut", 0), ("maximum_step", 2e-8), ("heat_stages", 3)]
TERMS = [(name, value) for name, values in others(Physics).items() for value in values]


@pytest.fixture(scope="module")
def molten(track):
    """The tiny track, begun just below the solidus with a molten grain: everything acts within a few steps."""

    def build(**keys):
        return track(
            bodies=[
                {"shape": "plate", "length": 200 * UM, "depth": 60 * UM, "temperature": 1600},
                {
                    "shape": "powder_row",
                    "start": 50 * UM,
                    "length": 40 * UM,
                    "radius": 20 * UM,
                    "temperature": 2000,
                },
                {
                    "shape": "powder_row",
                    "start": 90 * UM,
                    "length": 40 * UM,
                    "radius": 20 * UM,
                    "temperature": 1660,
                },
            ],
            **{"time": {"end": 2e-6}, **keys},
        )

    return build


def test_every_choice_is_among_the_forms():
    names = {name for name, _ in FORMS}
    assert {
        "integrator",
        "pressure_form",
        "curvature",
        "latent_heat",
        "heat_scheme",
        "solid_density",
    } <= names
    assert len(FORMS) > 25
    assert {name for name, _ in TERMS} == set(Physics.model_fields)


def mixes():
    """As few configs as there are values of the richest choice, each value in one of them."""
    choices = others(Numerics)
    found = []
    for k in range(max(len(values) for values in choices.values())):
        # the booleans and two-valued choices alternate between the configs, so that each of them is once at its default
        chosen = {}
        for number, (name, values) in enumerate(choices.items()):
            if k < len(values) and (len(values) > 1 or number % 2 == k % 2):
                chosen[name] = values[k % len(values)]
            elif len(values) == 1 and number % 2 == k % 2:
                chosen[name] = values[0]
        found.append(companions(chosen))
    return found


def companions(chosen):
    """The printed diffusion is times rho once more: the paper's 1e-4 goes with it, 0.1 would be 700."""
    return {**chosen, "delta": 1e-4} if chosen.get("delta_form") == "printed" else chosen


@pytest.mark.parametrize(
    "number", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, len(mixes())))]
)
def test_forms_run_together(molten, number):
    """The first of these and the printed forms below choose nearly everything: enough for a quick look."""
    chosen = mixes()[number]
    found = run(molten(numerics=chosen))
    check_sound(found, 2e-6)


def test_the_mixes_hold_every_form():
    taken = {(name, value) for chosen in mixes() for name, value in chosen.items()}
    assert {(name, value) for name, values in others(Numerics).items() for value in values} <= taken


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), FORMS)
def test_a_form_runs(molten, name, value):
    check_sound(run(molten(numerics=companions({name: value}))), 2e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), TERMS)
def test_a_term_on_or_off_runs(molten, name, value):
    terms = {name: value}
    if name == "recoil":
        terms["evaporation"] = True
    found = run(molten(physics=terms, **({"laser": None} if name == "heat" else {})))
    if name in ("flow", "heat"):
        assert np.isfinite(found["temperature"]).all()
    else:
        check_sound(found, 2e-6)


def test_the_printed_forms_run(tmp_path):
    """`extends: paper.yaml`, all of it at once, on a tiny scene, for as long as it stands."""
    (tmp_path / "paper.yaml").write_text((CONFIGS / "paper.yaml").read_text())
    (tmp_path / "scene.yaml").write_text(
        """
extends: paper.yaml
dimension: 2
spacing: 5 um
bodies:
  - {shape: plate, length: 120 um, depth: 40 um, temperature: 1600}
  - {shape: powder_row, start: 40 um, length: 40 um, radius: 20 um, temperature: 1900}
laser: {power: 40, beam_radius: 30 um, path: [{kind: dwell, at: [60 um], duration: 1 ms}]}
time: {end: 0.4 us}
"""
    )
    config = load_config(tmp_path / "scene.yaml").config
    assert config.numerics.integrator == "leapfrog_printed"
    found = run(config)
    check_sound(found, 0.4e-6)
    assert found["row"]["step"] > 20


# --------------------------------------------------------------------------- the same answer


END = 16e-6  # steps of another length move the pool by less than 0.1 dx until then, by 0.16 at 20 us: it is chaotic


@pytest.fixture(scope="module")
def reference(track):
    """The tiny track: some twenty particles are molten, none is lost."""
    found = run(track(time={"end": END}))
    check_sound(found, END)
    assert found["row"]["removed"] == 0
    assert found["pool"].particles >= 8
    return found


@pytest.mark.parametrize("repeat", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_same_bits_whatever_the_threads(track, reference, repeat):
    """Gathered sums and reductions in one order: serial loops, two threads, and two threads once more."""
    found = run(track(time={"end": END}, performance={"serial_below": 0}), threads=2)
    for name in ("temperature", "position", "velocity"):
        assert np.array_equal(found[name], reference[name]), name
    assert found["row"] == reference["row"]


def test_the_order_of_the_particles_does_not_matter(track, reference):
    """The same scene, its particles dealt out in another order: sums differ by round-off, and nothing else does."""
    config = track(time={"end": END})
    scene = build_scene(config)
    order = np.random.default_rng(7).permutation(scene.count)
    mixed = {
        field.name: values[order]
        for field in fields(scene)
        if isinstance(values := getattr(scene, field.name), np.ndarray) and len(values) == scene.count
    }
    found = run(config, scene=replace(scene, **mixed))
    # 180 steps of round-off (1e-16 of 3,000 K and 200 um), which the flow makes some ten thousand times larger
    assert np.abs(found["temperature"] - reference["temperature"][order]).max() < 1e-6
    assert np.abs(found["position"] - reference["position"][order]).max() < 1e-9 * 5 * UM
    assert found["row"]["step"] == reference["row"]["step"]
    assert found["row"]["absorbed_J"] == pytest.approx(reference["row"]["absorbed_J"], rel=1e-12)


def differences(found, reference):
    """Largest differences of temperature [K], of position and pool size [dx], and the relative one of stored heat."""
    size = max(
        abs(found["pool"].length - reference["pool"].length),
        abs(found["pool"].depth - reference["pool"].depth),
    )
    return (
        float(np.abs(found["temperature"] - reference["temperature"]).max()),
        float(np.abs(found["position"] - reference["position"]).max()) / (5 * UM),
        size / (5 * UM),
        abs(found["row"]["stored_J"] / reference["row"]["stored_J"] - 1),
    )


def test_single_precision_has_the_same_melt_pool(track, reference):
    found = run(track(time={"end": END}), precision="f32")
    kelvin, moved, size, heat = differences(found, reference)
    # 180 steps of 6e-8 in temperatures of 3,000 K and places of 200 um, which the flow makes a hundred times larger
    assert kelvin < 1.0
    assert moved < 0.01
    assert size < 0.01
    assert heat < 1e-6  # enthalpies are kept in f64


SWITCHES = [name for name in others(Performance) if name != "stop_finished"]
# [K], [dx], [dx], [-] at the end, and why they may differ at all
TOLERANCES = {
    "skip_solid": (0.01, 1e-4, 1e-4, 1e-9),  # round-off: other rows, the same sums
    "skip_cold": (0.01, 1e-4, 1e-4, 1e-6),  # 1e-3 K at the rim of the hot set
    "skip_interior": (
        0.1,
        1e-3,
        1e-3,
        1e-7,
    ),  # colour gradients below 2 % of a surface's are left as they were
    "skip_dark": (0.1, 1e-3, 1e-3, 1e-6),  # a millionth of the light
    "keep_neighbours": (40.0, 0.2, 0.1, 1e-5),  # who melts is let go at the next build: some steps earlier
    # steps of heat of another length, and so of flow, of which halving the sound's alone makes 24 K and 0.2 dx
    "heat_clock": (150.0, 1.0, 0.1, 1e-5),
}


def test_nothing_skipped_is_the_same_track(track, reference):
    """All switches off at once, within what the last two of them may do."""
    found = run(track(time={"end": END}, performance=dict.fromkeys(SWITCHES, False)))
    kelvin, moved, size, heat = differences(found, reference)
    assert found["row"]["hot"] == 584  # every particle has a row
    assert kelvin < 150.0
    assert moved < 1.0
    assert size < 0.1
    assert heat < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("switch", SWITCHES)
def test_one_skip_less_is_the_same_track(track, reference, switch):
    found = run(track(time={"end": END}, performance={switch: False}))
    got = differences(found, reference)
    assert all(value <= limit for value, limit in zip(got, TOLERANCES[switch], strict=True)), got
