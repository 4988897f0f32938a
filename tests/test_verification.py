"""The cases of `taichi-slm verify`: the quick ones keep their limits; the table, the file and the exit code."""

import json

import pytest
from rich.console import Console
from typer.testing import CliRunner

from taichi_slm.cli import app
from taichi_slm.errors import LimitBrokenError
from taichi_slm.verification.case import Case, Outcome
from taichi_slm.verification.catalogue import all_cases, chosen
from taichi_slm.verification.verify import judged, verify


@pytest.mark.parametrize("case", chosen((), "quick"), ids=lambda case: case.name)
def test_quick_cases_keep_their_limits(case: Case):
    outcome = case.run()
    assert [f"{row.quantity}: {judged(row)}" for row in outcome.rows if not row.holds] == []
    assert any(row.limit is not None for row in outcome.rows)
    assert all(row.why for row in outcome.rows if row.limit is not None)


def test_names_are_unique_and_titles_there():
    names = [case.name for case in all_cases()]
    assert len(set(names)) == len(names)
    assert all(case.title for case in all_cases())


def test_rows_hold_or_not():
    outcome = Outcome()
    outcome.judge("within", 1.01, 1.0, limit=0.02, why="it is")
    outcome.judge("beyond", 1.03, 1.0, limit=0.02, why="it is not")
    outcome.judge("lost", float("nan"), 1.0, limit=0.02, why="a NaN keeps no limit")
    outcome.order("order", [1.0, 0.5, 0.25], [0.4, 0.1, 0.025], at_least=1.8, why="second order")
    outcome.order("too low", [1.0, 0.5, 0.25], [0.4, 0.2, 0.1], at_least=1.8, why="first order")
    assert [row.holds for row in outcome.rows] == [True, False, False, True, False]
    again = Outcome.from_json(outcome.to_json())
    assert [row.quantity for row in again.rows] == [row.quantity for row in outcome.rows]


def test_an_unknown_case_is_a_sentence():
    done = CliRunner().invoke(app, ["verify", "static_drip"])
    assert "did you mean 'static_drop'" in str(done.exception)


def test_the_command_writes_table_file_plots_and_page(tmp_path):
    out, page = tmp_path / "verify", tmp_path / "docs" / "verification.md"
    page.parent.mkdir()
    done = CliRunner().invoke(app, ["verify", "beer_lambert", "--out", str(out), "--page", str(page)])
    assert done.exit_code == 0, done.output
    report = json.loads((out / "verify.json").read_text(encoding="utf-8"))
    (case,) = report["cases"]
    assert case["name"] == "beer_lambert"
    assert case["failure"] == ""
    assert all(row["holds"] for row in case["rows"])
    assert len(list((out / "plots").glob("*.png"))) == len(case["plots"]) > 0
    text = page.read_text(encoding="utf-8")
    assert "0 broken" in text
    for plot in case["plots"]:
        assert (page.parent / "images" / "verification" / f"{plot['name']}.png").is_file()


def test_a_broken_limit_is_exit_code_one(tmp_path, monkeypatch):
    """And what an earlier call found about another case stays in the file."""
    held, broken = chosen(["beer_lambert", "hydrostatic"])

    def outcome_of(case: Case, *_: object) -> dict[str, object]:
        outcome = Outcome()
        outcome.judge("speed", 1.0 if case is held else 1.1, 1.0, limit=0.05, why="made up")
        about = {
            "name": case.name,
            "title": case.title,
            "group": case.group,
            "tier": case.tier,
            "git": "none",
        }
        return about | {"failure": "", "seconds": 1.0, **outcome.to_json()}

    monkeypatch.setattr("taichi_slm.verification.verify._in_its_own_process", outcome_of)
    verify([held], tmp_path, 1, Console(quiet=True))
    with pytest.raises(LimitBrokenError, match=r"hydrostatic, speed: 0\.1, limit 0\.05"):
        verify([broken], tmp_path, 1, Console(quiet=True))
    assert LimitBrokenError.exit_code == 1
    report = json.loads((tmp_path / "verify.json").read_text(encoding="utf-8"))
    assert {case["name"] for case in report["cases"]} == {"beer_lambert", "hydrostatic"}


def test_a_case_that_crashes_is_a_broken_one(tmp_path):
    """In its own process, so that the others go on."""
    case = Case("no_such_case", "Nothing", "exact", "quick", lambda outcome: None)
    with pytest.raises(LimitBrokenError, match=r"no_such_case: ended with 1: .*there is no case"):
        verify([case], tmp_path, 1, Console(quiet=True))
