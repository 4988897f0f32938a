"""Files that are whole or not there: VTU, PVD, CSV, and the atomic write below them."""

import errno
import json
import os
from dataclasses import replace

import meshio
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from taichi_slm.errors import StorageError
from taichi_slm.output import atomic
from taichi_slm.output.history import COLUMNS, History, keep_until, read_history
from taichi_slm.output.snapshots import (
    UNITS,
    Snapshot,
    read_series,
    read_snapshot,
    write_series,
    write_snapshot,
)


def snapshot(dimension: int = 2, count: int = 2000) -> Snapshot:
    rng = np.random.default_rng(7)
    arrays = {
        "position": rng.random((count, dimension)),
        "velocity": rng.random((count, dimension)),
        "temperature": 293.0 + 3000.0 * rng.random(count),
        "liquid_fraction": rng.random(count),
        "density": np.full(count, 7443.0),
        "pressure": rng.standard_normal(count),
        "material": np.zeros(count, dtype=np.int32),
        "tracer": np.ones(count, dtype=np.int32),
        "id": np.arange(count, dtype=np.int32),
        "ever_liquid": np.zeros(count, dtype=np.uint8),
        "wall": np.zeros(count, dtype=np.uint8),
        "held": np.ones(count, dtype=np.uint8),
    }
    return Snapshot(
        arrays, time=2.4e-4, step=1234, dimension=dimension, spacing=4e-6, git="abc123", version="0.1.0"
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_snapshot_comes_back_bit_for_bit(tmp_path, dimension):
    written = snapshot(dimension)
    write_snapshot(tmp_path / "000001.vtu", written)
    read = read_snapshot(tmp_path / "000001.vtu")
    for name, values in written.arrays.items():
        assert read.arrays[name].dtype == values.dtype
        np.testing.assert_array_equal(read.arrays[name], values)
    for name in ("time", "step", "dimension", "spacing", "git", "version", "units"):
        assert getattr(read, name) == getattr(written, name)


def test_snapshot_by_vtk_itself(tmp_path):
    written = snapshot()
    path = tmp_path / "000001.vtu"
    write_snapshot(path, written)
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetNumberOfPoints() == grid.GetNumberOfCells() == 2000
    points = vtk_to_numpy(grid.GetPoints().GetData())
    np.testing.assert_array_equal(points[:, :2], written.arrays["position"])
    assert (points[:, 2] == 0.0).all()
    assert grid.GetFieldData().GetArray("TimeValue").GetValue(0) == 2.4e-4
    head = path.read_bytes()[:200]
    assert b"vtkZLibDataCompressor" in head
    assert b"taichi-slm 0.1.0 (abc123), step 1234" in path.read_bytes()[:400]


def test_snapshot_by_meshio(tmp_path):
    written = snapshot(3)
    write_snapshot(tmp_path / "000001.vtu", written)
    mesh = meshio.read(tmp_path / "000001.vtu")
    np.testing.assert_array_equal(mesh.points, written.arrays["position"])
    for name in written.arrays:
        if name != "position":
            np.testing.assert_array_equal(mesh.point_data[name], written.arrays[name])
    assert mesh.field_data["TimeValue"][0] == 2.4e-4
    assert mesh.field_data["git"].tobytes() == b"abc123"
    assert b'"temperature": "K"' in mesh.field_data["units"].tobytes()


@pytest.mark.parametrize("keep", [0.0, 0.1, 0.5, 0.99])
def test_truncated_snapshot_is_refused(tmp_path, keep):
    path = tmp_path / "000001.vtu"
    write_snapshot(path, snapshot())
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data))])
    with pytest.raises(StorageError, match=r"000001\.vtu"):
        read_snapshot(path)


