"""Melt pools of known shape, several of them, and drops that belong to none."""

import numpy as np
import pytest
from moments import COLD, DENSITY, MELTING, lattice, moment

from taichi_slm.analysis.gradient import gradient, share_beyond
from taichi_slm.analysis.melt_pool import measure
from taichi_slm.analysis.mixing import MixingBook
from taichi_slm.analysis.pools import PoolBook, find_pools, sort_melt
from taichi_slm.analysis.spatter import SpatterBook

UM = 1e-6
PEAK = 3000.0
RADIUS = np.sqrt(np.log((PEAK - COLD) / (MELTING - COLD)))  # of the isotherm, in widths of the Gaussian


def hot_spots(position, *spots):
    """Temperature [K] of Gaussian hot spots (centre, widths); the isotherm of one alone is an ellipsoid."""
    heat = np.zeros(len(position))
    for centre, widths in spots:
        heat = np.maximum(
            heat, np.exp(-(((position - np.array(centre)) / np.array(widths)) ** 2).sum(axis=1))
        )
    return COLD + (PEAK - COLD) * heat


def half_ellipsoid(spacing, widths, centre):
    """The pool found under a Gaussian hot spot at the surface."""
    reach = [1.5 * w for w in widths]
    low = tuple(-r for r in reach)
    position = lattice(spacing, low, (*reach[:-1], 0.0))
    now = moment(position, spacing, temperature=hot_spots(position, (centre, widths)))
    (pool,) = find_pools(now, sort_melt(now))
    return pool


def test_gradient_of_a_linear_field_is_exact_on_any_particles():
    """Least squares through a plane has no error but round-off, at edges and on a disordered set as well."""
    rng = np.random.default_rng(1)
    for slope in (np.array([3e6, -1e6]), np.array([3e6, -1e6, 2e6])):
        position = lattice(1.0, (0.0,) * len(slope), (8.0,) * len(slope)) * UM
        position += rng.uniform(-0.2, 0.2, position.shape) * UM
        found = gradient(position, 300.0 + position @ slope, np.arange(len(position)), UM)
        assert np.allclose(found, slope, rtol=1e-9)


def test_gradient_is_unknown_where_the_neighbours_lie_in_a_line():
    position = np.stack([np.arange(9.0), np.zeros(9)], axis=1)
    assert np.isnan(gradient(position, position[:, 0], np.array([4]), 1.0)).all()


