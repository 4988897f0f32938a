"""Snapshots in the formats of other programs: meshio writes them, numpy those of tables.

========  ==========================================  ======================================  ==================
format    files                                       values                                  tests read it with
========  ==========================================  ======================================  ==================
xdmf      one, and its numbers in HDF5 beside it      every bit                               meshio, VTK
vtk       one a moment (legacy VTK, binary)           every bit                               meshio, VTK
ply       one a moment (binary)                       every bit; a vector is three numbers    meshio, VTK
gmsh      one a moment (.msh 4.1, binary)             every bit; integers become numbers      meshio
avsucd    one a moment (.inp, text)                   15 digits; integers become numbers      meshio, VTK
csv       one a moment                                every bit, as text                      csv
npz       one a moment                                every bit                               numpy
========  ==========================================  ======================================  ==================

meshio's other formats keep no numbers of lone points, or need libraries that are not installed here. Its series
writer for XDMF has one set of points for all moments; particles move, so each moment here brings its own.
"""

import difflib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichi_slm.errors import ConfigError, StorageError
from taichi_slm.output.atomic import make_folder, refuse_existing, whole_file, write_text
from taichi_slm.output.snapshots import Snapshot, read_series, read_snapshot, spread, three

SUFFIXES = {
    "xdmf": "xdmf",
    "vtk": "vtk",
    "ply": "ply",
    "gmsh": "msh",
    "avsucd": "inp",
    "csv": "csv",
    "npz": "npz",
}
_DIALECTS = {
    "vtk": "vtk42"
}  # VTK's own reader does not know the name that meshio's 5.1 gives to 32-bit integers
SERIES = "xdmf"  # the one format that holds many moments in one file
AXES = "xyz"


def export_run(folder: Path, form: str, out: Path | None = None, times: str = "all") -> list[Path]:
    """Write the snapshots of the run in ``folder`` in the format ``form``; returns the files, none of which was there.

    ``times``: "all", "last", or a number of moments, evenly chosen with the first and the last. ``out``: the file, by
    default export/particles.SUFFIX in the run folder; of several moments each gets the number of its snapshot
    behind the name. Raises ConfigError for a format or a time that is not one, StorageError for all about files.
    """
    if form not in SUFFIXES:
        close = difflib.get_close_matches(form, SUFFIXES, n=1)
        hint = f" Did you mean '{close[0]}'?" if close else ""
        raise ConfigError(f"there is no format '{form}': choose {', '.join(SUFFIXES)}.{hint}")
    moments = _chosen(folder, times)
    out = folder / "export" / f"particles.{SUFFIXES[form]}" if out is None else out
    if form == SERIES:
        heavy = out.with_suffix(".h5")
        targets = [out, heavy]
    elif len(moments) == 1:
        targets = [out]
    else:
        targets = [out.with_name(f"{out.stem}_{path.stem}{out.suffix}") for _, path in moments]
    refuse_existing(targets)
    make_folder(out.parent)
    if form == SERIES:
        _write_xdmf(out, heavy, [path for _, path in moments])
    else:
        write = _WRITERS.get(form) or _by_meshio(form)
        for target, (_, path) in zip(targets, moments, strict=True):
            snapshot = read_snapshot(path)
            with whole_file(target) as temporary:
                write(temporary, snapshot)
    return targets


def _chosen(folder: Path, times: str) -> list[tuple[float, Path]]:
    """The (time [s], file) of the snapshots that ``times`` asks for."""
    if not (times in ("all", "last") or (times.isascii() and times.isdigit() and int(times) > 0)):
        raise ConfigError(f"--times {times}: expected all, last, or a number of moments")
    series = read_series(folder / "snapshots.pvd")
    if not series:
        raise StorageError(f"{folder} has no snapshots to export")
    return series if times == "all" else spread(series, 1 if times == "last" else int(times))


# --------------------------------------------------------------------------- one file a moment


