"""Pictures of a synthetic run: made, of the right size, not blank, and with what they are meant to show."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fake_run import driven, pixels, share
from scipy.spatial import cKDTree

from taichi_slm.errors import ConfigError, StorageError
from taichi_slm.output.snapshots import Snapshot, read_series, read_snapshot, spread, write_series
from taichi_slm.render import paint
from taichi_slm.render.frame import frame
from taichi_slm.render.isotherm import smooth
from taichi_slm.render.movie import GIF_BYTES, film_run
from taichi_slm.render.particles import FINE, Particles
from taichi_slm.render.views import Clock, Studio, open_run, render_run, scales


def test_pictures_in_2d(tmp_path, monkeypatch, gl):
    folder = driven(tmp_path, monkeypatch)
    files = render_run(folder, ["temperature", "state", "velocity", "surface_force", "tracer", "material"])
    assert len(files) == 18
    assert files[0] == folder / "renders/temperature_000000.png"
    images = {path.stem: pixels(path) for path in files}
    assert len({image.shape for image in images.values()}) == 1  # the same camera throughout
    assert images["state_000005"].shape == (1228, 1676, 3)  # 1000 px of metal, header and footer
    first, last = images["state_000000"], images["state_000005"]
    assert share(first, paint.UNMELTED) > 0.5
    assert share(first, paint.LIQUID) < 0.01  # only in the key
    assert share(last, paint.LIQUID) > 0.01
    assert share(last, paint.RESOLIDIFIED) > 0.002
    assert share(images["temperature_000005"], [255, 255, 255]) < 0.5
    for image in images.values():
        assert image.std() > 20
        assert (image[:8] == 255).all()  # nothing is cut off at the edges
        assert (image[:, :8] == 255).all()
        assert (image[:, -8:] == 255).all()


def test_pictures_in_3d(tmp_path, monkeypatch, gl):
    folder = driven(tmp_path, monkeypatch, dimension=3, length=300e-6)
    files = render_run(folder, ["state"])
    last = pixels(files[-1])
    assert share(last, paint.UNMELTED) > 0.1
    assert last.std() > 20


def test_command(tmp_path, monkeypatch, gl):
    folder = driven(tmp_path, monkeypatch)
    command = [sys.executable, "-m", "taichi_slm.render", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("6 pictures")
    every = {file.name: file.read_bytes() for file in (folder / "renders").glob("*.png")}
    assert len(every) == 6
    shutil.rmtree(folder / "renders")
    for number in ("0", "1"):  # of two processes: together the same pictures
        subprocess.run([*command, number, "2"], check=True, stdout=subprocess.DEVNULL)
        assert (len(list((folder / "renders").glob("*.png"))) < 6) == (number == "0")
    assert {file.name: file.read_bytes() for file in (folder / "renders").glob("*.png")} == every
    script = Path(__file__).parents[1] / "scripts/make_results.py"
    written = [sys.executable, str(script), str(folder.parent), "--docs", str(tmp_path / "docs")]
    done = subprocess.run(written, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    results = (tmp_path / "docs/results.md").read_text()
    assert "| [comet](#comet) |" in results
    assert "images/comet_state_000005.png" in results
    assert (tmp_path / "docs/images/comet_state_000005.png").stat().st_size > 5000
    command[-1] = str(tmp_path / "none")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode in (2, 4)
    assert "Traceback" not in done.stderr


def test_evenly_chosen_with_both_ends():
    items = list(range(41))
    assert spread(items, 12) == [0, 4, 7, 11, 15, 18, 22, 25, 29, 33, 36, 40]
    assert spread(items[:3], 12) == [0, 1, 2]
    assert spread(items, 1) == [40]
    assert spread(items, 0) == []


def test_isotherm_is_where_it_is_known():
    dx = 4e-6
    x, y = np.meshgrid((np.arange(100) + 0.5) * dx, -(np.arange(50) + 0.5) * dx, indexing="ij")
    position = np.stack([x.ravel(), y.ravel()], axis=1)
    radius = np.linalg.norm(position - [200e-6, 0.0], axis=1)
    field = smooth(position, 3000.0 - 1e7 * radius, dx, 500.0)
    (line,) = field.lines(1723.0)
    error = np.linalg.norm(line - [200e-6, 0.0], axis=1) - 127.7e-6
    deep = line[:, 1] < -3 * dx
    assert np.abs(error[deep]).max() < 0.1 * dx
    assert np.abs(error).max() < 0.7 * dx  # the kernel is cut off at the surface
    assert field.lines(5000.0) == []
    assert smooth(position, np.full(len(position), 293.0), dx, 500.0) is None


def test_frame_maps_points_to_pixels():
    seen = frame(np.array([[0.0, -0.33e-3], [1.2e-3, 0.05e-3]]), 0.0)
    low, high = seen.pixels(np.array([[0.0, -0.33e-3, 0.0], [1.2e-3, 0.05e-3, 0.0]]))
    assert high[0] - low[0] == pytest.approx(1.2e-3 * seen.scale)
    assert low[0] == pytest.approx(40, abs=1)
    assert low[1] == pytest.approx(150, abs=2)
    assert seen.window[0] == 1800


@pytest.mark.parametrize("pixels_wide", [5.0, 12.0])
def test_metal_has_no_gaps(pixels_wide):
    """Every point inside, in the lattice, in loose melt and between them, is in a disc or a square that is drawn."""
    dx, n = 4e-6, 40
    position = (
        np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2) + 0.5
    ) * dx
    molten = position[:, 0] > 0.5 * n * dx
    rng = np.random.default_rng(1)
    position[molten] += rng.uniform(-0.15 * dx, 0.15 * dx, (molten.sum(), 2))
    arrays = {"position": position, "ever_liquid": molten.astype(np.uint8)}
    drawn = Particles(Snapshot(arrays, time=0.0, step=0, dimension=2, spacing=dx), pixels_wide)
    points = rng.uniform(3.0 * dx, (n - 3.0) * dx, (20_000, 2))
    covered = np.zeros(len(points), bool)
    for mesh, corners in ((drawn.backing, 4), (drawn.mesh, drawn.mesh.n_points // drawn.mesh.n_cells)):
        outlines = np.asarray(mesh.points).reshape(-1, corners, 3)[:, :, :2]
        centres, reach = outlines.mean(axis=1), np.abs(outlines - outlines.mean(axis=1)[:, None]).max(axis=1)
        for number, near in enumerate(cKDTree(centres).query_ball_point(points, 1.1 * dx)):
            away = np.abs(points[number] - centres[near])
            inside = (
                (away < reach[near]).all(axis=1)
                if corners == 4
                else np.hypot(*away.T) < 0.97 * reach[near, 0]
            )
            covered[number] |= inside.any()
    assert covered.all()
    share_of_discs = drawn.mesh.n_cells / len(position)
    assert share_of_discs == 1.0 if pixels_wide > FINE else share_of_discs < 0.4


def test_states_can_be_told_apart():
    arrays = {
        "position": np.zeros((5, 2)),
        "liquid_fraction": np.array([0.0, 0.0, 0.5, 0.9, 1.0]),
        "ever_liquid": np.array([0, 1, 1, 0, 1]),
    }
    colours = paint.paint("state", Snapshot(arrays, 0.0, 0, 2, 1e-6), None)
    assert len(np.unique(colours, axis=0)) == 5
    np.testing.assert_array_equal(colours[[0, 1, 4]], [paint.UNMELTED, paint.RESOLIDIFIED, paint.LIQUID])


def test_surface_force_is_shown_as_an_acceleration(tmp_path, monkeypatch):
    folder = driven(tmp_path, monkeypatch)
    config, kinds, series = open_run(folder, ["surface_force"])
    assert kinds == ["surface_force"]
    last = read_snapshot(series[-1])
    found = scales(folder, config, [last])
    assert found.force == 1e6  # 7e9 N/m^3 over 7000 kg/m^3
    colours = paint.paint("surface_force", last, found)
    solid = last.arrays["liquid_fraction"] == 0.0
    assert (colours[solid] == paint.GREY).all()
    assert len(np.unique(colours[last.arrays["liquid_fraction"] == 1.0], axis=0)) == 1
    title = paint.key("surface_force", found, 2)
    assert title.title.endswith("[µm/µs²]")
    assert title.ticks[-1] == (1.0, "1")


def test_pictures_of_a_force_that_there_is_not_are_a_sentence(tmp_path, monkeypatch):
    folder = driven(tmp_path, monkeypatch, physics={"surface_tension": False, "marangoni": False})
    with pytest.raises(ConfigError, match="surface tension, which is off"):
        render_run(folder, ["surface_force"])


def test_close_up_shows_the_box_and_nothing_else(tmp_path, monkeypatch, gl):
    folder = driven(tmp_path, monkeypatch)
    config, _, series = open_run(folder)
    snapshot = read_snapshot(series[-1])
    box = np.array([[100e-6, -50e-6], [300e-6, 60e-6]])
    studio = Studio(folder, config, [snapshot], box)
    ((_, image),) = studio.draw(snapshot, ["state"])
    low, high = studio.whole.pixels(np.column_stack([box, [0.0, 0.0]]))
    studio.close()
    assert studio.whole.scale > 5e6  # px/m: 200 um fill more than 1000 px
    metal = np.argwhere((image[80:-160] < 250).any(axis=2))[:, 1]
    assert metal.min() >= low[0] - 0.7 * 10e-6 * studio.whole.scale
    assert metal.max() <= high[0] + 0.7 * 10e-6 * studio.whole.scale


@pytest.mark.parametrize("name", ["paper_figures", "gallery", "make_results"])
def test_scripts_without_runs_end_with_a_sentence(tmp_path, name):
    script = Path(__file__).parents[1] / f"scripts/{name}.py"
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), "--docs", str(tmp_path / "docs")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("no finished run")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "docs").exists()


def test_time_stamps():
    assert Clock.for_end(1.125e-3).text(2.4e-4) == "t = 0.240 ms"
    assert Clock.for_end(3e-3).text(3e-3) == "t = 3.000 ms"
    assert Clock.for_end(2.0).text(0.5) == "t = 0.500 s"
    assert Clock.for_end(50e-6).text(1e-6) == "t = 1.00 µs"


def test_film_has_every_snapshot_and_leaves_no_part_behind(tmp_path, monkeypatch, gl):
    import imageio.v2 as imageio

    folder = driven(tmp_path, monkeypatch)
    (film,) = film_run(folder, ["state"])
    assert film == folder / "renders/state.mp4"
    assert not list((folder / "renders").glob("*.part.mp4"))
    with imageio.get_reader(film) as reader:
        frames = [np.asarray(image) for image in reader]
    assert len(frames) == len(read_series(folder / "snapshots.pvd"))
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100  # something happens


def test_gif_has_every_snapshot_and_the_colours_of_the_picture(tmp_path, monkeypatch, gl):
    from PIL import Image, ImageSequence

    folder = driven(tmp_path, monkeypatch)
    (film,) = film_run(folder, ["state"], gif=True)
    assert film == folder / "renders/state.gif"
    assert film.stat().st_size < GIF_BYTES
    with Image.open(film) as gif:
        frames = [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(gif)]
    assert len(frames) == len(read_series(folder / "snapshots.pvd"))
    picture = pixels(render_run(folder, ["state"])[-1])
    for colour in (paint.UNMELTED, paint.LIQUID, paint.RESOLIDIFIED):
        # edges, which are mixed colours, are a larger part of a narrower picture: the rest is the same
        assert share(frames[-1], colour) == pytest.approx(share(picture, colour), rel=0.3)


def test_a_gif_gets_narrower_until_it_fits(tmp_path, monkeypatch):
    from PIL import Image

    from taichi_slm.render import movie

    noise = np.random.default_rng(0).integers(0, 255, (20, 900, 3), dtype=np.uint8)  # does not compress
    widths = {}
    for most in (10**9, 10_000, 1):
        monkeypatch.setattr(movie, "GIF_BYTES", most)
        film = movie._Gif(tmp_path / "noise.gif")
        film.add(noise)
        film.finish()
        widths[most] = Image.open(tmp_path / "noise.gif").width
        assert film.path.stat().st_size <= most or widths[most] == 320
    assert widths[10**9] == 800
    assert 320 < widths[10_000] < 800
    assert widths[1] == 320


@pytest.mark.parametrize("kind", ["cut", "isosurface", "streamlines", "temprature"])
def test_a_picture_that_there_is_not_is_a_sentence(tmp_path, monkeypatch, kind):
    folder = driven(tmp_path, monkeypatch)
    with pytest.raises(ConfigError) as raised:
        render_run(folder, [kind])
    said = str(raised.value)
    assert said.count("\n") == 0
    assert kind in said
    assert ("3-D only" in said) == (kind != "temprature")
    with pytest.raises(ConfigError):
        film_run(folder, [kind])
    shown = subprocess.run(
        [sys.executable, "-m", "taichi_slm.cli", "render", str(folder), "--kind", kind],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (shown.returncode, shown.stderr) == (2, said + "\n")


def test_a_run_without_snapshots_is_a_sentence(tmp_path, monkeypatch):
    folder = driven(tmp_path, monkeypatch)
    for path in (folder / "snapshots").iterdir():
        path.unlink()
    write_series(folder / "snapshots.pvd", [])
    for draw in (render_run, film_run):
        with pytest.raises(StorageError, match="no snapshots to draw"):
            draw(folder)
