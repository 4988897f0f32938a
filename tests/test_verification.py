"""The cases of `taichi-slm verify`: the quick ones keep their limits; the table, the file and the exit code."""

import pytest
from typer.testing import CliRunner

from taichi_slm.cli import app
from taichi_slm.verification.case import Case, Outcome
from taichi_slm.verification.catalogue import all_cases, chosen
from taichi_slm.verification.verify import judged


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
