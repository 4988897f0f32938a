"""Guards: a poisoned particle, a broken account, a runaway: found within ten steps, and told in full."""

import re

import numpy as np
import pytest

from taichi_slm.errors import BlowUpError
from taichi_slm.run.simulation import Simulation
from taichi_slm.state import MOBILE

FOUND_WITHIN = 10  # flow steps


@pytest.fixture(scope="module")
def beginning(track):
    """The tiny track, and a checkpoint of it 12 us on, with some molten particles; nothing else builds one here."""
    sim = Simulation(track(), threads=1)
    sim.advance(12e-6)
    return sim, {name: values.copy() for name, values in sim.checkpoint().items()}


@pytest.fixture
def sim(beginning):
    """The track at 12 us, whatever became of it before."""
    simulation, saved = beginning
    simulation.restore(saved)
    return simulation


@pytest.fixture
def particle(sim):
    """A molten one."""
    mobile = np.flatnonzero(sim.state.array("mobility") == MOBILE)
    return int(mobile[len(mobile) // 2])


def blow_up(sim):
    """The sentence of the end, which must come within ten flow steps."""
    before = sim.steps

    def on() -> None:
        while sim.steps <= before + FOUND_WITHIN:
            sim.step()

    with pytest.raises(BlowUpError) as raised:
        on()
    return str(raised.value)


def last_named(told):
    return int(re.findall(r"particle (\d+)", told)[-1])


@pytest.mark.parametrize("name", ["position", "velocity", "density", "enthalpy"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_found_and_named(sim, particle, name, value):
    place = sim.position[particle]
    values = sim.state.array(name)
    values[particle] = value
    sim.state.load(**{name: values})
    told = blow_up(sim)
    named = last_named(told)
    # a kernel wide at most: the poison spreads by one support a step, and the middle of it is told
    assert np.linalg.norm(sim.scene.position[named] - sim.scene.position[particle]) < 6 * sim.config.spacing
    assert np.isfinite(place).all()
    assert "step" in told
    assert "limited by" in told


def test_a_poisoned_solid_particle_is_found(sim):
    """Nobody moves there, and no reduction over the liquid sees it."""
    still = int(np.argmin(np.linalg.norm(sim.position - [20e-6, -30e-6], axis=1)))
    values = sim.state.array("enthalpy")
    values[still] = np.nan
    sim.state.load(enthalpy=values)
    told = blow_up(sim)
    assert "enthalpy" in told
    # nine stages of heat have carried it on by a support of 3 dx each; the middle of what they reached is told
    named = sim.scene.position[last_named(told)]
    assert np.linalg.norm(named - sim.scene.position[still]) < 15 * sim.config.spacing


def test_a_speed_beyond_ten_times_sound_is_told(sim):
    """All of the melt at once: a single particle would be alone after a step, and removed."""
    mobile = sim.state.array("mobility") == MOBILE
    velocity = sim.velocity
    velocity[mobile] = [0.0, 12.0 * sim.config.numerics.sound_speed]
    sim.state.load(velocity=velocity)
    told = blow_up(sim)
    assert "numerics.sound_speed" in told
    assert mobile[last_named(told)]


def test_a_runaway_temperature_is_told(sim, particle):
    enthalpy = sim.state.array("enthalpy")
    enthalpy[particle] *= 50.0
    sim.state.load(enthalpy=enthalpy)
    assert "K, beyond the end of the property tables" in blow_up(sim)


def test_mass_from_nowhere_breaks_the_account(sim):
    mass = sim.state.array("mass")
    mass[5] *= 1.01  # one particle of 584 by a hundredth
    sim.state.load(mass=mass)
    assert "of the mass is not accounted for" in blow_up(sim)


def test_energy_from_nowhere_breaks_the_account(sim):
    """Five per cent of what the laser brought, given to solid particles far away: nobody's temperature is strange."""
    given = 0.05 * sim.ledger.energies()["absorbed"]
    far = sim.position[:, 0] > 150e-6
    enthalpy = sim.state.array("enthalpy")
    enthalpy[far] += given / sim.state.array("mass")[far].sum()
    sim.state.load(enthalpy=enthalpy)
    assert "of the energy is not accounted for" in blow_up(sim)


def test_a_sound_run_is_left_alone(sim):
    sim.run()
    books = sim.accounts.books()
    assert (
        books.energy_error < 1e-6
    )  # conservative to round-off, but for the 1e-3 K below which nothing is warm
    assert books.mass_error < 1e-13
