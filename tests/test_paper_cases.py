"""The scenes of the paper's cases are those of configs/, and their measurements measure what they say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_slm.analysis.mixing import dispersed, foreign_share, stirred
from taichi_slm.analysis.voronoi import cell_volumes
from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Config
from taichi_slm.output.atomic import write_json
from taichi_slm.run.run_folder import read_json
from taichi_slm.verification.case import Outcome
from taichi_slm.verification.cases import (
    simonds_spot,
    spot_weld,
    thermal_cycle,
    tracks,
    trapp_tracks,
    two_fluid_column,
)
from taichi_slm.verification.measured import table
from taichi_slm.verification.pools import VARIANTS, watch_pool
from taichi_slm.verification.verify import judged

CONFIGS = Path(__file__).parents[1] / "configs"


def physical(config: Config) -> dict[str, Any]:
    """All that decides what is computed: no title, no files, no sources of numbers."""
    return bare(config.model_dump(exclude={"title", "output"}))


def bare(value: Any) -> Any:
    """The same without the keys that say where a number is from."""
    if isinstance(value, dict):
        return {key: bare(each) for key, each in value.items() if key not in ("source", "sources")}
    return [bare(each) for each in value] if isinstance(value, (list, tuple)) else value


@pytest.mark.parametrize(
    ("name", "scene"),
    [
        ("droplet_thermal_cycle", thermal_cycle.scene),
        ("column_two_fluids", two_fluid_column.scene),
        ("spot_weld_3ms", spot_weld.scene),
        *((f"track_{power}W", lambda power=power: tracks.scene(power)) for power in (50, 100, 150, 200)),
        ("track_doped", lambda: tracks.scene(100, tracks.DOPED)),
        ("track_tracers", lambda: tracks.scene(150, tracks.MARKED)),
    ],
)
def test_the_scene_of_a_case_is_the_shipped_one(name, scene):
    assert physical(scene()) == physical(load_config(CONFIGS / f"{name}.yaml").config)


# --------------------------------------------------------------------------- measurements


@pytest.mark.parametrize("dimension", [2, 3])
def test_cells_of_a_lattice_are_its_cells(dimension):
    """Inside every cell is dx^d; at the rim a cell has no end; a random set fills its box, mirrors given."""
    axis = np.arange(6) * 0.5
    x = np.stack(np.meshgrid(*[axis] * dimension), axis=-1).reshape(-1, dimension)
    inside = ((x > 0.4) & (x < 2.1)).all(axis=1)
    volume = cell_volumes(x)
    assert volume[inside] == pytest.approx(0.5**dimension)
    assert np.isnan(volume[~inside]).all()
    x = np.random.default_rng(3).random((80, dimension))
    images = [x] + [
        np.where(np.arange(dimension) == k, 2 * side - x, x) for k in range(dimension) for side in (0, 1)
    ]
    assert cell_volumes(np.concatenate(images))[:80].sum() == pytest.approx(1.0)


def test_volume_errors_of_a_disc_are_what_is_put_in():
    """Cells inside a lattice are dx^2: areas that should be larger by a twentieth give an error of 1/1.05 - 1."""
    axis = np.arange(-20, 21) * 0.05
    x = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    x = x[np.linalg.norm(x, axis=1) < 1.0] + [3.0, -2.0]
    exact = np.full(len(x), 0.05**2)
    assert thermal_cycle.volume_errors(x, exact) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert thermal_cycle.volume_errors(x, 1.05 * exact) == pytest.approx((1 / 1.05 - 1,) * 2)


def test_mixing_of_made_up_particles():
    """Two halves, stripes two particles thick, a chess board and a random deal."""
    x = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), axis=-1).reshape(-1, 2)
    halves = (x[:, 1] >= 20).astype(int)
    share = foreign_share(x, halves, 1.0)
    border = (np.abs(x[:, 1] - 19.5) < 1) & (x[:, 0] > 0) & (x[:, 0] < 39)
    assert share[border] == pytest.approx(3 / 8)
    assert (share[np.abs(x[:, 1] - 19.5) > 1] == 0).all()
    assert dispersed(x, halves, 1.0) == 0.0
    stripes = (x[:, 1] // 2 % 2).astype(int)
    assert dispersed(x, stripes, 1.0) == 0.0
    lines = (x[:, 1] % 4 == 1).astype(int)
    assert dispersed(x, lines, 1.0) == 1.0
    quarter = (x[:, 0] < 10).astype(int)
    assert dispersed(x, quarter, 1.0) == 0.0
    assert stirred(x, quarter, 1.0) > 0.8  # most of 8 neighbours are of the other three quarters
    assert np.isnan(dispersed(x, np.zeros(len(x), int), 1.0))


# --------------------------------------------------------------------------- the measured pools


@pytest.mark.parametrize("changes", [{}, *VARIANTS.values()], ids=["full", *VARIANTS])
def test_measured_scenes_are_valid_and_take_what_was_measured(changes):
    """Power, spot and absorptivity are those of the tables; a variant changes only what it names."""
    spot = simonds_spot.scene(**changes)
    assert spot.laser.power == pytest.approx(120.0)
    irradiance = spot.laser.power / (np.pi * spot.laser.beam_radius**2) * 1e-10  # [MW/cm^2]
    assert irradiance == pytest.approx(table("simonds2018_316L_spot")[0]["irradiance_MW_cm2"], rel=0.03)
    assert spot.laser.absorptivity == 0.31
    for row in table("trapp2017_316L_tracks"):
        track = trapp_tracks.scene(int(row["power_W"]), **changes)
        assert track.laser.beam_radius == pytest.approx(30e-6)
        assert track.laser.absorptivity == row["absorptivity"]
        assert track.time.end == pytest.approx(2e-4 / 0.5)
        assert track.physics.model_dump() == spot.physics.model_dump()


def test_a_pool_is_watched_until_its_scene_is_finished(track):
    """The sizes grow while the beam is on; what is solid again is the track; the run ends by itself."""
    found, sim = watch_pool(track(time={"end": 5e-4}), np.arange(1, 101) * 5e-6, threads=1)
    assert sim.finished
    assert not found.failure
    assert len(found.time) < 100
    assert found.length.max() > 20e-6
    assert np.isnan(found.width).all()
    assert found.length[-1] == 0.0
    assert found.track.still_liquid == 0
    assert found.track.particles > 10
    assert found.energy_error < 1e-5
    assert found.mean("length", 0.0, 30e-6) == pytest.approx(found.length[found.time <= 30e-6].mean())
    assert np.isnan(found.mean("length", 1.0))


def test_a_number_that_is_not_finite_keeps_no_limit_in_a_file_either(tmp_path):
    outcome = Outcome()
    outcome.judge("lost", np.nan, 1.0, limit=0.1, why="a run that blew up")
    outcome.at_least("lost too", np.nan, limit=0.0, why="a run that blew up")
    outcome.at_least("there", 1.0, limit=0.0, why="it did not")
    write_json(tmp_path / "outcome.json", outcome.to_json())
    rows = Outcome.from_json(read_json(tmp_path / "outcome.json")).rows
    assert [row.holds for row in rows] == [False, False, True]
    assert [judged(row) for row in rows][1:] == ["not finite, at least 0", "1, at least 0"]
