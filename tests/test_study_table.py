"""What a study leaves behind: its table, the overview, the contact sheet; and the scripts that call it."""

import json
import runpy
import sys
from pathlib import Path

import pytest
from test_study import GRID, ROOT, console, study, table  # noqa: F401

from taichi_slm.study.collect import collect
from taichi_slm.study.conduct import conduct
from taichi_slm.study.folder import StudyFolder
from taichi_slm.study.pictures import THUMBNAIL, contact_sheet, overview


def test_parquet_is_the_csv(study):  # noqa: F811
    parquet = pytest.importorskip("pyarrow.parquet")
    folder, plan = StudyFolder.prepare(Path("studies/study")), study(GRID)
    for run, kelvin in zip(plan.runs, (500, 1000.5), strict=True):
        folder.run(run.name).path.mkdir()
        folder.run(run.name).summary.write_text(json.dumps({"max_temperature_K": kelvin, "steps": 3}))
    collect(plan, folder, {})
    read = parquet.read_table("studies/study/table.parquet").to_pydict()
    assert read["laser.power"] == [50.0, 100.0]
    assert read["max_temperature_K"] == [500, 1000.5]
    assert read["steps"] == [3, 3]
    assert list(read) == list(table()[0])


def test_contact_sheet_has_a_tile_per_run_that_has_pictures(study):  # noqa: F811
    from PIL import Image

    plan = study("{kind: grid, values: {laser.power: [1, 2, 3, 4, 5]}}")
    folder = StudyFolder.prepare(Path("sheet"))
    assert not contact_sheet(plan, folder)
    for run, shade in zip(plan.runs[:4], (10, 60, 110, 160), strict=True):
        folder.run(run.name).renders.mkdir(parents=True)
        for name, value in (("state_000000", 255), ("state_000009", shade), ("temperature_000009", 0)):
            Image.new("L", (1280, 800), value).save(folder.run(run.name).renders / f"{name}.png")
    assert contact_sheet(plan, folder)
    with Image.open(folder.contact_sheet) as sheet:
        width, height = THUMBNAIL
        assert sheet.size == (2 * width, 2 * (height + 28))
        middles = [sheet.getpixel((x, y))[0] for y in (228, 656) for x in (320, 960)]
    assert middles == [10, 60, 110, 160]


@pytest.mark.parametrize("more", ["", "overview: {kind: map, x: spacing, by: laser.power}\n", "repeats: 2\n"])
def test_overview_shows_what_there_is(study, more):  # noqa: F811
    plan = study("{kind: grid, values: {laser.power: [1, 2], spacing: [1 um, 2 um]}}", more=more)
    rows = [
        {**run.changes, "state": "failed" if run.number == 2 else "done", "seed": run.seed,
         "max_temperature_K": None if run.number == 3 else 300.0 * run.number}
        for run in plan.runs
    ]  # fmt: skip
    assert overview(plan, rows, Path("overview.png"))
    assert Path("overview.png").read_bytes().startswith(b"\x89PNG")
    assert not overview(plan, [row | {"max_temperature_K": None} for row in rows], Path("none.png"))
    assert not overview(plan, [row | {"state": "stopped"} for row in rows], Path("none.png"))
    assert not Path("none.png").exists()