def test_snapshot_with_a_hole_or_a_flipped_bit_is_refused(tmp_path):
    path = tmp_path / "000001.vtu"
    write_snapshot(path, snapshot())
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3] + data[len(data) // 2 :])
    with pytest.raises(StorageError):
        read_snapshot(path)
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 1
    path.write_bytes(flipped)
    with pytest.raises(StorageError):
        read_snapshot(path)


def test_missing_or_foreign_snapshot(tmp_path):
    with pytest.raises(StorageError, match="cannot read"):
        read_snapshot(tmp_path / "none.vtu")
    foreign = tmp_path / "foreign.vtu"
    meshio.Mesh(np.zeros((3, 3)), [("vertex", np.arange(3)[:, None])]).write(foreign)
    with pytest.raises(StorageError, match="not a snapshot"):
        read_snapshot(foreign)


def test_series_lists_only_what_is_there(tmp_path):
    (tmp_path / "snapshots").mkdir()
    for k in (0, 2):
        (tmp_path / f"snapshots/{k:06d}.vtu").touch()
    entries = [(k * 1e-5, f"snapshots/{k:06d}.vtu") for k in range(3)]
    write_series(tmp_path / "snapshots.pvd", entries)
    assert [(t, p.name) for t, p in read_series(tmp_path / "snapshots.pvd")] == [
        (0.0, "000000.vtu"),
        (2e-5, "000002.vtu"),
    ]


def test_series_by_pyvista(tmp_path):
    """The series as ParaView's reader meets it: every moment with its time, particles, arrays and values.

    VTK has no PVD reader of its own (that one is ParaView's); PyVista's reads the list, and VTK each file.
    """
    import pyvista

    (tmp_path / "snapshots").mkdir()
    moments = [
        replace(snapshot(count=2000 - 10 * number), time=number * 1e-4 / 3, step=number)
        for number in range(4)
    ]
    names = [f"snapshots/{each.step:06d}.vtu" for each in moments]
    for name, each in zip(names, moments, strict=True):
        write_snapshot(tmp_path / name, each)
    write_series(tmp_path / "snapshots.pvd", [(e.time, n) for e, n in zip(moments, names, strict=True)])
    reader = pyvista.PVDReader(str(tmp_path / "snapshots.pvd"))
    assert reader.time_values == [each.time for each in moments]
    for each in moments:
        reader.set_active_time_value(each.time)
        (grid,) = reader.read()
        assert grid.n_points == grid.n_cells == each.count
        assert sorted(grid.point_data) == sorted(set(each.arrays) - {"position"})
        assert grid.field_data["TimeValue"][0] == each.time
        np.testing.assert_array_equal(grid.points[:, :2], each.arrays["position"])
        np.testing.assert_array_equal(grid["temperature"], each.arrays["temperature"])


def test_damaged_series(tmp_path):
    (tmp_path / "snapshots.pvd").write_text("<VTKFile><Collection>")
    with pytest.raises(StorageError, match="damaged"):
        read_series(tmp_path / "snapshots.pvd")


def test_failed_write_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "status.json"
    atomic.write_text(path, "old")

    def full(_descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="disk is full") as caught:
        atomic.write_text(path, "new")
    assert caught.value.exit_code == 4
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["status.json"]


def test_unwritable_places(tmp_path):
    with pytest.raises(StorageError, match="does not exist"):
        write_snapshot(tmp_path / "gone" / "000001.vtu", snapshot(count=3))
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="not a folder"):
        atomic.write_text(tmp_path / "file" / "x.json", "")
    with pytest.raises(StorageError, match="make the folder"):
        atomic.make_folder(tmp_path / "file" / "x")


def test_json_without_nan(tmp_path):
    atomic.write_json(
        tmp_path / "x.json", {"a": float("nan"), "b": np.float64(2.0), "c": (np.int32(1), None)}
    )
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": None, "b": 2.0, "c": [1, None]}


# --------------------------------------------------------------------------- history


def row(step: int) -> dict:
    return {
        **dict.fromkeys(COLUMNS, 1.0),
        "step": step,
        "dt_limiter": "sound",
        "melt_width_m": None,
        "packing_low": np.float64(1 / 3),
    }


def test_history_comes_back(tmp_path):
    path = tmp_path / "history.csv"
    with History(path) as history:
        for k in range(3):
            history.append(row(k))
            assert len(path.read_text().splitlines()) == k + 2  # flushed at once
    columns = read_history(path)
    assert tuple(columns)[: len(COLUMNS)] == COLUMNS
    assert list(columns["step"]) == [0, 1, 2]
    assert list(columns["dt_limiter"]) == ["sound"] * 3
    assert np.isnan(columns["melt_width_m"]).all()
    assert (columns["packing_low"] == 1 / 3).all()


def test_history_goes_on_where_it_was_cut(tmp_path):
    path = tmp_path / "history.csv"
    with History(path) as history:
        for k in range(5):
            history.append(row(k))
    keep_until(path, 2)
    with History(path) as history:
        history.append(row(3))
    assert list(read_history(path)["step"]) == [0, 1, 2, 3]


def test_half_a_row_is_not_read(tmp_path):
    path = tmp_path / "history.csv"
    with History(path) as history:
        history.append(row(0))
        history.append(row(1))
    path.write_bytes(path.read_bytes()[:-20])
    assert list(read_history(path)["step"]) == [0]


def test_unknown_column_is_an_error(tmp_path):
    with History(tmp_path / "history.csv") as history:
        history.append(row(0))
        with pytest.raises(ValueError, match="no column new"):
            history.append({**row(1), "new": 1.0})


def test_history_of_nothing(tmp_path):
    (tmp_path / "history.csv").touch()
    with pytest.raises(StorageError, match="no history"):
        read_history(tmp_path / "history.csv")
    with pytest.raises(StorageError, match="cannot"):
        History(tmp_path / "gone" / "history.csv")


def test_every_array_of_a_snapshot_has_its_unit():
    """ParaView and `export` show what stands beside an array; a new one must not come without."""
    from taichi_slm.run.simulation import SNAPSHOT_ARRAYS

    assert set(SNAPSHOT_ARRAYS) <= set(UNITS)
