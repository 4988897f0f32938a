"""The melt pool and the track against shapes that are known exactly."""

import numpy as np
import pytest

from taichi_slm.analysis.melt_pool import groups, measure, solid_track

MELTING = 1723.0
PEAK, AMBIENT = 3000.0, 293.0
RADIUS = np.sqrt(np.log((PEAK - AMBIENT) / (MELTING - AMBIENT)))  # of the isotherm, in widths of the Gaussian


def gaussian_pool(spacing: float, widths: tuple[float, ...], centre: tuple[float, ...]) -> tuple:
    """A half space of particles under a Gaussian hot spot at ``centre``; its isotherm is an ellipsoid."""
    extent = [3.0 * w for w in widths]
    axes = [np.arange(-e, e, spacing) + 0.5 * spacing for e in extent[:-1]]
    axes.append(-(np.arange(int(extent[-1] / spacing)) + 0.5) * spacing)
    position = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    squares = (((position - np.array(centre)) / np.array(widths)) ** 2).sum(axis=1)
    temperature = AMBIENT + (PEAK - AMBIENT) * np.exp(-squares)
    return position, temperature, np.clip((temperature - 1673.0) / 100.0, 0.0, 1.0)


@pytest.mark.parametrize("spacing", [8e-6, 4e-6, 2e-6])
def test_known_isotherm_in_2d(spacing):
    widths, centre = (120e-6, 60e-6), (0.37 * spacing, 0.0)
    pool = measure(*gaussian_pool(spacing, widths, centre), MELTING, spacing)
    assert pool.width is None
    assert pool.length == pytest.approx(2 * RADIUS * widths[0], abs=0.15 * spacing)
    assert pool.depth == pytest.approx(RADIUS * widths[1], abs=0.15 * spacing)
    assert pool.groups == 1
    assert pool.spatter == 0


@pytest.mark.parametrize("spacing", [12e-6, 8e-6])
def test_known_isotherm_in_3d(spacing):
    widths, centre = (120e-6, 80e-6, 60e-6), (0.21 * spacing, 0.4 * spacing, 0.0)
    pool = measure(*gaussian_pool(spacing, widths, centre), MELTING, spacing)
    assert pool.length == pytest.approx(2 * RADIUS * widths[0], abs=0.2 * spacing)
    assert pool.width == pytest.approx(2 * RADIUS * widths[1], abs=0.2 * spacing)
    assert pool.depth == pytest.approx(RADIUS * widths[2], abs=0.2 * spacing)


def test_error_falls_with_the_square_of_the_spacing():
    widths = (120e-6, 60e-6)
    errors = []
    for spacing in (10e-6, 5e-6):
        shifts = np.linspace(0.0, 1.0, 9) * spacing
        pools = [measure(*gaussian_pool(spacing, widths, (s, 0.3 * s)), MELTING, spacing) for s in shifts]
        exact = RADIUS * widths[1] - 0.3 * shifts
        errors.append(np.abs([p.depth for p in pools] - exact).max())
    assert errors[1] < errors[0] / 2.5


def test_spatter_is_not_the_pool():
    spacing = 4e-6
    position, temperature, fraction = gaussian_pool(spacing, (120e-6, 60e-6), (0.0, 0.0))
    alone = measure(position, temperature, fraction, MELTING, spacing)
    drop = np.array([[300e-6, 100e-6], [304e-6, 100e-6]])
    pool = measure(
        np.concatenate([position, drop]),
        np.append(temperature, [4000.0, 4000.0]),
        np.append(fraction, [1.0, 1.0]),
        MELTING,
        spacing,
    )
    assert (pool.length, pool.depth, pool.spatter, pool.groups) == (alone.length, alone.depth, 2, 2)


def test_melting_point_per_particle():
    spacing = 4e-6
    position, temperature, fraction = gaussian_pool(spacing, (120e-6, 60e-6), (0.0, 0.0))
    melting = np.where(position[:, 0] < 0.0, MELTING, np.inf)  # the right half never melts
    pool = measure(position, temperature, fraction, melting, spacing)
    whole = measure(position, temperature, fraction, MELTING, spacing)
    assert pool.length == pytest.approx(0.5 * whole.length, abs=spacing)


def test_nothing_liquid():
    position, temperature, fraction = gaussian_pool(8e-6, (120e-6, 60e-6), (0.0, 0.0))
    pool = measure(position, np.full_like(temperature, 300.0), np.zeros_like(fraction), MELTING, 8e-6)
    assert (pool.length, pool.width, pool.depth, pool.particles) == (0.0, None, 0.0, 0)


def test_a_pool_that_stays_above_the_plate_has_no_depth():
    spacing = 4e-6
    position, temperature, fraction = gaussian_pool(spacing, (120e-6, 60e-6), (0.0, 0.0))
    position[:, 1] += 100e-6
    assert measure(position, temperature, fraction, MELTING, spacing).depth == 0.0


def test_groups():
    position = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.9], [5.0, 0.0]])
    labels, sizes = groups(position, 1.0)
    assert labels[0] == labels[1] == labels[2] != labels[3]
    assert sorted(sizes) == [1, 3]


def test_track():
    spacing = 1e-6
    x, y = np.meshgrid(np.arange(100) + 0.5, np.arange(-20, 0) + 0.5, indexing="ij")
    plate = np.stack([x.ravel(), y.ravel()], axis=1) * spacing
    x, y = np.meshgrid(np.arange(20, 80) + 0.5, np.arange(6) + 0.5, indexing="ij")
    bead = np.stack([x.ravel(), y.ravel()], axis=1) * spacing
    grain = (
        np.array([[90.5, 8.5], [91.5, 8.5]]).repeat(6, axis=0) * spacing
    )  # floats two spacings above the plate
    position = np.concatenate([plate, bead, grain])
    melted = (position[:, 0] > 20e-6) & (position[:, 0] < 80e-6) & (position[:, 1] > -5e-6)
    track = solid_track(position, np.zeros(len(position)), melted, spacing)
    assert track.length_m == pytest.approx(60e-6)
    assert track.depth_m == pytest.approx(5e-6)
    assert track.mean_height_m == pytest.approx(6e-6)
    assert track.roughness_m == pytest.approx(0.0, abs=1e-12)
    assert (track.unmelted_powder, track.pieces, track.still_liquid) == (12, 2, 0)
    assert solid_track(position[:-12], np.zeros(len(position) - 12), melted[:-12], spacing).pieces == 1
