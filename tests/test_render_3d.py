"""The inside of a 3-D melt: fields on a grid, isosurfaces and streamlines against exact shapes, and the pictures."""

import numpy as np
import pytest
from fake_run import driven, pixels, share

from taichi_slm.config.schema import ONLY_3D
from taichi_slm.errors import ConfigError
from taichi_slm.output.snapshots import Snapshot
from taichi_slm.render import paint
from taichi_slm.render.grid import sample
from taichi_slm.render.inside import Region
from taichi_slm.render.movie import film_run
from taichi_slm.render.views import render_run
from taichi_slm.render.volume import Melt, isosurface, middles, streamlines

DX = 5e-6
RADIUS = 50e-6


def lattice(low, high, shake=0.1):
    """Particles on a lattice between two corners [m], each off its place by up to ``shake`` of a spacing."""
    axes = [np.arange(a + 0.5 * DX, b, DX) for a, b in zip(low, high, strict=True)]
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    return points + shake * DX * np.random.default_rng(1).uniform(-1, 1, points.shape)


def cube():
    return lattice([-16 * DX] * 3, [16 * DX] * 3)


def corners(half):
    return np.full(3, -half), np.full(3, half)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_linear_field_is_kept_and_the_metal_ends_at_its_surface(dimension):
    position = lattice([-16 * DX] * dimension, [16 * DX] * dimension)
    slope = np.array([1e7, -2e7, 3e7])[:dimension]
    grid = sample(position, *(c[:dimension] for c in corners(20 * DX)), 0.5 * DX, DX)
    points = np.stack(np.meshgrid(*grid.axes, indexing="ij"), axis=-1)
    deep = (np.abs(points) < 12 * DX).all(axis=-1)
    # a mean over a symmetric neighbourhood keeps a line; nobody is shaken by more than sqrt(d)/10 of a spacing
    error = grid.mean(position @ slope) - points @ slope
    assert np.abs(error[deep]).max() < 0.1 * np.sqrt(dimension) * DX * np.linalg.norm(slope)
    # over a whole lattice the mean is 1; the shaken sum over 13 or 33 neighbours varies by a tenth
    assert grid.share[deep].mean() == pytest.approx(1.0, abs=0.02)
    outside = (np.abs(points) > 16.6 * DX).any(axis=-1)  # a little more than where a half space has a third
    inside = (np.abs(points) < 15.9 * DX).all(axis=-1) & ((np.abs(points) > 14 * DX).sum(axis=-1) < 2)
    assert not grid.metal[outside].any()
    assert grid.metal[inside].all()


def test_a_grid_one_point_thick_is_the_section_of_the_whole_one():
    position = cube()
    values = np.cos(position @ [3e4, 5e4, 7e4])
    low, high = corners(10 * DX)
    whole = sample(position, low, high, DX, DX)
    flat = sample(position, low * [1, 0, 1], high * [1, 0, 1], DX, DX)
    assert flat.share.shape == (21, 1, 21)
    np.testing.assert_allclose(flat.mean(values)[:, 0], whole.mean(values)[:, 10], rtol=1e-12)


def test_the_isosurface_of_a_sphere_has_its_area():
    position = cube()
    grid = sample(position, *corners(14 * DX), 0.5 * DX, DX)
    surface = isosurface(grid, grid.mean(3000.0 - 2e7 * np.linalg.norm(position, axis=1)), 2000.0)
    radius = np.linalg.norm(surface.points, axis=1)
    # T is linear in r: a mean over r.m.s. distance s = 0.9 dx shifts the level by s^2/(3 r), 0.03 dx, inwards; and
    # nobody is shaken by more than 0.17 dx, which in the area goes out
    assert np.abs(radius - RADIUS).max() < 0.2 * DX
    assert surface.area == pytest.approx(4 * np.pi * RADIUS**2, rel=0.015)  # 2 x 0.03/10 and as much again


def test_the_isosurface_ends_at_the_free_surface_without_a_lid():
    position = lattice([-16 * DX, -16 * DX, -16 * DX], [16 * DX, 16 * DX, 0.0])
    grid = sample(position, *corners(14 * DX), 0.5 * DX, DX)
    surface = isosurface(grid, grid.mean(3000.0 - 2e7 * np.linalg.norm(position, axis=1)), 2000.0)
    half = 2 * np.pi * RADIUS**2
    # the metal is taken to end up to half a spacing above: 2 pi R times that is 5 % of the half sphere; a lid were 50 %
    assert half * 0.97 < surface.area < half * 1.07
    assert surface.points[:, 2].max() < 0.5 * DX


