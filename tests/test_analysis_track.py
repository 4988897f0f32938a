"""Tracks of known section, profile, bond, pores and powder."""

import numpy as np
import pytest
from moments import DENSITY, lattice, moment

from taichi_slm.analysis.metal import enclosed_voids, grid_axes, metal_field, upper_surface
from taichi_slm.analysis.roughness import middle, roughness, waviness
from taichi_slm.analysis.track import examine_track

UM = 1e-6
DX = 4 * UM


def track_of(position, melted, **more):
    """What is found where the particles above height 0 were powder, and those ``melted`` have frozen."""
    first = moment(position, DX)
    return examine_track(first, moment(position, DX, 1.0, ever_liquid=melted, **more))


# --------------------------------------------------------------------------- roughness


EVERYWHERE = slice(None)


def measured(height, kept=EVERYWHERE):
    inside = np.zeros(len(height), bool)
    inside[kept] = True
    return roughness(height, inside)


def test_roughness_of_a_sine():
    """Ra = 2 A/pi, Rq = A/sqrt(2), Rz = 2 A, and so the primary profile: of a wave of a sixtieth of the cut-off the
    filter keeps all; 300 of 200 points: the sums are exact to (pi/200)^2/6, the highest
    of them to (pi/200)^2/2."""
    A, x = 7.0 * UM, (np.arange(100_000) + 0.5) / 200
    found = measured(50 * UM + A * np.sin(2 * np.pi * x), slice(20_000, 80_000))
    for kind in "RP":
        assert found[f"{kind}a_m"] == pytest.approx(2 * A / np.pi, rel=1e-4)
        assert found[f"{kind}q_m"] == pytest.approx(A / np.sqrt(2), rel=1e-4)
    assert found["Rz_m"] == pytest.approx(2 * A, rel=2e-4)
    assert found["Pt_m"] == pytest.approx(2 * A, rel=2e-4)


@pytest.mark.parametrize("cutoffs", [0.5, 1.0, 2.0])
def test_the_filter_passes_what_the_standard_says(cutoffs):
    """A wave of n cut-offs keeps 1 - exp(-pi (alpha/n)^2), alpha^2 = ln 2/pi (ISO 16610-21): a half at n = 1.

    To 5e-4: the kernel ends at four standard deviations, and 6e-5 of its area lies beyond.
    """
    n = 40_000
    x = (np.arange(n) + 0.5) / n
    inside = (x >= 0.25) & (x <= 0.75)
    sine = np.sin(2 * np.pi * x / (0.1 * cutoffs))
    kept = 1 - np.exp(-np.log(2.0) / cutoffs**2)
    found = roughness(sine, inside)
    assert found["Rq_m"] == pytest.approx(kept * np.sqrt(np.mean(sine[inside] ** 2)), rel=5e-4 / kept)


def test_a_slope_is_form_and_no_roughness():
    """A track that falls by 50 um over its length: half of that on average below or above the mean (Pt 40, Pa 10, Pq
    40/sqrt(12) um over the middle 80 %), and nothing of it rough, for a filter keeps a straight line as it is.

    To 1e-3 of the fall: the filter's kernel at the rim of the evaluation length lacks 4e-4 of its area.
    """
    x = np.linspace(0.0, 1.0, 10_001)
    found = roughness(50 * UM * (1.0 - x), middle(x, 0.0, 1.0))
    assert found["Rz_m"] < 0.05 * UM
    assert found["Ra_m"] < found["Rz_m"]
    assert found["Pt_m"] == pytest.approx(40 * UM, rel=1e-3)
    assert found["Pa_m"] == pytest.approx(10 * UM, rel=1e-3)
    assert found["Pq_m"] == pytest.approx(40 * UM / np.sqrt(12), rel=1e-3)


def test_rz_is_the_mean_of_five_sampling_lengths_and_pt_the_whole():
    """One spike of 10 on a flat profile stands in one of five sampling lengths; the filter takes 1/(sigma sqrt(2 pi))
    of its height away, 1/(0.46972 cut-off) in steps of 20."""
    z = np.zeros(100)
    z[50] = 10.0
    found = measured(z)
    taken = 1 / (np.sqrt(np.log(2) / np.pi) * 20)
    assert found["Rz_m"] == pytest.approx(
        10.0 / 5, rel=0.01
    )  # the spike, and the dent beside it that is as deep
    assert found["Pt_m"] == pytest.approx(10.0)
    assert waviness(z, 20.0)[50] == pytest.approx(10.0 * taken, rel=1e-3)
    assert all(np.isnan(value) for value in measured(np.arange(4.0)).values())


