"""A run folder becomes numbers: tables, plots and analysis.json in its folder analysis/; terms in docs/analysis.md."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taichi_slm.analysis.energy import EnergyAccount, energy_account
from taichi_slm.analysis.fronts import FrontBook
from taichi_slm.analysis.mixing import MixingBook
from taichi_slm.analysis.pools import PoolBook, find_pools, sort_melt
from taichi_slm.analysis.recording import Moment, Recording, open_run
from taichi_slm.analysis.spatter import SpatterBook
from taichi_slm.analysis.track import TrackFindings, examine_track
from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import make_folder, read_json, write_json
from taichi_slm.output.history import read_history
from taichi_slm.output.numbers import quantity
from taichi_slm.output.table import flat, write_table

EDITION = 2
"""Goes up when a number gets another meaning or name: what an older program found is then found anew."""

CHIEF = (
    "pool.pools", "pool.max_length_m", "pool.max_width_m", "pool.max_depth_m", "pool.max_area_m2", "pool.max_volume_m3",
    "track.length_m", "track.mean_height_m", "track.mean_depth_m", "track.mean_width_m", "track.Ra_m", "track.Rz_m",
    "track.Pq_m", "track.dilution", "track.fused_share", "track.unmelted_powder_share", "track.pores",
    "track.unfused_voids",
    "solidification.cooling_rate_K_s.median", "solidification.gradient_K_m.median",
    "solidification.front_speed_m_s.median", "solidification.time_above_melting_s.median",
    "spatter.ejected_particles", "spatter.ejected_mass_kg", "spatter.ejected_mass_kg_m", "energy.in_J",
)  # fmt: skip
"""The numbers that a terminal and the table of a study show, by their path in analysis.json."""


@dataclass
class Analysis:
    """All that is found of one run."""

    recording: Recording
    dimension: int
    snapshots: int
    end: float  # time of the last snapshot [s]
    tables: dict[str, dict[str, Any]]  # file name without .csv -> columns
    chief: dict[str, Any]  # analysis.json
    energy: EnergyAccount | None
    sentences: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        """Where it is written."""
        return self.recording.folder / "analysis"


def analyse(run: Path) -> Iterator[str]:
    """Analyse the run in the folder ``run`` and write what is found; the lines to print.

    Raises StorageError where there is no run, no snapshot, or a damaged one.
    """
    found, pictures = write(run)
    yield from closing_lines(found)
    yield f"written    {found.folder}: analysis.json, {_listed(found, pictures)}"


def write(run: Path) -> tuple[Analysis, list[Path]]:
    """Analyse the run in the folder ``run`` and write what is found; what, and the pictures."""
    found = examine(run)
    make_folder(found.folder)
    from taichi_slm.analysis.figures import draw_all  # matplotlib, which --help does without

    pictures = draw_all(found)
    _store(found)
    return found, pictures


def numbers_of(run: Path) -> dict[str, Any]:
    """analysis.json of the run in the folder ``run``, keys joined by dots.

    It is analysed first, without pictures, where that was not done since its last snapshot.
    Raises StorageError where there is no run, no snapshot, or a damaged one.
    """
    if not _current(run):
        found = examine(run)
        make_folder(found.folder)
        _store(found)
    return flat(read_json(run / "analysis" / "analysis.json"))


def _store(found: Analysis) -> None:
    """Write the tables, and last analysis.json: who finds it finds all of them."""
    for name, columns in found.tables.items():
        if columns:
            write_table(found.folder / f"{name}.csv", columns)
    write_json(found.folder / "analysis.json", found.chief)


def _current(run: Path) -> bool:
    """Whether the folder's analysis is of this program and of the last snapshot."""
    files = [run / "analysis" / name for name in ("analysis.json", "pools.csv", "track.csv")]
    if not all(file.is_file() for file in files):
        return False
    sources = [path for name in ("snapshots.pvd", "history.csv") if (path := run / name).is_file()]
    newest = max(os.stat(path).st_mtime_ns for path in sources)
    try:
        edition = read_json(files[0]).get("edition")
    except StorageError:
        return False
    return edition == EDITION and min(os.stat(file).st_mtime_ns for file in files) >= newest


def examine(run: Path) -> Analysis:
    """Measure the run in the folder ``run``; writes nothing."""
    recording = open_run(run)
    pools, spatter = PoolBook(), SpatterBook()
    fronts = FrontBook(recording.solidus, recording.liquidus)
    mixing = MixingBook(recording.names)
    first: Moment | None = None
    last: Moment | None = None
    for moment in recording.moments():
        first = first or moment
        last = moment
        melt = sort_melt(moment, recording.on_plate)
        pools.see(moment, find_pools(moment, melt))
        spatter.see(moment, melt)
        fronts.see(moment)
        mixing.see(moment)
    if first is None or last is None:
        raise StorageError(f"{run} has no snapshots to analyse")
    track = examine_track(first, last, recording.on_plate)
    account = _account(run)
    dimension = last.dimension
    chief = {
        "edition": EDITION,
        "dimension": dimension,
        "snapshots": len(recording.files),
        "end_s": last.time,
        "pool": pools.chief(dimension),
        "track": track.chief,
        "solidification": fronts.chief(dimension),
        "spatter": spatter.chief(),
        "mixing": mixing.chief(),
        "energy": account.closing() if account else None,
    }
    found = Analysis(
        recording=recording,
        dimension=dimension,
        snapshots=len(recording.files),
        end=last.time,
        tables={
            "pools": pools.table(dimension),
            "track": track.table,
            "fronts": fronts.table(dimension),
            "spatter": spatter.table(),
            "mixing": mixing.table(),
        },
        chief=chief,
        energy=account,
    )
    found.sentences = _sentences(found, track, bool(fronts.melted.any()))
    chief["remarks"] = found.sentences
    return found


