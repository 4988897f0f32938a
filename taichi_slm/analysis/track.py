"""The solid track at the end of a run: its sections, what it is bonded to, what it encloses; docs/analysis.md."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.analysis.melt_pool import PIECE, groups
from taichi_slm.analysis.metal import (
    MetalField,
    Voids,
    enclosed_voids,
    grid_axes,
    lower_surface,
    metal_field,
    upper_surface,
)
from taichi_slm.analysis.pools import grounded
from taichi_slm.analysis.recording import Moment
from taichi_slm.analysis.roughness import middle, roughness

THIN = 0.5
"""Metal thinner than this [dx] is not there: the part of a particle that reaches over an edge."""


@dataclass(frozen=True)
class TrackFindings:
    """What is measured of a track: a column per quantity along it, and the chief numbers."""

    table: dict[str, np.ndarray]  # the columns of track.csv
    chief: dict[str, Any]


def examine_track(first: Moment, last: Moment, on_plate: bool = True) -> TrackFindings:
    """Measure the track in ``last``; ``first`` tells what was powder and what was plate."""
    ground = np.zeros(len(last.id), dtype=bool)
    ground[grounded(last, on_plate)] = True
    frozen = last.solid & last.ever_liquid
    track = _pieces(last, frozen & ground)
    loose = frozen & ~ground
    chief: dict[str, Any] = {
        "track_particles": int(track.sum()),
        "still_liquid_particles": int(last.liquid.sum()),
        **_loose(last, loose),
        **(_powder(first, last) if on_plate else {}),
    }
    if not track.any():
        return TrackFindings({name: np.zeros(0) for name in columns(last.dimension)}, chief)
    axes = _grid(last, track)
    field = metal_field(last.position[track], last.volume[track], axes, last.spacing)
    if not (field.share >= 0.5).any():  # single particles, nowhere a body
        return TrackFindings({name: np.zeros(0) for name in columns(last.dimension)}, chief)
    table = _sections(field, last, track, axes)
    chief |= _form(table, field, last)
    if on_plate:
        chief |= _dilution(first, last, track, field) | _bond(field, last.spacing)
    chief |= _voids(last, axes)
    return TrackFindings({name: table[name] for name in columns(last.dimension)}, chief)


def _pieces(last: Moment, frozen: np.ndarray) -> np.ndarray:
    """Which of the ``frozen`` particles belong to groups of at least PIECE; single ones stuck to powder do not."""
    rows = np.flatnonzero(frozen)
    group, size = groups(last.position[rows], last.spacing)
    kept = np.zeros_like(frozen)
    kept[rows[size[group] >= PIECE]] = True
    return kept


def columns(dimension: int) -> list[str]:
    """Names of the columns of track.csv."""
    unit = "m" if dimension == 2 else "m2"
    size = "thickness" if dimension == 2 else "area"
    return [
        "x_m", "height_m", "bottom_m", "depth_m", *(["crest_m", "width_m"] if dimension == 3 else []),
        f"{size}_above_{unit}", f"{size}_below_{unit}",
    ]  # fmt: skip


def _grid(last: Moment, track: np.ndarray) -> tuple[np.ndarray, ...]:
    """A grid around the track, with room for what lies beside it."""
    room = 4.0 * last.spacing
    position = last.position[track]
    return grid_axes(position.min(axis=0) - room, position.max(axis=0) + room, last.spacing)


def _sections(
    field: MetalField, last: Moment, track: np.ndarray, axes: tuple[np.ndarray, ...]
) -> dict[str, np.ndarray]:
    """Height, depth, width and areas of the cross-section at every place along the track."""
    cell = field.cell
    with_plate = track | (last.solid & ~last.ever_liquid & (last.position[:, -1] < 0.0))
    metal = metal_field(last.position[with_plate], last.volume[with_plate], axes, last.spacing)
    top, bottom = upper_surface(metal), lower_surface(field)
    owned = np.isfinite(bottom)  # columns that hold track
    above, below = _thickness(field)
    if field.dimension == 2:
        height, low = top, bottom
        sections = {"thickness_above_m": above, "thickness_below_m": below}
        held = owned
    else:
        held = owned.any(axis=1)
        middle_line = np.abs(axes[1] - np.average(last.position[track, 1])) <= last.spacing
        # where no metal of the track is, the bare plate is at height 0; so it is in all of this module
        height = np.nan_to_num(top[:, middle_line], nan=0.0).mean(axis=1)
        crest = np.where(owned, top, -np.inf).max(axis=1)
        low = np.where(held, np.where(owned, bottom, np.inf).min(axis=1), np.nan)
        sections = {
            "crest_m": np.where(held, crest, 0.0),
            "width_m": _width(field.share.max(axis=2), axes[1]),
            "area_above_m2": above.sum(axis=1) * cell,
            "area_below_m2": below.sum(axis=1) * cell,
        }
    places = np.flatnonzero(held)
    inside = slice(places[0], places[-1] + 1)
    depth = np.nan_to_num(np.maximum(-low, 0.0), nan=0.0)
    every = {"x_m": axes[0], "height_m": height, "bottom_m": low, "depth_m": depth, **sections}
    return {name: np.asarray(values)[inside] for name, values in every.items()}


def _thickness(field: MetalField) -> tuple[np.ndarray, np.ndarray]:
    """Thickness of the metal above and below height 0 in every column [m], shape [along, (across)]."""
    up = field.axes[-1]
    weight = np.where(np.abs(up) < 0.25 * field.cell, 0.5, up > 0.0)
    above = (field.share * weight).sum(axis=-1) * field.cell
    below = (field.share * (1.0 - weight)).sum(axis=-1) * field.cell
    return above, below


def _width(share: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Extent [m] of what reaches 1/2 in each row of ``share``, shape [rows, across]; 0 where nothing does."""
    field = MetalField((np.arange(len(share)), across), share, float(across[1] - across[0]))
    width: np.ndarray = np.nan_to_num(upper_surface(field) - lower_surface(field), nan=0.0)
    return width