def test_a_gap_in_the_profile_has_no_weight():
    """A level track stays level around a place without height."""
    z = np.full(100, 7.0)
    z[30:40] = np.nan
    assert measured(z)["Rz_m"] == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(waviness(z, 20.0)[30:40]).all()


def test_the_ends_are_left_out():
    x = np.linspace(0.0, 10.0, 11)
    assert x[middle(x, 0.0, 10.0)].tolist() == list(range(1, 10))


def waves(amplitude):
    """A plate with a bead of height 60 um + A sin(2 pi x/L), 20 um deep and 2 mm long; seven waves in its middle 80 %.

    L is 57.1 dx, no multiple of it, so that the staircase of the lattice is not in step with the sine.
    """
    position = lattice(DX, (-400 * UM, -80 * UM), (2400 * UM, 120 * UM))
    x, z = position.T
    top = 60 * UM + amplitude * np.sin(2 * np.pi * (x - 200 * UM) * 7 / (1600 * UM))
    bead = (x > 0.0) & (x < 2000 * UM)
    kept = (z < 0.0) | (bead & (z < top))
    return position[kept], (bead & (z > -20 * UM))[kept]


def test_the_profile_of_particles():
    """A lattice cut along a sine is a staircase, off by dx/sqrt(12) rms and dx/4 on average; no norm of the profile can
    be off by more (triangle inequality), and each extreme by half a step."""
    A = 30 * UM
    track = track_of(*waves(A))
    found, x = track.chief, track.table["x_m"]
    inside = middle(x, 0.0, 2000 * UM)
    sine = 60 * UM + A * np.sin(2 * np.pi * (x - 200 * UM) * 7 / (1600 * UM))
    assert np.sqrt(np.mean((track.table["height_m"] - sine)[inside] ** 2)) < DX / np.sqrt(12)
    assert found["Pq_m"] == pytest.approx(A / np.sqrt(2), abs=DX / np.sqrt(12))
    assert found["Pa_m"] == pytest.approx(2 * A / np.pi, abs=DX / 4)
    assert found["Pt_m"] == pytest.approx(2 * A, abs=DX)
    kept = 1 - np.exp(-np.log(2.0) * (7 / 5) ** 2)  # seven waves in five cut-offs
    assert found["Rq_m"] == pytest.approx(kept * A / np.sqrt(2), abs=DX / np.sqrt(12))
    assert found["mean_height_m"] == pytest.approx(60 * UM, abs=0.1 * DX)
    assert found["mean_depth_m"] == pytest.approx(20 * UM, abs=0.02 * DX)
    assert found["length_m"] == pytest.approx(2000 * UM, abs=0.1 * DX)


def test_a_flat_bead_on_the_lattice_has_no_roughness():
    """Its surface is found where it is, to the wiggle of the smoothed lattice (below 0.1 % of dx)."""
    found = track_of(*waves(0.0)).chief
    assert found["Pt_m"] < 0.01 * DX
    assert found["mean_height_m"] == pytest.approx(60 * UM, abs=0.01 * DX)
    assert found["fused_share"] == pytest.approx(1.0)
    assert found["pores"] == 0


# --------------------------------------------------------------------------- dilution, bond, powder


def test_dilution_of_a_half_ellipse():
    """The plate remelted to an ellipse of semi-axes a, b below; the bead an ellipse of a, c above: D = b/(b + c).
    A lattice counts an area of radius R with an error of some 0.5 (dx/R)^1.5: 0.5 (4/40)^1.5 = 1.6 %."""
    a, b, c = 400 * UM, 60 * UM, 40 * UM
    position = lattice(DX, (-600 * UM, -120 * UM), (600 * UM, 80 * UM))
    x, z = position.T
    ellipse = (x / a) ** 2 + (z / np.where(z > 0, c, b)) ** 2 < 1.0
    kept = (z < 0.0) | ellipse
    found = track_of(position[kept], ellipse[kept]).chief
    assert found["area_below_m2"] == pytest.approx(np.pi / 2 * a * b, rel=0.016)
    assert found["area_above_m2"] == pytest.approx(np.pi / 2 * a * c, rel=0.016)
    assert found["dilution"] == pytest.approx(b / (b + c), rel=0.016)
    assert found["dilution_by_origin"] == pytest.approx(b / (b + c), rel=0.016)
    assert found["max_depth_m"] == pytest.approx(b, abs=0.6 * DX)
    assert found["max_height_m"] == pytest.approx(c, abs=0.6 * DX)


