"""`taichi-slm export`: what other programs read is what the snapshot holds, and nothing is written over."""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy

from taichi_slm.cli import main
from taichi_slm.errors import StorageError
from taichi_slm.output.export import SUFFIXES, export_run
from taichi_slm.output.snapshots import Snapshot, write_series, write_snapshot

COUNTS = (40, 40, 37, 35)  # particles leave on the way
TIMES = (0.0, 1e-5 / 3, 2e-5 / 3, 1e-5)
EXACT = ("xdmf", "vtk", "ply", "gmsh", "csv", "npz")


def moment(dimension: int, number: int) -> Snapshot:
    """Moving, warming particles of two kinds; nothing in it is round or zero."""
    rng = np.random.default_rng(number)
    count = COUNTS[number]
    arrays = {
        "position": 1e-3 * rng.random((count, dimension)),
        "velocity": rng.standard_normal((count, dimension)),
        "temperature": 293.0 + 3000.0 * rng.random(count),
        "pressure": 1e5 * rng.standard_normal(count),
        "material": rng.integers(0, 3, count, dtype=np.int32),
        "id": np.arange(count, dtype=np.int32),
        "ever_liquid": rng.integers(0, 2, count).astype(np.uint8),
    }
    return Snapshot(arrays, TIMES[number], 100 * number, dimension, 4e-6, "abc", "0.1.0")


@pytest.fixture(params=[2, 3])
def run(tmp_path, request):
    """(folder, snapshots) of a run with four moments."""
    folder = tmp_path / "run"
    (folder / "snapshots").mkdir(parents=True)
    moments = [moment(request.param, number) for number in range(len(COUNTS))]
    names = [f"snapshots/{number:06d}.vtu" for number in range(len(COUNTS))]
    for name, each in zip(names, moments, strict=True):
        write_snapshot(folder / name, each)
    write_series(folder / "snapshots.pvd", list(zip(TIMES, names, strict=True)))
    return folder, moments


def padded(vectors):
    return np.hstack([vectors, np.zeros((len(vectors), 3 - vectors.shape[1]))])


def compare(found, position, snapshot, tolerance=0.0):
    """Points and every array against ``snapshot``; 2-D vectors have a third component 0."""
    np.testing.assert_allclose(position, padded(snapshot.arrays["position"]), rtol=tolerance, atol=0)
    for name, values in snapshot.arrays.items():
        if name == "position":
            continue
        wanted = padded(values) if values.ndim == 2 else values
        np.testing.assert_allclose(np.squeeze(found[name]), wanted, rtol=tolerance, atol=0, err_msg=name)


@pytest.mark.parametrize(
    ("form", "tolerance"),
    [("vtk", 0.0), ("gmsh", 0.0), ("avsucd", 1e-14)],  # avsucd: text of 15 digits
)
def test_meshio_reads_back_what_was_written(run, form, tolerance, capfd):
    folder, moments = run
    files = export_run(folder, form)
    assert [file.name for file in files] == [f"particles_{n:06d}.{SUFFIXES[form]}" for n in range(4)]
    for file, snapshot in zip(files, moments, strict=True):
        mesh = meshio.read(file, file_format=form)
        compare(mesh.point_data, mesh.points, snapshot, tolerance)
    assert capfd.readouterr() == ("", "")  # meshio warns there of what it changes


def test_ply_by_meshio_and_by_vtk(run, capfd):
    from vtkmodules.vtkIOPLY import vtkPLYReader

    folder, moments = run
    (file,) = export_run(folder, "ply", times="last")
    assert file == folder / "export" / "particles.ply"
    mesh, snapshot = meshio.read(file), moments[-1]
    data = dict(mesh.point_data)
    data["velocity"] = np.stack([data.pop(f"velocity_{axis}") for axis in "xyz"], axis=1)
    compare(data, mesh.points, snapshot)
    assert capfd.readouterr() == ("", "")
    reader = vtkPLYReader()
    reader.SetFileName(str(file))
    reader.Update()
    points = vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
    # VTK keeps the points of a PLY in single precision
    np.testing.assert_array_equal(points, padded(snapshot.arrays["position"]).astype(np.float32))


def test_vtk_reads_the_legacy_file(run):
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader

    folder, moments = run
    (file,) = export_run(folder, "vtk", times="last")
    reader = vtkGenericDataObjectReader()
    reader.SetFileName(str(file))
    reader.ReadAllScalarsOn()
    reader.ReadAllVectorsOn()
    reader.ReadAllFieldsOn()
    reader.Update()
    check_grid(reader.GetOutput(), moments[-1])


def test_vtk_reads_the_avs_file(run):
    from vtkmodules.vtkIOGeometry import vtkAVSucdReader

    folder, moments = run
    (file,) = export_run(folder, "avsucd", times="last")
    reader = vtkAVSucdReader()
    reader.SetFileName(str(file))
    reader.Update()
    grid, arrays = reader.GetOutput(), moments[-1].arrays
    # VTK keeps what it finds in an AVS file in single precision
    points = vtk_to_numpy(grid.GetPoints().GetData())
    np.testing.assert_allclose(points, padded(arrays["position"]), rtol=1e-6, atol=0)
    found = vtk_to_numpy(grid.GetPointData().GetArray("temperature"))
    np.testing.assert_allclose(found, arrays["temperature"], rtol=1e-6, atol=0)


def check_grid(grid, snapshot):
    data = grid.GetPointData()
    found = {data.GetArrayName(k): vtk_to_numpy(data.GetArray(k)) for k in range(data.GetNumberOfArrays())}
    compare(found, vtk_to_numpy(grid.GetPoints().GetData()), snapshot)
    assert grid.GetNumberOfCells() == snapshot.count  # without a cell ParaView shows nothing