def test_share_of_a_cut_cell():
    slope = np.array([[2.0, 0.0], [2.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert share_beyond(np.array([0.5, -9.0, 1.0, -1.0]), slope, 1.0) == pytest.approx([0.75, 0.0, 1.0, 0.0])


def test_half_ellipse_is_found_with_an_error_of_second_order():
    """Length, depth and area over nine places of the lattice; halving dx must divide the largest error by 2.5 at least
    (4 for pure second order; half a cell at the surface, where the slope is one-sided, costs some)."""
    widths = (120 * UM, 60 * UM)
    a, b = RADIUS * widths[0], RADIUS * widths[1]
    worst = []
    for spacing in (10 * UM, 5 * UM):
        shifts = np.linspace(0.0, 1.0, 9) * spacing
        pools = [half_ellipsoid(spacing, widths, (s, 0.0)) for s in shifts]
        length = max(abs(p.length - 2 * a) for p in pools)
        depth = max(abs(p.depth - b) for p in pools)
        area = max(abs(p.volume / (np.pi / 2 * a * b) - 1) for p in pools)
        worst.append((length, depth, area))
    assert worst[1][0] < 0.15 * 5 * UM  # as in test_melt_pool.py: the same isotherm
    assert worst[1][1] < 0.15 * 5 * UM
    assert (
        worst[1][2] < 0.002
    )  # (dx/b)^2 = 1.2 %, times the curvature of the Gaussian at its isotherm, times 1/8
    assert worst[1][2] < worst[0][2] / 2.5
    assert worst[1][1] < worst[0][1] / 2.5


def test_half_ellipsoid_in_3d():
    spacing, widths = 6 * UM, (90 * UM, 66 * UM, 48 * UM)
    pool = half_ellipsoid(spacing, widths, (0.3 * spacing, 0.2 * spacing, 0.0))
    a, b, c = (RADIUS * w for w in widths)
    assert pool.length == pytest.approx(2 * a, abs=0.2 * spacing)
    assert pool.width == pytest.approx(2 * b, abs=0.2 * spacing)
    assert pool.depth == pytest.approx(c, abs=0.2 * spacing)
    assert pool.volume == pytest.approx(2 / 3 * np.pi * a * b * c, rel=0.01)  # (dx/c)^2 = 3.4 %, as in 2-D


def test_the_largest_pool_is_the_one_of_the_history():
    spacing = 4 * UM
    position = lattice(spacing, (-200 * UM, -120 * UM), (200 * UM, 0.0))
    temperature = hot_spots(position, ((0.0, 0.0), (120 * UM, 60 * UM)))
    now = moment(position, spacing, temperature=temperature)
    (pool,) = find_pools(now, sort_melt(now))
    known = measure(position, temperature, (temperature >= MELTING) * 1.0, MELTING, spacing)
    assert (pool.length, pool.depth, len(pool.members)) == (known.length, known.depth, known.particles)


def scene(spacing, *spots, drop=None, speed=(0.0, 0.0)):
    """A plate with pools, and a drop of 5 x 5 particles at a corner ``drop`` [m]."""
    plate = lattice(spacing, (-300 * UM, -100 * UM), (300 * UM, 0.0))
    temperature = hot_spots(plate, *spots) if spots else np.full(len(plate), COLD)
    velocity = np.zeros_like(plate)
    if drop is not None:
        ball = lattice(spacing, drop, tuple(x + 5 * spacing for x in drop))
        plate = np.concatenate([plate, ball])
        temperature = np.append(temperature, np.full(len(ball), 2000.0))
        velocity = np.concatenate([velocity, np.tile(speed, (len(ball), 1))])
    return {"position": plate, "temperature": temperature, "velocity": velocity}


def look(spacing, parts, time=0.0, **more):
    now = moment(
        parts["position"], spacing, time, **{k: v for k, v in parts.items() if k != "position"}, **more
    )
    return now, sort_melt(now)


def test_two_pools_are_two_rows_and_keep_their_numbers():
    """Two pools, the right one larger; the left one grows beyond it, and then they meet."""
    spacing, book = 5 * UM, PoolBook()
    left, right = (-120 * UM, 0.0), (120 * UM, 0.0)
    for time, (small, big) in enumerate([(50, 60), (70, 60), (170, 170)]):
        now, melt = look(
            spacing, scene(spacing, (left, (small * UM, 40 * UM)), (right, (big * UM, 40 * UM))), time
        )
        book.see(now, find_pools(now, melt))
    table = book.table(2)
    assert table["time_s"] == [0, 0, 1, 1, 2]
    places = [0.5 * (rear + front) for rear, front in zip(table["rear_m"], table["front_m"], strict=True)]
    assert table["pool"][:4] == [1, 2, 2, 1]  # the largest first; the right one is pool 1 from the start
    assert np.sign(places[:4]).tolist() == [1, -1, -1, 1]
    assert table["length_m"][0] == pytest.approx(2 * RADIUS * 60 * UM, abs=0.2 * spacing)
    assert table["length_m"][1] == pytest.approx(2 * RADIUS * 50 * UM, abs=0.2 * spacing)
    assert book.chief(2)["pools"] == 2
    assert book.chief(2)["max_length_m"] == max(table["length_m"])


def test_a_drop_in_flight_is_no_pool_but_spatter():
    spacing = 5 * UM
    spot = ((0.0, 0.0), (100 * UM, 50 * UM))
    drop = (100 * UM, 60 * UM)
    now, melt = look(spacing, scene(spacing, spot, drop=drop, speed=(3.0, 4.0)))
    alone, melt_alone = look(spacing, scene(spacing, spot))
    (pool,), (same,) = find_pools(now, melt), find_pools(alone, melt_alone)
    assert (pool.length, pool.depth, pool.volume) == (same.length, same.depth, same.volume)
    book = SpatterBook()
    book.see(now, melt)
    row = {name: values[0] for name, values in book.table().items()}
    mass = 25 * DENSITY * spacing**2
    assert (row["drops"], row["particles_in_flight"]) == (1, 25)
    assert row["mass_in_flight_kg_m"] == pytest.approx(mass)
    assert row["largest_drop_kg_m"] == pytest.approx(mass)
    assert row["mean_speed_m_s"] == pytest.approx(5.0)
    assert row["max_speed_m_s"] == pytest.approx(5.0)


def test_a_drop_on_the_plate_is_a_pool_and_one_around_a_frozen_crumb_is_not():
    spacing = 5 * UM
    now, melt = look(spacing, scene(spacing, drop=(100 * UM, 0.0)))
    assert [len(pool.members) for pool in find_pools(now, melt)] == [25]
    parts = scene(spacing, drop=(100 * UM, 60 * UM))
    parts["temperature"][-13] = 1000.0  # the middle of the drop has frozen
    ever = np.zeros(len(parts["position"]), dtype=bool)
    ever[-25:] = True
    now, melt = look(spacing, parts, ever_liquid=ever)
    assert find_pools(now, melt) == []
    assert len(melt.flying) == 24


def test_a_free_drop_is_its_own_pool():
    position = lattice(1.0, (0.0, 0.0), (6.0, 6.0)) * UM
    now = moment(position, UM, temperature=np.full(36, 2000.0))
    (pool,) = find_pools(now, sort_melt(now, on_plate=False))
    assert len(pool.members) == 36
    assert pool.volume == pytest.approx(36 * UM**2)


def test_spatter_is_followed_until_it_is_gone_or_back():
    """25 particles fly, come back at the second moment; five of the plate's are gone at the third."""
    spacing, book = 5 * UM, SpatterBook()
    parts = scene(spacing, drop=(100 * UM, 60 * UM), speed=(2.0, 0.0))
    book.see(*look(spacing, parts))
    down = parts | {
        "position": parts["position"].copy(),
        "temperature": np.full(len(parts["position"]), COLD),
    }
    down["position"][-25:, 1] -= 60 * UM
    book.see(*look(spacing, down, 1.0))
    ids = np.arange(len(parts["position"]))
    rest = {name: values[5:] for name, values in down.items()}
    book.see(*look(spacing, rest, 2.0, id=ids[5:]))
    found, mass = book.chief(), DENSITY * spacing**2
    assert (found["ejected_particles"], found["returned_particles"], found["removed_particles"]) == (
        30,
        25,
        5,
    )
    assert found["ejected_mass_kg_m"] == pytest.approx(30 * mass)
    assert found["removed_mass_kg_m"] == pytest.approx(5 * mass)
    assert found["max_speed_in_flight_m_s"] == pytest.approx(2.0)
    assert book.table()["removed_particles"] == [0, 0, 5]


def test_mixing_of_two_halves_and_of_a_stirred_block():
    """Halves: only two columns of 40 touch the other group, 3 of their 8 neighbours. Dealt at random: 1."""
    position = lattice(1.0, (0.0, 0.0), (40.0, 40.0)) * UM
    halves = (position[:, 0] > 20 * UM).astype(int)
    stirred = np.random.default_rng(3).permutation(halves)
    index = []
    for tracer in (halves, stirred):
        book = MixingBook(["steel"])
        book.see(moment(position, UM, tracer=tracer, ever_liquid=np.ones(1600, dtype=bool)))
        row = book.chief()[1]
        assert (row["kind"], row["group"], row["particles"]) == ("tracer", 1, 800)
        index.append(row["mixing_index"])
    rows = 38 * 3 / 8 + 2 * 2 / 5  # at the top and bottom ends a column has 5 neighbours, 2 of them foreign
    assert index[0] == pytest.approx(rows / 800 / (800 / 1599))
    assert index[1] == pytest.approx(
        1.0, abs=0.04
    )  # 800 x 8 neighbours at random: 1/sqrt(6400) = 0.0125, three of it
    assert MixingBook(["steel"]).table() == {}


def test_the_scatter_of_groups_is_their_second_moment():
    position = lattice(1.0, (0.0, 0.0), (12.0, 6.0)) * UM
    book = MixingBook(["a", "b"])
    material = (position[:, 1] > 3 * UM).astype(int)
    book.see(moment(position, UM, material=material, ever_liquid=np.ones(72, dtype=bool)))
    row = book.chief()[0]
    assert (row["kind"], row["group"]) == ("material", "a")
    assert row["centre_x_m"] == pytest.approx(6 * UM)
    assert row["spread_x_m"] == pytest.approx(np.sqrt((144 - 1) / 12) * UM)  # of 12 equal steps
    assert row["spread_z_m"] == pytest.approx(np.sqrt((9 - 1) / 12) * UM)