def drawn(plan, rows, monkeypatch):
    """The axes of the overview."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figures = []
    monkeypatch.setattr(FigureCanvasAgg, "print_figure", lambda self, *_, **__: figures.append(self.figure))
    assert overview(plan, rows, Path("overview.png"))
    return figures[0].axes


def test_overview_has_units_and_failed_runs_stand_at_the_edge(study, monkeypatch):  # noqa: F811
    """Pools of 40, 80 and 120 um; what the run that failed had reached (160 um) is no result."""
    plan = study("{kind: grid, values: {spacing: [20 um, 30 um], laser.power: [50, 100]}}")
    rows = [
        {**run.changes, "state": "failed" if run.number == 4 else "done", "seed": 7,
         "melt_pool.length_m": 40e-6 * run.number}
        for run in plan.runs
    ]  # fmt: skip
    (axes,) = drawn(plan, rows, monkeypatch)
    assert (axes.get_xlabel(), axes.get_title()) == ("spacing [µm]", "melt_pool.length [µm]")
    assert axes.get_legend().get_title().get_text() == "laser.power [W]"
    dots = [line.get_xydata().ravel().tolist() for line in axes.lines if line.get_marker() == "o"]
    assert dots == [pytest.approx([20.0, 40.0, 30.0, 120.0]), pytest.approx([20.0, 80.0])]
    (cross,) = [line for line in axes.lines if line.get_marker() == "x"]
    assert cross.get_xdata() == pytest.approx([30.0])
    assert max(cross.get_ydata()) < 0.1  # a share of the height of the axes


def test_overview_of_a_hypercube_is_coloured_by_a_scale(study, monkeypatch):  # noqa: F811
    """Each run has a value of its own of either key: no lines and no entry per run in a legend."""
    ranges = "{laser.power: [80 W, 200 W], laser.beam_radius: [40 um, 60 um]}"
    plan = study(f"{{kind: latin_hypercube, count: 12, ranges: {ranges}}}")
    rows = [{**run.changes, "state": "done", "seed": 7, "max_temperature_K": 2000.0} for run in plan.runs]
    axes, bar = drawn(plan, rows, monkeypatch)
    assert axes.get_legend() is None
    assert len(axes.lines) == 0
    assert len(axes.collections[0].get_offsets()) == 12
    assert bar.get_ylabel() == "laser.beam_radius [µm]"


def test_a_column_to_show_that_is_none_gets_a_guess(study):  # noqa: F811
    plan = study(GRID, more="analyse: false\noverview: {show: [melt_pool.lenght_m]}\n")
    folder = StudyFolder.prepare(Path("studies/study"))
    for run in plan.runs:
        folder.run(run.name).path.mkdir()
        folder.run(run.name).summary.write_text(json.dumps({"melt_pool": {"length_m": 1e-4}}))
        folder.run(run.name).status.write_text(json.dumps({"state": "done"}))
    said = [line for line in collect(plan, folder, {}) if line.startswith("note: overview.show")]
    assert said == [
        "note: overview.show: the table has no column 'melt_pool.lenght_m'. Did you mean 'melt_pool.length_m'?"
    ]


@pytest.mark.parametrize("name", ["power_sweep", "process_map", "conductivity_study", "resolution_study"])
def test_scripts_know_their_study(name, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "--check"])
    runpy.run_path(str(ROOT / "scripts" / f"{name}.py"), run_name="__main__")
    assert capsys.readouterr().out.endswith("runs, all valid\n")


def test_the_table_has_the_chief_numbers_of_the_analysis(study, console):  # noqa: F811
    """As in analysis.json; a run that cannot be analysed says why, and `analyse: false` leaves them out."""
    plan = study(GRID)
    conduct(plan, console=console)
    places = [StudyFolder(Path("studies/study")).run(run.name) for run in plan.runs]
    for row, place in zip(table(), places, strict=True):
        numbers = json.loads((place.analysis / "analysis.json").read_text())
        assert float(row["analysis.pool.max_length_m"]) == pytest.approx(numbers["pool"]["max_length_m"])
        assert int(row["analysis.pool.pools"]) == numbers["pool"]["pools"]
    (places[0].analysis / "analysis.json").unlink()
    places[0].snapshot(0).write_bytes(b"half")
    conduct(plan, console=console)
    bad, good = table()
    assert "000000.vtu is truncated" in bad["analysis.failure"]
    assert good["analysis.failure"] == ""
    assert good["analysis.pool.max_length_m"]
    conduct(study(GRID, more="analyse: false\n"), console=console)
    assert not any(name.startswith("analysis.") for name in table()[0])
