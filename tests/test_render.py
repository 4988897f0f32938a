"""Pictures of a synthetic run: made, of the right size, not blank, and with what they are meant to show."""

import subprocess
import sys
from pathlib import Path

import fake_run
import numpy as np
import pytest
from fake_run import FakeSimulation
from rich.console import Console

from taichi_slm.output.snapshots import Snapshot, spread
from taichi_slm.render import paint
from taichi_slm.render.frame import frame
from taichi_slm.render.isotherm import smooth
from taichi_slm.render.views import Clock, render_run
from taichi_slm.run import driver

PROBE = (
    "import pyvista; p = pyvista.Plotter(off_screen=True, window_size=[8, 8]); p.screenshot(return_img=True)"
)


@pytest.fixture(scope="module")
def gl():
    probe = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, check=False)
    if probe.returncode != 0:
        pytest.skip(f"no OpenGL library on this machine (apt install {driver.GL_PACKAGES})")


def run(out, monkeypatch, **changes):
    monkeypatch.setattr(driver, "_build", lambda config, *_: FakeSimulation(config))
    monkeypatch.setattr(driver, "render", lambda *_: "")
    output = {"images_at_most": 3, "history_interval": 1e-5, "snapshot_interval": 2e-5}
    parsed = fake_run.config(spacing=10e-6, end=1e-4, output=output, **changes)
    with open(out / "said.txt", "w") as file:
        return driver.execute(fake_run.loaded(parsed), out / "run", console=Console(file=file))


def pixels(path):
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def share(image, colour):
    """Share of the pixels close to ``colour``."""
    return float((np.abs(image - np.asarray(colour)).max(axis=2) < 12).mean())


def test_pictures_in_2d(tmp_path, monkeypatch, gl):
    folder = run(tmp_path, monkeypatch)
    files = render_run(folder, ["temperature", "state", "velocity", "tracer", "material"])
    assert len(files) == 15
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
    folder = run(tmp_path, monkeypatch, dimension=3, length=300e-6)
    files = render_run(folder, ["state"])
    last = pixels(files[-1])
    assert share(last, paint.UNMELTED) > 0.1
    assert last.std() > 20


def test_command(tmp_path, monkeypatch, gl):
    folder = run(tmp_path, monkeypatch)
    command = [sys.executable, "-m", "taichi_slm.render", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("6 pictures")
    assert len(list((folder / "renders").glob("*.png"))) == 6
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


def test_states_can_be_told_apart():
    arrays = {
        "position": np.zeros((5, 2)),
        "liquid_fraction": np.array([0.0, 0.0, 0.5, 0.9, 1.0]),
        "ever_liquid": np.array([0, 1, 1, 0, 1]),
    }
    colours = paint.paint("state", Snapshot(arrays, 0.0, 0, 2, 1e-6), None)
    assert len(np.unique(colours, axis=0)) == 5
    np.testing.assert_array_equal(colours[[0, 1, 4]], [paint.UNMELTED, paint.RESOLIDIFIED, paint.LIQUID])


def test_time_stamps():
    assert Clock.for_end(1.125e-3).text(2.4e-4) == "t = 0.240 ms"
    assert Clock.for_end(3e-3).text(3e-3) == "t = 3.000 ms"
    assert Clock.for_end(2.0).text(0.5) == "t = 0.500 s"
    assert Clock.for_end(50e-6).text(1e-6) == "t = 1.00 µs"


def test_film_has_every_snapshot_and_leaves_no_part_behind(tmp_path, monkeypatch, gl):
    import imageio.v2 as imageio

    from taichi_slm.output.snapshots import read_series
    from taichi_slm.render.movie import film_run

    folder = run(tmp_path, monkeypatch)
    (film,) = film_run(folder, ["state"])
    assert film == folder / "renders/state.mp4"
    assert not list((folder / "renders").glob("*.part.mp4"))
    with imageio.get_reader(film) as reader:
        frames = [np.asarray(image) for image in reader]
    assert len(frames) == len(read_series(folder / "snapshots.pvd"))
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100  # something happens