def test_half_of_the_track_is_not_fused():
    """A bead of 800 um; the plate under its right half was remelted 12 um deep."""
    position = lattice(DX, (-600 * UM, -80 * UM), (600 * UM, 40 * UM))
    x, z = position.T
    bead = np.abs(x) < 400 * UM
    kept = (z < 0.0) | bead
    melted = (bead & (z > 0.0)) | (bead & (x > 0.0) & (z > -12 * UM))
    found = track_of(position[kept], melted[kept]).chief
    assert found["fused_share"] == pytest.approx(0.5, abs=DX / (800 * UM))
    assert found["unfused_length_m"] == pytest.approx(400 * UM, abs=DX)


def test_powder_that_never_melted_and_a_piece_that_hangs_on_nothing():
    """Three blocks: a track, powder of 6 x 6 particles on the plate, and 5 x 4 particles of frozen metal in the air."""
    plate = lattice(DX, (-400 * UM, -80 * UM), (400 * UM, 0.0))
    bead = lattice(DX, (-200 * UM, 0.0), (200 * UM, 40 * UM))
    powder = lattice(DX, (240 * UM, 0.0), (264 * UM, 24 * UM))
    drop = lattice(DX, (300 * UM, 100 * UM), (320 * UM, 116 * UM))
    position = np.concatenate([plate, bead, powder, drop])
    x, z = position.T
    melted = ((np.abs(x) < 200 * UM) & (z > -20 * UM)) | (z > 90 * UM)
    found = track_of(position, melted).chief
    one = DENSITY * DX**2
    assert (found["powder_particles"], found["unmelted_powder_particles"]) == (1000 + 36 + 20, 36)
    assert found["unmelted_powder_share"] == pytest.approx(36 / 1056)
    assert found["unmelted_powder_kg_m"] == pytest.approx(36 * one)
    assert (found["loose_pieces"], found["loose_kg_m"]) == (1, pytest.approx(20 * one))
    assert found["length_m"] == pytest.approx(400 * UM, abs=0.1 * DX)  # without the piece in the air


def test_a_section_in_3d():
    """A bead 48 um wide, 24 um high and 12 um deep, 240 um long: widths and areas of its sections."""
    position = lattice(DX, (-160 * UM, -80 * UM, -40 * UM), (160 * UM, 80 * UM, 32 * UM))
    x, y, z = position.T
    bead = (np.abs(x) < 120 * UM) & (np.abs(y) < 24 * UM) & (z < 24 * UM) & (z > -12 * UM)
    kept = (z < 0.0) | bead
    found = track_of(position[kept], bead[kept])
    inside = np.abs(found.table["x_m"]) < 100 * UM  # smoothing rounds the ends within 4 sigma = 10 um
    section = {name: values[inside] for name, values in found.table.items()}
    assert section["height_m"] == pytest.approx(24 * UM, abs=0.01 * DX)
    assert section["crest_m"] == pytest.approx(24 * UM, abs=0.01 * DX)
    assert section["depth_m"] == pytest.approx(12 * UM, abs=0.02 * DX)
    assert section["width_m"] == pytest.approx(48 * UM, abs=0.02 * DX)
    assert section["area_above_m2"] == pytest.approx(48 * 24 * UM**2, rel=0.005)
    assert section["area_below_m2"] == pytest.approx(48 * 12 * UM**2, rel=0.005)
    assert found.chief["dilution"] == pytest.approx(1 / 3, rel=0.005)
    assert found.chief["fused_share"] == pytest.approx(1.0)


def test_nothing_has_melted():
    position, melted = waves(0.0)
    found = track_of(position, np.zeros_like(melted))
    assert found.chief["track_particles"] == 0
    assert all(len(values) == 0 for values in found.table.values())


# --------------------------------------------------------------------------- the surface and the voids