def _form(table: dict[str, np.ndarray], field: MetalField, last: Moment) -> dict[str, Any]:
    """Length, means over the middle of the track, and roughness there."""
    x = table["x_m"]
    inside = middle(x, x[0], x[-1])
    reach = field.share.max(axis=tuple(range(1, field.dimension)))[None]
    length = float(_width(reach, field.axes[0])[0])
    names = ("height_m", "crest_m", "depth_m", "width_m")
    means = {f"mean_{name}": float(np.nanmean(table[name][inside])) for name in names if name in table}
    peaks = {f"max_{name}": float(np.nanmax(table[name])) for name in names if name in table}
    return {
        "length_m": length,
        **means,
        **peaks,
        "min_height_m": float(np.nanmin(table["height_m"][inside])),
        **roughness(table["height_m"], inside),
        "resolution_m": last.spacing,
    }


def _dilution(first: Moment, last: Moment, track: np.ndarray, field: MetalField) -> dict[str, Any]:
    """Share of the track below the plate's old surface, and share of it that was plate."""
    above, below = (float(part.sum()) for part in _thickness(field))
    was_plate = np.isin(last.id[track], first.id[first.position[:, -1] < 0.0])
    mass = last.mass[track]
    size = "area" if last.dimension == 2 else "volume"
    cell = field.cell ** (last.dimension - 1)
    unit = "m2" if last.dimension == 2 else "m3"
    return {
        f"{size}_above_{unit}": above * cell,
        f"{size}_below_{unit}": below * cell,
        "dilution": below / (above + below),
        "dilution_by_origin": float(mass[was_plate].sum() / mass.sum()),
    }


def _bond(field: MetalField, spacing: float) -> dict[str, Any]:
    """How much of the footprint of the track on the plate is bonded by remelted plate."""
    footprint = np.nan_to_num(upper_surface(field), nan=0.0) > THIN * spacing
    fused = footprint & (np.nan_to_num(lower_surface(field), nan=0.0) < -THIN * spacing)
    cell = field.cell ** (field.dimension - 1)
    name = "unfused_length_m" if field.dimension == 2 else "unfused_area_m2"
    share = float(fused.sum() / footprint.sum()) if footprint.any() else float("nan")
    return {"fused_share": share, name: float((footprint & ~fused).sum()) * cell}


def _powder(first: Moment, last: Moment) -> dict[str, Any]:
    """Powder that never melted."""
    powder = (first.position[:, -1] > 0.0) & ~first.wall & ~first.liquid
    was_powder = np.isin(last.id, first.id[powder])
    unmelted = was_powder & ~last.ever_liquid
    whole, mass = float(first.mass[powder].sum()), float(last.mass[unmelted].sum())
    return {
        "powder_particles": int(powder.sum()),
        "unmelted_powder_particles": int(unmelted.sum()),
        "unmelted_powder_kg" if last.dimension == 3 else "unmelted_powder_kg_m": mass,
        "unmelted_powder_share": mass / whole if whole > 0.0 else float("nan"),
    }


def _loose(last: Moment, loose: np.ndarray) -> dict[str, Any]:
    """Frozen metal that hangs together with nothing that never melted."""
    _, size = groups(last.position[loose], last.spacing)
    mass = float(last.mass[loose].sum())
    return {
        "loose_pieces": int((size >= PIECE).sum()),
        "loose_kg" if last.dimension == 3 else "loose_kg_m": mass,
    }


def _voids(last: Moment, axes: tuple[np.ndarray, ...]) -> dict[str, Any]:
    field = metal_field(last.position, last.volume, axes, last.spacing)
    never = last.solid & ~last.ever_liquid
    return _void_numbers(enclosed_voids(field, last.position[never], last.spacing), last.dimension)


def _void_numbers(voids: Voids, dimension: int) -> dict[str, Any]:
    size = "area_m2" if dimension == 2 else "volume_m3"
    pores, gaps = voids.volume[~voids.lined], voids.volume[voids.lined]
    return {
        "pores": len(pores),
        f"pore_{size}": float(pores.sum()),
        f"largest_pore_{size}": float(pores.max()) if len(pores) else 0.0,
        "unfused_voids": len(gaps),
        f"unfused_void_{size}": float(gaps.sum()),
        f"largest_unfused_void_{size}": float(gaps.max()) if len(gaps) else 0.0,
    }
