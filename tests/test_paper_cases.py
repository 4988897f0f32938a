"""The scenes of the paper's cases are those of configs/, and their measurements measure what they say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_slm.analysis.mixing import dispersed, foreign_share, stirred
from taichi_slm.analysis.voronoi import cell_volumes
from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Config
from taichi_slm.verification.cases import spot_weld, thermal_cycle, tracks, two_fluid_column

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