def test_xdmf_is_a_series_of_moving_points(run):
    from meshio.xdmf import TimeSeriesReader
    from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

    folder, moments = run
    file, heavy = export_run(folder, "xdmf", folder / "all.xdmf")
    assert heavy == folder / "all.h5"
    with TimeSeriesReader(file) as series:  # takes the points of the first moment for those of all
        points, cells = series.read_points_cells()
        np.testing.assert_array_equal(points, padded(moments[0].arrays["position"]))
        np.testing.assert_array_equal(cells[0].data[:, 0], np.arange(COUNTS[0]))
        for number, snapshot in enumerate(moments):
            time, data, _ = series.read_data(number)
            assert time == snapshot.time
            np.testing.assert_array_equal(data["temperature"], snapshot.arrays["temperature"])
    reader = vtkXdmfReader()
    reader.SetFileName(str(file))
    reader.UpdateInformation()
    information = reader.GetOutputInformation(0)
    key = reader.GetExecutive().TIME_STEPS()
    assert [information.Get(key, k) for k in range(information.Length(key))] == list(TIMES)
    for snapshot in moments:
        reader.UpdateTimeStep(snapshot.time)
        check_grid(reader.GetOutputDataObject(0), snapshot)


def test_csv_and_npz(run):
    folder, moments = run
    snapshot = moments[-1]
    with np.load(*export_run(folder, "npz", times="last")) as data:
        assert (float(data["time"]), int(data["step"]), float(data["spacing"])) == (1e-5, 300, 4e-6)
        for name, values in snapshot.arrays.items():
            np.testing.assert_array_equal(data[name], values)
            assert data[name].dtype == values.dtype
    (file,) = export_run(folder, "csv", times="last")
    with open(file, newline="") as stream:
        rows = list(csv.DictReader(stream))
    axes = "xyz"[: snapshot.dimension]
    assert list(rows[0]) == [
        "time_s", *(f"position_{a}_m" for a in axes), *(f"velocity_{a}_m_s" for a in axes),
        "temperature_K", "pressure_Pa", "material", "id", "ever_liquid",
    ]  # fmt: skip
    assert {float(row["time_s"]) for row in rows} == {1e-5}
    np.testing.assert_array_equal(
        [float(row["temperature_K"]) for row in rows], snapshot.arrays["temperature"]
    )
    np.testing.assert_array_equal(
        [[float(row[f"position_{a}_m"]) for a in axes] for row in rows], snapshot.arrays["position"]
    )
    assert [int(row["material"]) for row in rows] == snapshot.arrays["material"].tolist()


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run a command line; returns (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def run_command(*arguments):
        monkeypatch.setattr(sys, "argv", ["taichi-slm", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code or 0, *capsys.readouterr()

    return run_command


def test_the_command(run, command):
    out = Path("mine", "p.vtk")
    code, printed, said = command("export", "run", "--format", "vtk", "--times", "2", "--out", str(out))
    assert (code, said) == (0, "")
    assert printed.split() == [str(Path("mine", f"p_{n:06d}.vtk")) for n in (0, 3)]
    assert sorted(path.name for path in Path("mine").iterdir()) == ["p_000000.vtk", "p_000003.vtk"]


def test_nothing_is_written_over(run, command):
    taken = Path("mine", "p_000003.csv")
    taken.parent.mkdir()
    taken.write_text("precious")
    code, printed, said = command("export", "run", "--format", "csv", "--out", "mine/p.csv")
    assert (code, printed) == (4, "")
    assert said.startswith(f"{taken} exists already and is never written over")
    assert taken.read_text() == "precious"
    assert list(taken.parent.iterdir()) == [taken]  # looked at before the first is written


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (("run", "--format", "vtkk"), 2, "Did you mean 'vtk'?"),
        (("run", "--format", "stl"), 2, "choose xdmf, vtk, ply, gmsh, avsucd, csv, npz."),
        (("run", "--format", "csv", "--times", "0"), 2, "expected all, last, or a number of moments"),
        (("run", "--format", "csv", "--times", "some"), 2, "expected all, last, or a number of moments"),
        (("nowhere", "--format", "csv"), 4, "cannot read nowhere"),
        (("run", "--format", "csv", "--out", "run/snapshots.pvd/x.csv"), 4, "there is a file of that name"),
    ],
)
def test_a_wrong_wish_is_a_sentence(run, command, arguments, code, sentence):
    ended, printed, said = command("export", *arguments)
    assert (ended, printed, said.count("\n")) == (code, "", 1)
    assert sentence in said


@pytest.mark.parametrize("form", EXACT)
def test_a_failed_write_leaves_nothing(run, form, monkeypatch):
    """The disk fills up at the moment when the file gets its name."""
    import os

    def full(*_):
        raise OSError(28, "No space left on device")

    folder, _ = run
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(StorageError, match="the disk is full"):
        export_run(folder, form)
    assert list((folder / "export").iterdir()) == []


def test_single_precision_stays(run):
    """A run in f32 is written as it is, not widened."""
    folder, moments = run
    single = {
        name: values.astype(np.float32) if values.dtype == np.float64 else values
        for name, values in moments[-1].arrays.items()
    }
    snapshot = replace(moments[-1], arrays=single)
    write_snapshot(folder / "snapshots" / "000003.vtu", snapshot)
    (file,) = export_run(folder, "vtk", times="last")
    mesh = meshio.read(file)
    assert mesh.point_data["temperature"].dtype.itemsize == 4
    compare(mesh.point_data, mesh.points, snapshot)
