"""Snapshots for ParaView: one VTU file per moment, and a PVD file that lists them as a time series.

VTK's own writer compresses into memory and :mod:`taichi_slm.output.atomic` brings the bytes to the disk,
because VTK kills the interpreter on a full disk and reports success for a missing folder. The compressor is
zlib, and texts are field arrays of UTF-8 bytes, because meshio reads no lz4 and no string arrays; a comment
at the head of the file and VTK's own unit labels say the same in plain words.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from xml.sax.saxutils import quoteattr

import numpy as np

from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import write_bytes, write_text

Item = TypeVar("Item")

UNITS = {
    "position": "m",
    "velocity": "m/s",
    "temperature": "K",
    "liquid_fraction": "1",
    "density": "kg/m^3",
    "pressure": "Pa",
    "surface_force": "N/m^3",
    "material": "index",
    "tracer": "index",
    "id": "index",
    "ever_liquid": "0 or 1",
    "wall": "0 or 1",
    "held": "0 or 1",
    "TimeValue": "s",
    "spacing": "m",
}


@dataclass(frozen=True)
class Snapshot:
    """Particles at one moment.

    ``arrays`` holds ``position`` [m], shape [n, dimension], ``velocity`` [m/s] of the same shape, and one
    value per particle of every other name in ``units``.
    """

    arrays: dict[str, np.ndarray]
    """By name; see above."""
    time: float
    """Simulated time [s]."""
    step: int
    """Number of the heat step."""
    dimension: int
    """2 or 3."""
    spacing: float
    """dx [m]."""
    git: str = ""
    """Commit of the program that made it."""
    version: str = ""
    """Version of that program."""
    units: dict[str, str] = field(default_factory=lambda: dict(UNITS))
    """SI unit of each array; "1" of a share."""

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.arrays["position"])


def write_snapshot(path: Path, snapshot: Snapshot) -> None:
    """Write ``snapshot`` as VTU: raw appended binary, compressed; in 2-D vectors get a third component 0."""
    write_bytes(path, _encode(snapshot))


def _encode(snapshot: Snapshot) -> bytes:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkDataArray, vtkPoints
    from vtkmodules.vtkCommonDataModel import VTK_VERTEX, vtkCellArray, vtkUnstructuredGrid
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    count = snapshot.count
    grid = vtkUnstructuredGrid()
    points = vtkPoints()
    points.SetData(numpy_to_vtk(three(snapshot.arrays["position"]), deep=True))
    grid.SetPoints(points)
    cells = vtkCellArray()
    index = np.arange(count + 1, dtype=np.int64)
    cells.SetData(numpy_to_vtk(index, deep=True), numpy_to_vtk(index[:-1].copy(), deep=True))
    grid.SetCells(VTK_VERTEX, cells)

    for name, values in snapshot.arrays.items():
        if name == "position":
            continue
        array = numpy_to_vtk(three(values) if values.ndim == 2 else np.ascontiguousarray(values), deep=True)
        array.SetName(name)
        if name in snapshot.units:
            array.GetInformation().Set(vtkDataArray.UNITS_LABEL(), snapshot.units[name])
        grid.GetPointData().AddArray(array)

    facts = {
        "TimeValue": np.array([snapshot.time]),
        "step": np.array([snapshot.step], dtype=np.int64),
        "dimension": np.array([snapshot.dimension], dtype=np.int32),
        "spacing": np.array([snapshot.spacing]),
        "git": _codes(snapshot.git),
        "version": _codes(snapshot.version),
        "units": _codes(json.dumps(snapshot.units)),
    }
    for name, values in facts.items():
        array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        grid.GetFieldData().AddArray(array)

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToZLib()
    writer.SetCompressionLevel(1)
    writer.SetHeaderTypeToUInt64()
    writer.WriteToOutputStringOn()
    if writer.Write() != 1:
        raise StorageError(f"VTK could not encode the snapshot of step {snapshot.step}")
    data = writer.GetOutputString()
    head, body = (data if isinstance(data, bytes) else data.encode("utf-8")).split(b"\n", 1)
    return head + b"\n" + _comment(snapshot).encode("utf-8") + b"\n" + body


def _codes(text: str) -> np.ndarray:
    """UTF-8 bytes of ``text``, shape [bytes]; a lone 0 stands for no text."""
    return np.frombuffer(text.encode("utf-8") or b"\0", dtype=np.uint8).copy()


def _comment(snapshot: Snapshot) -> str:
    units = ", ".join(f"{name} [{unit}]" for name, unit in snapshot.units.items())
    facts = (
        f"taichi-slm {snapshot.version} ({snapshot.git}), step {snapshot.step}, {snapshot.time!r} s; {units}"
    )
    return f"<!-- {facts.replace('--', '- -')} -->"


def three(vectors: np.ndarray) -> np.ndarray:
    """Vectors [n, 2] with a zero third component; [n, 3] unchanged."""
    if vectors.shape[1] == 3:
        return np.ascontiguousarray(vectors)
    padded = np.zeros((len(vectors), 3), dtype=vectors.dtype)
    padded[:, : vectors.shape[1]] = vectors
    return padded


def read_snapshot(path: Path) -> Snapshot:
    """Read a VTU written by ``write_snapshot``; a missing, truncated or empty file is a StorageError."""
    _check_whole(path)
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkCommand, vtkLogger, vtkObject
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = vtkXMLUnstructuredGridReader()
    complaints: list[str] = []

    def note(_caller: Any, _event: str, text: str = "") -> None:
        complaints.append(text)

    note.CallDataType = "string0"  # type: ignore[attr-defined]
    for part in (reader, reader.GetReaderErrorObserver(), reader.GetParserErrorObserver()):
        if isinstance(part, vtkObject):
            part.AddObserver(vtkCommand.ErrorEvent, note)
            part.AddObserver(vtkCommand.WarningEvent, note)
    reader.SetFileName(str(path))
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader.Update()
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
    grid = reader.GetOutput()
    if complaints or reader.GetErrorCode() or grid.GetNumberOfPoints() == 0:
        raise StorageError(f"{path} is damaged: VTK finds no whole set of particles in it")

    def fact(name: str) -> np.ndarray:
        array = grid.GetFieldData().GetArray(name)
        if array is None or array.GetNumberOfValues() == 0:
            raise StorageError(f"{path} has no field '{name}': it is not a snapshot of taichi-slm")
        return vtk_to_numpy(array)

    def text(name: str) -> str:
        return fact(name).tobytes().rstrip(b"\0").decode("utf-8")

    dimension = int(fact("dimension")[0])
    arrays = {"position": vtk_to_numpy(grid.GetPoints().GetData())[:, :dimension].copy()}
    data = grid.GetPointData()
    for k in range(data.GetNumberOfArrays()):
        values = vtk_to_numpy(data.GetArray(k))
        arrays[data.GetArrayName(k)] = (values[:, :dimension] if values.ndim == 2 else values).copy()
    return Snapshot(
        arrays=arrays,
        time=float(fact("TimeValue")[0]),
        step=int(fact("step")[0]),
        dimension=dimension,
        spacing=float(fact("spacing")[0]),
        git=text("git"),
        version=text("version"),
        units=json.loads(text("units")),
    )


def _check_whole(path: Path) -> None:
    """VTK reads a truncated file as 0 points without complaint, so the end of the file is looked at first."""
    try:
        size = path.stat().st_size
        with open(path, "rb") as file:
            file.seek(max(0, size - 64))
            tail = file.read()
    except OSError as error:
        raise StorageError(f"cannot read {path}: {error.strerror or error}") from error
    if not tail.rstrip().endswith(b"</VTKFile>"):
        raise StorageError(f"{path} is truncated: it ends before its closing tag")


def write_series(path: Path, entries: list[tuple[float, str]]) -> None:
    """Write the PVD ``path`` of ``entries``: (time [s], file name relative to it).

    Files that are gone are left out.
    """
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "  <Collection>",
    ]
    lines += [
        f'    <DataSet timestep="{time!r}" part="0" file={quoteattr(name)}/>'
        for time, name in entries
        if (path.parent / name).is_file()
    ]
    write_text(path, "\n".join([*lines, "  </Collection>", "</VTKFile>", ""]))


def read_series(path: Path) -> list[tuple[float, Path]]:
    """The (time [s], file) pairs of the PVD ``path``, in its order."""
    from xml.etree import ElementTree

    try:
        tree = ElementTree.parse(path)
    except OSError as error:
        raise StorageError(f"cannot read {path}: {error.strerror or error}") from error
    except ElementTree.ParseError as error:
        raise StorageError(f"{path} is damaged: {error}") from error
    return [
        (float(item.attrib["timestep"]), path.parent / item.attrib["file"]) for item in tree.iter("DataSet")
    ]


def spread(items: Sequence[Item], most: int) -> list[Item]:
    """At most ``most`` of ``items``, evenly chosen, with the first and the last; of one, the last."""
    if most <= 0:
        return []
    if most == 1:
        return list(items[-1:])
    picks = np.unique(np.round(np.linspace(0, len(items) - 1, min(most, len(items)))).astype(int))
    return [items[k] for k in picks]
