"""Edges: the end of time, nothing viscous, nothing conducting, NaN. Each failed once."""

import sys

import numpy as np
import pytest
from fake_run import loaded

from taichi_slm.errors import BlowUpError, ConfigError
from taichi_slm.run import driver
from taichi_slm.run.simulation import Simulation

OFF = {
    "heat": False,
    "surface_tension": False,
    "marangoni": False,
    "radiation": False,
    "viscous_heating": False,
}


def test_a_step_at_the_end_does_nothing(track):
    """ZeroDivisionError: heat.step divides by a span of 0."""
    sim = Simulation(track(time={"end": 1e-6}))
    sim.run()
    sim.step()
    assert sim.time == 1e-6


def test_an_inviscid_drop_moves(configure, liquid):
    """viscosity.py: mu_a mu_b/(mu_a + mu_b) is 0/0; every velocity is NaN, run() ends without an error."""
    config = configure(spacing=0.1, materials={"f": liquid(viscosity=0.0)}, physics=OFF, time={"end": 0.05},
                       bodies=[{"shape": "droplet", "centre": [0, 0], "radius": 0.8, "material": "f", "stretch": 0.1}],
                       numerics={"sound_speed": 20})  # fmt: skip
    sim = Simulation(config)
    sim.run()
    assert np.isfinite(sim.velocity).all()


def test_nan_is_never_silent_in_the_flow(configure, liquid):
    """A NaN velocity: max() drops it, so nobody moves half a skin, no list is built, nothing is noticed."""
    config = configure(spacing=0.1, materials={"f": liquid(viscosity=1.0)}, physics=OFF, time={"end": 0.05},
                       bodies=[{"shape": "droplet", "centre": [0, 0], "radius": 0.8, "material": "f"}],
                       numerics={"sound_speed": 20})  # fmt: skip
    sim = Simulation(config)
    sim.compile()
    velocity = sim.velocity
    velocity[17] = np.nan
    sim.state.load(velocity=velocity)
    with pytest.raises(BlowUpError):
        sim.run()


def test_nan_is_never_silent_in_the_heat(configure, liquid):
    """A NaN enthalpy: `T > hottest` is false for it, so the guard sees 0 K or the others."""
    config = configure(spacing=5e-6, materials={"f": liquid()}, physics={"flow": False}, time={"end": 1e-3},
                       bodies=[{"shape": "box", "corner": [0, 0], "size": [5e-5, 5e-5], "material": "f",
                                "temperature": 1000}])  # fmt: skip
    sim = Simulation(config)
    sim.compile()
    enthalpy = sim.state.array("enthalpy")
    enthalpy[17] = np.nan
    sim.state.load(enthalpy=enthalpy)
    with pytest.raises(BlowUpError):
        sim.run()


def test_harmonic_conduction_of_an_insulator(configure, liquid):
    """conduction.py: k_a k_b/(k_a + k_b) is 0/0; every temperature is NaN, run() ends without an error."""
    config = configure(spacing=5e-6, materials={"f": liquid(conductivity=0.0)}, physics={"flow": False},
                       numerics={"conduction": "harmonic"}, time={"end": 1e-3},
                       bodies=[{"shape": "box", "corner": [0, 0], "size": [5e-5, 5e-5], "material": "f",
                                "temperature": 1000}])  # fmt: skip
    sim = Simulation(config)
    sim.run()
    assert np.isfinite(sim.temperature).all()


def test_maximum_step_holds_without_flow(track):
    """simulation.py _choose: span = min(span, 8 maximum_step), one heat step of that."""
    sim = Simulation(track(physics={"flow": False}, numerics={"maximum_step": 1e-8}))
    sim.step()
    assert sim.time <= 1.01e-8


def test_a_resumed_run_counts_on(track):
    """List builds and surface evaluations are columns of the history, which resumed is that of the unbroken run."""
    config = track(time={"end": 30e-6})
    sim = Simulation(config)
    sim.advance(20e-6)
    saved = {k: v.copy() for k, v in sim.checkpoint().items()}
    before = sim.diagnostics()
    rest = Simulation(config)
    rest.restore(saved)
    until_the_next_step = {"dt_limiter": "start", "hot": rest.rows.hot}  # rows are chosen in it
    assert rest.diagnostics() == before | until_the_next_step
    assert min(before["surface_evaluations"], before["list_builds"]) > 0


@pytest.mark.skipif(sys.platform == "darwin", reason="macOS has Metal")
def test_a_device_that_is_not_there_is_refused(track, tmp_path):
    """Taichi falls back to the CPU and tells nobody; the run's provenance then said metal."""
    with pytest.raises(ConfigError, match="--arch metal"):
        driver.execute(loaded(track()), tmp_path / "run", arch="metal")
    assert not (tmp_path / "run").exists()