def _by_meshio(form: str) -> Callable[[Path, Snapshot], None]:
    """The writer of ``form`` that takes every particle as a vertex."""

    def write(path: Path, snapshot: Snapshot) -> None:
        import meshio

        data = _point_data(snapshot)
        cells = [("vertex", np.arange(snapshot.count)[:, None])]
        if form == "ply":  # knows numbers only, no vectors; and points without cells
            data, cells = _numbers(data), []
        mesh = meshio.Mesh(three(snapshot.arrays["position"]), cells, point_data=data)
        meshio.write(path, mesh, file_format=_DIALECTS.get(form, form))

    return write


def _point_data(snapshot: Snapshot) -> dict[str, np.ndarray]:
    """What a particle carries but its place: numbers, shape [n], and vectors, shape [n, 3]."""
    return {
        name: three(values) if values.ndim == 2 else values
        for name, values in snapshot.arrays.items()
        if name != "position"
    }


def _numbers(data: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """``data`` with every vector taken apart into name_x, name_y and so on."""
    taken: dict[str, np.ndarray] = {}
    for name, values in data.items():
        if values.ndim == 1:
            taken[name] = values
        else:
            for axis, column in zip(AXES, values.T, strict=False):
                taken[f"{name}_{axis}"] = np.ascontiguousarray(column)
    return taken


def _write_csv(path: Path, snapshot: Snapshot) -> None:
    """A row per particle; the units are in the head, as in history.csv, and the time is the first column."""
    columns: dict[str, np.ndarray] = {"time_s": np.full(snapshot.count, snapshot.time)}
    for name, values in snapshot.arrays.items():
        unit = snapshot.units.get(name, "")
        unit = f"_{unit.replace('/', '_').replace('^', '')}" if unit.isascii() and _is_unit(unit) else ""
        columns |= {f"{key}{unit}": column for key, column in _numbers({name: values}).items()}
    texts = [
        column.astype(str) for column in columns.values()
    ]  # numpy's shortest text that reads back the same
    with open(path, "w", encoding="utf-8", newline="") as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _is_unit(unit: str) -> bool:
    """Whether ``unit`` is one of measure, and not "1", "index" or "0 or 1"."""
    return unit not in ("", "1", "index") and " or " not in unit


def _write_npz(path: Path, snapshot: Snapshot) -> None:
    """The arrays by their names as they are in memory, with ``time`` [s], ``step`` and ``spacing`` [m]."""
    facts = {"time": snapshot.time, "step": snapshot.step, "spacing": snapshot.spacing}
    with open(path, "wb") as file:  # given a name, numpy would add .npz to it
        np.savez_compressed(file, **facts, **snapshot.arrays)  # type: ignore[arg-type]


_WRITERS: dict[str, Callable[[Path, Snapshot], None]] = {"csv": _write_csv, "npz": _write_npz}


# --------------------------------------------------------------------------- many moments in one file


def _write_xdmf(path: Path, heavy: Path, snapshots: Sequence[Path]) -> None:
    """The XDMF ``path`` of all ``snapshots``, its numbers in the HDF5 file ``heavy``, which is there first."""
    import h5py
    from meshio.xdmf.time_series import TimeSeriesWriter

    writer = TimeSeriesWriter(path)
    writer.h5_filename = heavy.name  # as the XDMF names it
    with whole_file(heavy) as temporary, h5py.File(temporary, "w") as writer.h5_file:
        for file in snapshots:
            _add_moment(writer, read_snapshot(file))
    from xml.etree import ElementTree

    write_text(path, ElementTree.tostring(writer.xdmf_file, encoding="unicode"))


def _add_moment(writer: Any, snapshot: Snapshot) -> None:
    from xml.etree import ElementTree

    grid = ElementTree.SubElement(writer.collection, "Grid", Name=f"step {snapshot.step}", GridType="Uniform")
    ElementTree.SubElement(grid, "Time", Value=repr(snapshot.time))
    writer.points(grid, three(snapshot.arrays["position"]))
    writer.cells([("vertex", np.arange(snapshot.count)[:, None])], grid)
    writer.point_data(_point_data(snapshot), grid)
