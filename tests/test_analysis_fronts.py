"""Fronts of known speed, gradient and cooling rate; time above melting of a known history; the energy account."""

import numpy as np
import pytest
from moments import COLD, LIQUIDUS, MELTING, SOLIDUS, lattice, moment

from taichi_slm.analysis.energy import energy_account
from taichi_slm.analysis.fronts import FrontBook, share_above

UM = 1e-6


def watch(moments):
    book = FrontBook(np.array([SOLIDUS]), np.array([LIQUIDUS]))
    for each in moments:
        book.see(each)
    return book


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_linear_field_that_moves(dimension):
    """T = T_m - G (s - v t) along a slanted direction s: gradient G, front speed v, cooling rate G v, all exact."""
    G, v, spacing = 2e6, 0.5, 5 * UM
    direction = np.array([0.8, 0.6]) if dimension == 2 else np.array([0.64, 0.48, 0.6])
    position = lattice(spacing, (0.0,) * dimension, (100 * UM, 40 * UM, 40 * UM)[:dimension])
    s = position @ direction
    book = watch(
        moment(position, spacing, t, temperature=MELTING + G * (s - v * t))
        for t in np.linspace(0.0, 4e-4, 41)
    )
    table = book.table(dimension)
    assert len(table["id"]) == len(position)
    assert table["gradient_K_m"] == pytest.approx(G, rel=1e-9)
    assert table["front_speed_m_s"] == pytest.approx(v, rel=1e-9)
    assert table["cooling_rate_at_front_K_s"] == pytest.approx(G * v, rel=1e-9)
    full = s > 50.0 / G  # the others began within the freezing range
    cooling = book.cooling[full]
    assert cooling == pytest.approx(G * v, rel=1e-9)
    assert np.isnan(book.cooling[~full]).all()
    assert book.time == pytest.approx(s / v, rel=1e-9)  # T passes T_m where s = v t
    assert book.molten_time == pytest.approx(s / v, rel=1e-9)
    assert book.place == pytest.approx(position, rel=1e-12)
    chief = book.chief(dimension)
    assert chief["gradient_K_m"]["median"] == pytest.approx(G)
    assert chief["median_drop_between_snapshots_K"] == pytest.approx(G * v * 1e-5)


def test_time_above_melting_of_a_known_history():
    """T = T_m + A sin(2 pi t/P) over two periods is above T_m for half of them; linear between 40 moments a period:
    where it starts and ends at T_m and where it crosses, moments lie on T_m, so that nothing is lost."""
    position, period = lattice(1.0, (0.0, 0.0), (4.0, 4.0)) * UM, 1e-3
    times = np.linspace(0.0, 2 * period, 81)
    wave = 200.0 * np.sin(2 * np.pi * times / period)
    wave[::20] = 0.0
    wave[-1] = -1e-9  # the history ends on its way up, not molten a third time
    book = watch(
        moment(position, UM, t, temperature=np.full(16, MELTING + w))
        for t, w in zip(times, wave, strict=True)
    )
    assert book.molten_time == pytest.approx(period, rel=1e-12)
    assert (book.melted == 2).all()  # once at the start, once again
    assert book.time == pytest.approx(1.5 * period, rel=1e-12)  # the last way down through T_m
    # from the liquidus to the solidus: arcsin(1/4) of the wave on either side; chords of 40 moments a period are off
    # by (pi/40)^2/2 of the amplitude at most
    fall = 100.0 / (2 * np.arcsin(0.25) / (2 * np.pi) * period)
    assert book.cooling == pytest.approx(fall, rel=0.5 * (np.pi / 40) ** 2 / 0.25)


def test_share_above():
    before, after = np.array([1.0, -1.0, 3.0, -1.0, 0.0]), np.array([2.0, -2.0, -1.0, 3.0, -1.0])
    assert share_above(before, after) == pytest.approx([1.0, 0.0, 0.75, 0.75, 0.0])


def test_a_particle_that_is_gone_is_followed_to_its_last_moment():
    position = lattice(1.0, (0.0, 0.0), (4.0, 4.0)) * UM
    hot = np.full(16, 2000.0)
    first, second = (moment(position, UM, t, temperature=hot) for t in (0.0, 1.0))
    third = moment(position[1:], UM, 2.0, temperature=hot[1:], id=np.arange(1, 16))
    book = watch([first, second, third])
    assert book.molten_time.tolist() == [1.0] + 15 * [2.0]
    assert len(book.table(2)["id"]) == 0


def test_nothing_melts():
    position = lattice(1.0, (0.0, 0.0), (4.0, 4.0)) * UM
    book = watch(moment(position, UM, t, temperature=np.full(16, COLD)) for t in (0.0, 1.0))
    found = book.chief(2)
    assert found["frozen_particles"] == 0
    assert found["max_time_above_melting_s"] == 0.0
    assert found["cooling_rate_K_s"] == {"median": None, "p10": None, "p90": None}


def test_energy_account_sums():
    """10 + 1 J in; 6 J stored, 2 radiated, 1.5 evaporated, 1 conducted out, and 0.5 not accounted for."""
    history = {name: np.array([0.0, value]) for name, value in {
        "time_s": 1.0, "absorbed_J": 10.0, "viscous_J": 1.0, "stored_J": 6.0, "radiated_J": 2.0, "evaporated_J": 1.5,
        "conducted_out_J": 1.0, "removed_J": np.nan,
    }.items()}  # fmt: skip
    account = energy_account(history)
    closing = account.closing()
    assert closing["in_J"] == pytest.approx(11.0)
    assert closing["out_J"] == pytest.approx(10.5)
    assert closing["unaccounted_J"] == pytest.approx(0.5)
    assert closing["removed_J"] == 0.0
    assert energy_account({}) is None