@pytest.mark.parametrize("radius", [6, 12])
def test_a_pore_of_known_area(radius):
    """The contour of a smoothed round hole lies 0.6^2 dx^2/(2 R) inside it, plus the sixth of a cell^2 that laying on
    the grid adds: area -(0.36 + 0.08) (dx/R)^2; a lattice counts a disc to 0.5 (dx/R)^1.5."""
    position = lattice(DX, (-160 * UM, -160 * UM), (160 * UM, 0.0))
    hole = ((position - np.array([1.3 * UM, -79 * UM])) ** 2).sum(axis=1) < (radius * DX) ** 2
    bead = np.abs(position[:, 0]) < 120 * UM
    found = track_of(position[~hole], bead[~hole]).chief
    area = np.pi * (radius * DX) ** 2
    assert (found["pores"], found["unfused_voids"]) == (1, 0)
    assert found["pore_area_m2"] == pytest.approx(area, rel=0.44 / radius**2 + 0.5 / radius**1.5)
    assert found["largest_pore_area_m2"] == found["pore_area_m2"]


def test_a_gap_beside_metal_that_never_melted_is_lack_of_fusion():
    position = lattice(DX, (-160 * UM, -160 * UM), (160 * UM, 40 * UM))
    x, z = position.T
    gap = (np.abs(x) < 40 * UM) & (z > 0.0) & (z < 12 * UM)
    pore = (np.abs(x - 100 * UM) < 12 * UM) & (np.abs(z) < 12 * UM)
    kept = ~gap & ~pore
    melted = (z > 0.0) | ((x > 60 * UM) & (z > -40 * UM))
    found = track_of(position[kept], melted[kept]).chief
    assert (found["pores"], found["unfused_voids"]) == (1, 1)
    # corners are rounded off by 0.6 dx: (1 - pi/4) 4 r^2 with r about 2 x 0.6 dx, of an area of 60 dx^2: 2 %
    assert found["unfused_void_area_m2"] == pytest.approx(80 * 12 * UM**2, rel=0.03)
    assert found["pore_area_m2"] == pytest.approx(24 * 24 * UM**2, rel=0.03)


def test_a_hollow_ball():
    """In 3-D the surface of a hole has two curvatures: -2 x (3/2) 0.44 (dx/R)^2 of its volume, and counting."""
    R = 6
    position = lattice(1.0, (-14.0,) * 3, (14.0,) * 3)
    position = position[(position**2).sum(axis=1) >= R**2]
    axes = grid_axes(position.min(axis=0), position.max(axis=0), 1.0)
    field = metal_field(position, np.ones(len(position)), axes, 1.0)
    voids = enclosed_voids(field, np.zeros((0, 3)), 1.0)
    assert voids.volume == pytest.approx([4 / 3 * np.pi * R**3], rel=3 * 0.44 / R**2 + 0.01)
    assert voids.centre[0] == pytest.approx(np.zeros(3), abs=0.05)


def test_one_missing_particle_is_no_void():
    position = lattice(1.0, (0.0, 0.0), (20.0, 20.0))
    position = np.delete(position, 20 * 10 + 10, axis=0)
    axes = grid_axes(position.min(axis=0), position.max(axis=0), 1.0)
    field = metal_field(position, np.ones(len(position)), axes, 1.0)
    assert len(enclosed_voids(field, np.zeros((0, 2)), 1.0).volume) == 0


def test_a_slope_is_found_where_it_is():
    """A surface of slope 1/3 cut from a lattice repeats its staircase every 3 dx; its mean is dx/2 above the lowest
    lattice line that the cut leaves in: here the cut passes the centres, so the surface lies dx/6 higher on average."""
    position = lattice(1.0, (0.0, -20.0), (60.0, 30.0))
    x, z = position.T
    position = position[z < x / 3]
    axes = grid_axes(position.min(axis=0), position.max(axis=0), 1.0)
    found = upper_surface(metal_field(position, np.ones(len(position)), axes, 1.0))
    inside = (axes[0] > 10) & (axes[0] < 50)
    column = (
        np.floor(np.arange(60.0)[:, None] / 1.0 + 0.5) / 3
    )  # height of the cut in the middle of each column
    count = np.ceil(column[:, 0] + 1 / 6 - 0.5)  # whole particles below it
    mean = (count[10:49] - (np.arange(10, 49) + 0.5) / 3).mean()
    error = found[inside] - axes[0][inside] / 3
    assert error.mean() == pytest.approx(mean, abs=0.02)
    assert np.abs(error - mean).max() < 0.25  # of the staircase of 1 dx