def test_streamlines_of_a_solid_rotation_stay_on_circles():
    position = cube()
    grid = sample(position, *corners(14 * DX), 0.5 * DX, DX)
    spin = 2e4  # [1/s]
    velocity = grid.mean(spin * np.stack([-position[:, 1], position[:, 0], 0 * position[:, 2]], axis=1))
    seeds = np.array([[2.0, 0.0, 0.0], [0.0, 5.0, 3.0], [-6.0, -6.0, 1.0]]) * DX
    lines = streamlines(grid, velocity, np.ones(grid.share.shape, dtype=bool), seeds, 0.1 * DX, 1e-6)
    assert lines.n_cells == 6  # both ways from each
    start = lines.points[0]
    for number in range(lines.n_cells):
        line = lines.get_cell(number).points
        start = line[0]
        radius = np.hypot(line[:, 0], line[:, 1])
        # shaken places tilt the velocity by some hundredths: the lines drift by as much of a spacing in each turn
        assert np.abs(radius - np.hypot(*start[:2])).max() < 0.25 * DX
        assert np.abs(line[:, 2] - start[2]).max() < 0.25 * DX
        turns = np.abs(np.diff(np.unwrap(np.arctan2(line[:, 1], line[:, 0])))).sum() / (2 * np.pi)
        assert turns > 1.0
    speed = np.asarray(lines.point_data["speed"])
    expected = spin * np.hypot(lines.points[:, 0], lines.points[:, 1])
    assert np.abs(speed - expected).max() < 0.1 * DX * spin


def test_streamlines_end_at_the_solid():
    position = cube()
    liquid = np.linalg.norm(position, axis=1) < RADIUS
    velocity = np.where(liquid[:, None], [1.0, 0.0, 0.0], 0.0)
    melt = Melt.of(snapshot(position, liquid, velocity), liquid)
    lines = melt.lines(1.0)
    assert lines.n_cells > 50
    # a point counts as melt while more than 40 % of what it sees is: a little beyond the last particles
    assert np.linalg.norm(lines.points, axis=1).max() < RADIUS + 0.5 * DX
    assert np.abs(lines.points[:, 0]).max() > RADIUS - DX
    # in the liquid the solid's stillness is not mixed in
    np.testing.assert_allclose(lines.point_data["speed"], 1.0, rtol=1e-6)
    heads = middles(lines)
    assert heads.n_points == lines.n_cells
    np.testing.assert_allclose(
        heads.point_data["velocity"], np.tile([1.0, 0.0, 0.0], (heads.n_points, 1)), atol=1e-6
    )


def snapshot(position, liquid, velocity):
    arrays = {
        "position": position,
        "velocity": velocity,
        "temperature": np.where(liquid, 2000.0, 300.0),
        "liquid_fraction": liquid.astype(float),
    }
    return Snapshot(arrays, 0.0, 0, 3, DX)


def test_the_close_up_holds_the_melt_and_no_lone_drop():
    position = np.concatenate([cube(), [[0.0, 0.0, 1e-3]]])
    liquid = np.linalg.norm(position, axis=1) < RADIUS
    liquid[-1] = True
    region = Region.of([snapshot(position, liquid, np.zeros_like(position))], DX)
    assert region.holds(position[liquid]).sum() == liquid.sum() - 1
    assert region.high[2] < 20 * DX
    seen = region.frame("cut")
    assert seen.solid
    np.testing.assert_allclose(seen.towards, [0.0, -1.0, 0.0])


def test_pictures_of_the_inside(tmp_path, monkeypatch, gl):
    folder = driven(tmp_path, monkeypatch, dimension=3, length=300e-6)
    files = render_run(folder, ONLY_3D)
    images = {path.stem: pixels(path) for path in files}
    assert len(images) == 9
    for kind in ONLY_3D:
        first, last = images[f"{kind}_000000"], images[f"{kind}_000005"]
        assert first.shape == last.shape
        assert last.std() > 20  # not blank
        metal = slice(80, -160)  # without header and footer
        assert np.abs(first[metal] - last[metal]).mean() > 1.0  # something has happened
        assert (last[:8] == 255).all()  # nothing is cut off at the edges
        assert (last[:, :8] == 255).all()
    for kind in ("isosurface", "streamlines"):
        assert share(images[f"{kind}_000005"], paint.UNMELTED) > 0.1


def test_a_film_of_the_inside(tmp_path, monkeypatch, gl):
    folder = driven(tmp_path, monkeypatch, dimension=3, length=300e-6)
    (film,) = film_run(folder, ["cut"], gif=True)
    assert film.stat().st_size > 10_000


def test_what_cannot_melt_has_no_inside(tmp_path, monkeypatch, gl):
    folder = driven(tmp_path, monkeypatch, dimension=3, length=300e-6)
    facts = folder / "provenance.json"
    facts.write_text(facts.read_text().replace("1673.0", "null").replace("1773.0", "null"))
    with pytest.raises(ConfigError, match="can melt"):
        render_run(folder, ["isosurface"])
