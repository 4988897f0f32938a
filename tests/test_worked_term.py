"""docs/add_term.md is followed to the letter on a copy of the program, which then keeps every check."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT, TERM, Block, blocks, commands

CHECKS = {"ruff", "lint-imports", "mypy"}  # programs of the page, beside this one


def lay(copy: Path, block: Block) -> None:
    """Do in ``copy`` what a block of the worked term says: a new file, or a diff of its lines with + and -."""
    path = copy / block.file
    if block.language != "diff":
        assert not path.exists(), f"{block.where}: {block.file} is there already"
        path.write_text(block.text, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    for part in block.text.split("@@\n"):
        lines = part.splitlines(keepends=True)
        before = "".join(line[1:] for line in lines if line[0] in " -")
        after = "".join(line[1:] for line in lines if line[0] in " +")
        assert text.count(before) == 1, (
            f"{block.where}: {block.file} has these lines {text.count(before)} times\n{before}"
        )
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")


def worked_term(tmp_path: Path) -> tuple[Path, list[Block]]:
    """A copy of the program in which add_term.md has been followed, and the page's blocks of shell."""
    copy = tmp_path / "copy"
    made = ("__pycache__", "runs", "verify", "site", "images", "build", "*.egg-info")
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", *made))
    for block in blocks(TERM):
        if block.language != "sh":
            assert block.file, f"{block.where}: which file is this?"
            lay(copy, block)
    return copy, [block for block in blocks(TERM) if block.language == "sh"]


def in_copy(copy: Path, command: str) -> None:
    """Run a command in the copy, with the copy's own package."""
    program, *rest = shlex.split(command)
    assert program in CHECKS | {"taichi-slm"}, f"add_term.md: nobody runs '{program}'"
    words = (
        [sys.executable, "-m", "taichi_slm.cli"]
        if program == "taichi-slm"
        else [str(Path(sys.executable).with_name(program))]  # of this environment, active or not
    )
    environment = os.environ | {"PYTHONPATH": str(copy)}
    done = subprocess.run(
        [*words, *rest], cwd=copy, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"


def test_the_worked_term(tmp_path):
    """add_term.md, followed to the letter: lint and layers hold, and the speed decays as exp(-t/tau) to 1e-3."""
    copy, shell = worked_term(tmp_path)
    for block in shell:
        for command in commands(block):
            if command != "mypy":
                in_copy(copy, command)
    (case,) = json.loads((copy / "verify" / "verify.json").read_text(encoding="utf-8"))["cases"]
    assert [row["quantity"] for row in case["rows"]] == [
        "speed after one decay time",
        "momentum given to the plates",
    ]
    speed, plates = case["rows"]
    assert (
        abs(speed["computed"] / speed["exact"] - 1.0) < 1e-3
    )  # Euler's rule in steps of tau/1000 errs by 5e-4
    assert abs(plates["computed"] / plates["exact"] - 1.0) < 1e-10  # a sum of doubles
    assert '"gap"' in (copy / "configs" / "schema.json").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_worked_term_has_types_and_a_line_in_the_theory(tmp_path):
    """The checks of add_term.md that take half a minute."""
    copy, _ = worked_term(tmp_path)
    in_copy(copy, "mypy")
    case = "tests/test_readme.py::test_the_theory_explains_every_key"  # pytest fails if there is none of that name
    words = [sys.executable, "-m", "pytest", "-n", "0", case]
    done = subprocess.run(
        words,
        cwd=copy,
        env=os.environ | {"PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