def _account(run: Path) -> EnergyAccount | None:
    path = run / "history.csv"
    return energy_account(read_history(path)) if path.is_file() else None


def _sentences(found: Analysis, track: TrackFindings, melted: bool) -> list[str]:
    """What a reader of the numbers should know of them."""
    if not melted:
        if not np.isfinite(found.recording.liquidus).any():
            return ["the materials of this run have no solid, so there is no melt pool: all sizes are 0"]
        return ["nothing was liquid in any snapshot: all sizes are 0"]
    remarks = []
    if found.chief["track"]["still_liquid_particles"]:
        count = found.chief["track"]["still_liquid_particles"]
        remarks.append(
            f"{count:,} particles are still liquid in the last snapshot: the track is not finished"
        )
    drop = found.chief["solidification"]["median_drop_between_snapshots_K"]
    band = found.recording.liquidus - found.recording.solidus
    band = band[np.isfinite(band)]
    if drop is not None and len(band) and drop > float(band.max()):
        remarks.append(
            f"from one snapshot to the next, half of the metal cooled by more than {drop:.0f} K, its freezing range "
            f"and more: read front speed and cooling rate at a shorter output.snapshot_interval"
        )
    if found.dimension == 2:
        remarks.append("a 2-D run: compare its sizes with those of 2-D runs only")
    if not len(track.table["x_m"]):
        remarks.append("no metal that melted is solid at the end: there is no track")
    return remarks


def closing_lines(found: Analysis) -> list[str]:
    """The chief numbers, a line each."""
    pool, track, fronts, spatter = (
        found.chief[name] for name in ("pool", "track", "solidification", "spatter")
    )
    flat = found.dimension == 2
    size = ("area", "max_area_m2") if flat else ("volume", "max_volume_m3")
    names = [("length", "max_length_m"), ("width", "max_width_m"), ("depth", "max_depth_m")]
    largest = ", ".join(f"{name} {quantity(pool[key], 'm')}" for name, key in names if key in pool)
    lines = [
        f"run        {found.recording.folder}, {found.snapshots} snapshots to {quantity(found.end, 's')}",
        f"melt pool  {pool['pools']} in all; largest {largest}, {size[0]} {pool[size[1]]:.3g} "
        f"{'m^2' if flat else 'm^3'}",
    ]
    if "length_m" in track:
        lines.append(
            f"track      length {quantity(track['length_m'], 'm')}, height {quantity(track['mean_height_m'], 'm')}, "
            f"depth {quantity(track['mean_depth_m'], 'm')}; Ra {quantity(track['Ra_m'], 'm')}, Rq "
            f"{quantity(track['Rq_m'], 'm')}, Rz {quantity(track['Rz_m'], 'm')}; Pq {quantity(track['Pq_m'], 'm')}"
        )
        if "dilution" in track:
            lines.append(
                f"fusion     dilution {_percent(track['dilution'])}, {_percent(track['fused_share'])} of the footprint "
                f"fused, {_percent(track['unmelted_powder_share'])} of the powder unmelted"
            )
        lines.append(
            f"voids      {track['pores']} pores, {track['unfused_voids']} beside metal that never melted"
        )
    if fronts["frozen_particles"]:
        lines.append(
            f"freezing   cooling rate {_median(fronts['cooling_rate_K_s'])} K/s, gradient "
            f"{_median(fronts['gradient_K_m'])} K/m, front {_median(fronts['front_speed_m_s'])} m/s (medians)"
        )
    unit = "kg/m" if flat else "kg"
    mass = spatter["ejected_mass_kg_m" if flat else "ejected_mass_kg"]
    lines.append(
        f"spatter    {spatter['ejected_particles']:,} particles ({mass:.3g} {unit}), {spatter['returned_particles']:,} "
        f"came back, at most {quantity(spatter['max_speed_in_flight_m_s'], 'm/s')}"
    )
    return lines + [f"note       {sentence}" for sentence in found.sentences]


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "-"


def _median(values: dict[str, float | None]) -> str:
    median = values["median"]
    return "-" if median is None else f"{median:.3g}"


def _listed(found: Analysis, pictures: list[Path]) -> str:
    tables = [f"{name}.csv" for name, columns in found.tables.items() if columns]
    return ", ".join([*tables, *(path.name for path in pictures)])
