"""Scenes against known answers: lattices, counts, packed beds, the beam's energy."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Config, Laser
from taichi_slm.errors import ConfigError
from taichi_slm.materials.tables import tabulate
from taichi_slm.scene.beam import BeamPath
from taichi_slm.scene.build import build_scene
from taichi_slm.scene.powder import powder_bed

UM = 1e-6
CONFIGS = Path(__file__).parents[1] / "configs"
PLATE = {"shape": "plate", "length": 1.2e-3, "depth": 0.33e-3}
ROW = {"shape": "powder_row", "start": 1e-4, "length": 1e-3, "radius": 25e-6}
BOX = {"shape": "box", "corner": [0, 0], "size": [1, 1]}


def scene(*bodies, dimension=2, spacing=4e-6, **keys):
    return build_scene(
        Config.model_validate(
            {"dimension": dimension, "spacing": spacing, "bodies": bodies, "time": {"end": 1e-3}, **keys}
        )
    )


def nearest(built):
    """Smallest distance of two particles over dx."""
    return cKDTree(built.position).query(built.position, k=2)[0][:, 1].min() / built.spacing


# --------------------------------------------------------------------------- lattice bodies


def test_a_droplet_without_a_program_has_no_density_to_follow():
    """It is warned of, and starts at rest; it ended in a KeyError."""
    drop = {"shape": "droplet", "centre": [0, 0], "radius": 40e-6, "follow_density": True}
    program = {"program": {"kind": "ramp", "points": [[0, 2000], [1e-3, 2500]]}}
    assert scene(drop).follows_density == ()
    assert scene(drop, drop | program | {"centre": [1e-4, 0]}).follows_density == (1,)


def test_plate_of_table_4():
    built = scene(PLATE)
    # 300 columns; the depth is 82.5 spacings, and a point on the lower edge counts: 83 layers
    assert built.count == 300 * 83
    assert built.position[:, 1].max() == pytest.approx(-2 * UM)
    assert (built.position[:, 0].min(), built.position[:, 0].max()) == pytest.approx((2 * UM, 1198 * UM))
    assert built.held.sum() == 3 * 300
    assert built.position[built.held, 1].max() < built.position[~built.held, 1].min()
    assert built.volume.sum() == pytest.approx(built.count * 16e-12)


def test_24750_particles_at_a_depth_of_whole_layers():
    assert scene({**PLATE, "depth": 330e-6, "length": 1.2e-3}, spacing=5e-6).count == 240 * 66
    assert scene({**PLATE, "depth": 300e-6, "length": 1.32e-3}).count == 24_750


def test_grains_touch_the_plate_and_each_other_on_one_lattice():
    built = scene(PLATE, ROW)
    assert nearest(built) == pytest.approx(1.0)
    grains = built.position[built.body == 1]
    assert grains[:, 1].min() == pytest.approx(2 * UM)
    assert len(grains) / 20 * 16 == pytest.approx(np.pi * 25**2, rel=0.03)
    assert (built.lower < built.position.min(0)).all()
    assert (built.upper > built.position.max(0)).all()


def test_row_cycles_materials_and_tracers():
    hot = {"hot": {"extends": "steel_304", "scale": {"conductivity": 2}}}
    built = scene(
        PLATE, {**ROW, "materials": ["steel_304", "steel_304", "hot"], "tracers": [0, 1]}, materials=hot
    )
    assert [material.name for material in built.materials] == ["steel_304", "hot"]
    for k in range(20):
        inside = (
            np.hypot(built.position[:, 0] - (125 + 50 * k) * UM, built.position[:, 1] - 25 * UM) < 20 * UM
        )
        assert set(built.material[inside]) == {k % 3 // 2}
        assert set(built.tracer[inside]) == {k % 2}


def test_three_dimensions():
    built = scene(
        {**PLATE, "length": 4e-4, "width": 2e-4, "depth": 1e-4},
        {**ROW, "length": 3e-4, "rows": 2},
        dimension=3,
        spacing=10e-6,
    )
    plate = built.position[built.body == 0]
    assert len(plate) == 40 * 20 * 10
    assert plate[:, 1].min() == pytest.approx(-95 * UM)
    assert plate[:, 1].max() == pytest.approx(95 * UM)
    assert nearest(built) == pytest.approx(1.0)


def test_container_has_its_corners():
    built = scene({"shape": "container", "corner": [0, 0], "size": [1, 2], "layers": 3}, spacing=0.1)
    assert built.count == 16 * 23 - 10 * 20
    assert built.wall.all()
    corner = (built.position < 0).all(axis=1)
    assert corner.sum() == 9


def test_the_first_body_owns_a_site():
    built = scene(BOX, {**BOX, "size": [2, 1]}, spacing=0.1)
    assert np.bincount(built.body).tolist() == [100, 100]


# --------------------------------------------------------------------------- droplets


@pytest.mark.parametrize("arrangement", ["lattice", "rings"])
def test_droplet_has_the_exact_area(arrangement):
    built = scene(
        {"shape": "droplet", "centre": [3, 4], "radius": 1, "arrangement": arrangement}, spacing=0.05
    )
    assert built.volume.sum() == pytest.approx(np.pi, rel=1e-14)
    assert built.position.mean(axis=0) == pytest.approx([3, 4])
    assert nearest(built) == pytest.approx(1.0, abs=0.03)
    assert built.volume[0] == pytest.approx(0.05**2, rel=0.01)
    if arrangement == "rings":
        assert (built.position == [3, 4]).all(axis=1).sum() == 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_near_has_near_numbers(dimension):
    """Tiles of 4^d sites, whichever bodies fill them: their particles have consecutive ids."""
    size = {"width": 12} if dimension == 3 else {}
    bodies = [{"shape": "plate", "length": 30, "depth": 10, **size},
              {"shape": "powder_row", "length": 24, "radius": 4}]  # fmt: skip
    found = scene(*bodies, dimension=dimension, spacing=1)
    tile = np.floor((found.position - found.lower) / found.spacing).astype(int) // 4
    numbers = np.arange(found.count)
    for each in np.unique(tile, axis=0):
        own = numbers[(tile == each).all(axis=1)]
        assert own[-1] - own[0] == len(own) - 1
    assert len(np.unique(found.body)) == 2


def ordered(points):
    """By their coordinates, the last first; those that differ by round-off are the same."""
    return points[np.lexsort((points / np.abs(points).max(axis=0)).round(9).T)]


@pytest.mark.parametrize("dimension", [2, 3])
def test_stretch_keeps_the_volume(dimension):
    drop = {"shape": "droplet", "centre": [0.0] * dimension, "radius": 1}
    round_, long = (scene({**drop, "stretch": e}, dimension=dimension, spacing=0.1) for e in (0.0, 0.08))
    # ids go by place; along each axis the stretch keeps the order of the points
    ratio = ordered(long.position) / ordered(round_.position)
    assert ratio.prod(axis=1) == pytest.approx(1.0)
    assert ratio[:, 0] == pytest.approx(1.08)


def test_first_temperature_and_velocity():
    program = {"kind": "ramp", "points": [[0, 1000], [0.5, 1200]]}
    built = scene(
        {**BOX, "program": program},
        {**BOX, "corner": [2, 0], "temperature": 400},
        {**BOX, "corner": [4, 0], "velocity": [1, -2]},
        spacing=0.25,
        ambient_temperature=300,
    )
    assert [set(built.temperature[built.body == k]) for k in range(3)] == [{1000}, {400}, {300}]
    assert built.velocity[built.body == 2] == pytest.approx(np.tile([1, -2], (16, 1)))
    assert list(built.programs) == [0]


# --------------------------------------------------------------------------- packed beds


@pytest.mark.parametrize("width", [None, 120e-6])
def test_packed_bed_rests_without_overlap(width):
    height = 120e-6
    grains = powder_bed(np.random.default_rng(5), 0.0, 300e-6, width, height, 15e-6, 3e-6, 9e-6, 21e-6)
    centre, radius = grains.centre, grains.radius
    gap = np.linalg.norm(centre[:, None] - centre[None], axis=-1) / (radius[:, None] + radius[None])
    np.fill_diagonal(gap, np.inf)
    assert gap.min() > 1 - 1e-6
    assert (centre[:, -1] >= radius * (1 - 1e-6)).all()
    assert (centre[:, -1] + radius).max() <= height * (1 + 1e-6)
    on_floor = centre[:, -1] < radius * (1 + 1e-6)
    below = (gap < 1 + 1e-6) & (centre[None, :, -1] < centre[:, None, -1])
    assert (on_floor | below.any(axis=1)).all()
    fill = (np.pi * radius**2).sum() / (300e-6 * height) if width is None else None
    assert fill is None or 0.6 < fill < 0.9
    assert ((radius >= 9e-6) & (radius <= 21e-6)).all()


def test_bed_is_the_same_for_the_same_seed():
    bed = {"shape": "powder_bed", "length": 3e-4, "height": 6e-5, "mean_radius": 15e-6, "std_radius": 3e-6}
    one, same, other = (scene(PLATE, bed, seed=seed) for seed in (1, 1, 2))
    assert (one.position == same.position).all()
    assert one.count != other.count or (one.position != other.position).any()
    assert nearest(one) == pytest.approx(1.0)


def test_bed_draws_its_materials_by_fraction():
    bed = {
        "shape": "powder_bed",
        "length": 3e-3,
        "height": 6e-5,
        "mean_radius": 15e-6,
        "materials": ["316L", "IN625"],
        "fractions": [0.2, 0.8],
    }
    built = scene(bed)
    share = np.mean([built.materials[m].name == "IN625" for m in built.material])
    assert share == pytest.approx(0.8, abs=0.1)


# --------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("bodies", "keys", "sentence"),
    [
        ([PLATE], {"dimension": 3}, "width is missing"),
        ([{**ROW, "radius": 1e-7}], {}, "grain of radius 1e-07 m .* no particle of its own at spacing 4e-06"),
        ([{**ROW, "rows": 2}], {}, "one row"),
        ([BOX, {**BOX, "size": [0.5, 0.5]}], {"spacing": 0.1}, "inside earlier bodies"),
        ([{**BOX, "corner": [0, 0, 0]}], {}, "coordinate"),
        ([BOX], {}, "is a unit missing"),
        ([{**BOX, "material": "316"}], {"spacing": 0.1}, "did you mean 316L"),
        ([BOX, {"shape": "droplet", "centre": [0.5, 1.1], "radius": 0.3}], {"spacing": 0.1}, "overlaps"),
        ([BOX], {"spacing": 0.1, "domain": {"lower": [0.2, 0], "upper": [2, 2]}}, "beyond the domain"),
        ([{**PLATE, "velocity": [1, 2, 3]}], {}, "velocity"),
        ([{**PLATE, "cold_layers": 90}], {}, "83 layer"),
    ],
)
def test_what_cannot_be_built_is_said(bodies, keys, sentence):
    with pytest.raises(ConfigError, match=sentence):
        scene(*bodies, **keys)


# --------------------------------------------------------------------------- beam


def beam(dimension=2, **keys):
    return BeamPath(Laser.model_validate({"power": 100, "beam_radius": 1e-5, **keys}), dimension)


def move(start, end, speed=1.0, fraction=1.0):
    return {"kind": "line", "start": [start], "end": [end], "speed": speed, "power_fraction": fraction}


PATHS = {
    "plain": {"path": [move(0, 1e-3)]},
    "varied": {"path": [move(0, 1e-3, 1, 0.5), move(1e-3, 0, 2, 1.5)], "passes": 3, "start": 1e-4},
    "pulsed": {"path": [move(0, 1e-3)], "passes": 2, "pulse": {"on": 1e-5, "off": 2.3e-5}},
    "both": {
        "path": [
            move(0, 0.001, 1, 0.5),
            {"kind": "dwell", "at": [0.001], "duration": 0.0003, "power_fraction": 0},
            move(0.001, 0, 2, 1.5),
        ],
        "passes": 5,
        "start": 1e-4,
        "pulse": {"on": 1.1e-5, "off": 2.3e-5},
    },
}


@pytest.mark.parametrize("name", PATHS)
def test_energy_is_the_sum_over_events(name):
    path = beam(**PATHS[name])
    events = [0.0]
    while (following := path.next_event(events[-1])) < np.inf:
        assert following > events[-1]
        events.append(following)
    assert events[-1] == pytest.approx(path.end)
    rng = np.random.default_rng(2)
    for t0, t1 in np.sort(rng.uniform(-1e-4, path.end + 1e-4, (200, 2)), axis=1):
        limits = [t0, *(t for t in events if t0 < t < t1), t1]
        walked = sum(path.power_fraction(0.5 * (a + b)) * (b - a) for a, b in pairwise(limits))
        assert path.energy(t0, t1) == pytest.approx(100 * walked, rel=1e-11, abs=1e-14)
        assert path.on_during(t0, t1) == (walked > 0)
    steps = np.linspace(0, path.end, 777)
    total = sum(path.energy(a, b) for a, b in pairwise(steps))
    assert total == pytest.approx(path.energy(0, path.end), rel=1e-12)


def test_position_along_the_path():
    path = beam(**PATHS["varied"])
    assert path.position(0) == path.position(1e-4) == (0.0,)
    assert path.position(6e-4) == pytest.approx((5e-4,))
    assert path.position(1.35e-3) == pytest.approx((5e-4,))
    assert path.position(1e-4 + 1.5e-3 + 2e-4) == pytest.approx((2e-4,))
    assert path.position(1.0) == (0.0,)
    assert path.end == pytest.approx(4.6e-3)


def test_a_short_pulse_in_a_long_step_keeps_its_energy():
    path = beam(path=[{"kind": "dwell", "at": [0], "duration": 1}], pulse={"on": 1e-9, "off": 0.3})
    assert path.mean_power_fraction(0.25, 0.35) * 0.1 == pytest.approx(1e-9, rel=1e-6)
    assert path.on_during(0.25, 0.35)
    assert not path.on_during(0.05, 0.25)


def test_many_segments_and_passes_cost_no_more():
    path = beam(path=[move(k % 2 * 1e-3, (k + 1) % 2 * 1e-3) for k in range(10_000)], passes=10_000)
    assert path.energy(0, path.end) == pytest.approx(100 * 1e5, rel=1e-9)
    assert path.position(path.end - 0.25e-3) == pytest.approx((0.25e-3,), abs=1e-9)
    assert path.next_event(path.end - 0.25e-3) == path.end


def test_a_path_in_the_wrong_dimension_is_said():
    with pytest.raises(ConfigError, match="2 coordinate"):
        beam(dimension=3, **PATHS["plain"])
    with pytest.raises(ConfigError, match="goes nowhere"):
        beam(path=[move(1e-3, 1e-3)])


# --------------------------------------------------------------------------- the configs that ship


@pytest.mark.parametrize("name", sorted(p.stem for p in CONFIGS.glob("*.yaml") if p.stem != "paper"))
def test_shipped_configs_build(name):
    loaded = load_config(CONFIGS / f"{name}.yaml")
    built = build_scene(loaded.config)
    assert not loaded.warnings
    assert 1000 < built.count < 100_000
    tabulate(built.materials, loaded.config.numerics.solid_density)
    if loaded.config.laser is not None:
        path = BeamPath(loaded.config.laser, loaded.config.dimension)
        assert path.end <= loaded.config.time.end


def test_the_printed_forms_are_a_base(tmp_path):
    for name in ("paper", "spot_weld_3ms"):
        (tmp_path / f"{name}.yaml").write_text((CONFIGS / f"{name}.yaml").read_text())
    scene_text = (tmp_path / "spot_weld_3ms.yaml").read_text()
    (tmp_path / "printed.yaml").write_text(f"extends: paper.yaml\n{scene_text}")
    config = load_config(tmp_path / "printed.yaml").config
    assert config.numerics.integrator == "leapfrog_printed"
    assert config.numerics.solid_density == "true"
    assert config.numerics.sound_speed == 20
    assert not config.performance.skip_solid
