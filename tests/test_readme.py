"""What the README promises exists: its scene, its Python, its commands, its files."""

import re
import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner

from taichi_slm.cli import app
from taichi_slm.config.load import load_config
from taichi_slm.config.numerics import Numerics, Performance, Physics

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def block(language: str) -> str:
    """The one block of code in ``language``."""
    (found,) = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    return found


def test_the_scene_is_valid(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(block("yaml"), encoding="utf-8")
    assert load_config(path).config.laser.passes == 2


def test_the_python_runs():
    done = subprocess.run(
        [sys.executable, "-c", block("python")], cwd=ROOT, capture_output=True, text=True, check=True
    )
    time, error = re.search(r"^(\d+) us, \d+ K, \d+ particles\n(\S+) ", done.stdout).groups()
    assert int(time) == 50
    assert float(error) < 1e-6


def test_the_commands_and_options_exist():
    """Every `taichi-slm COMMAND --option` of the README and the docs."""
    runner = CliRunner()
    calls = set()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        calls |= set(re.findall(r"taichi-slm ([a-z]+)([^`\n#]*)", text))
    assert len(calls) > 5
    for command, rest in calls:
        shown = runner.invoke(app, [command, "--help"], terminal_width=200)
        assert shown.exit_code == 0, f"there is no command '{command}'"
        for option in re.findall(r"--[a-z]+", rest):
            assert option in shown.output, f"{command} has no {option}"


def test_the_links_lead_somewhere():
    """Those to files, but not the pictures, which scripts/make_results.py makes from runs."""
    for page in PAGES:
        for target in re.findall(r"(?<!!)\[[^]]*\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_theory_explains_every_key():
    """Each numerics, performance and physics key, and its default where that is a word or a number."""
    text = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    for section in (Numerics, Performance):
        for key, field in section.model_fields.items():
            rows = [line for line in text.splitlines() if line.startswith(f"| `{key}` |")]
            assert len(rows) == 1, key
            default = field.default
            if default is not None:
                shown = rows[0].split("|")[2].strip().strip("`").split(" ")[0]
                same = (
                    shown == str(default).lower()
                    if isinstance(default, bool | str)
                    else float(shown) == default
                )
                assert same, f"{key}: {shown}, not {default}"
    for key in Physics.model_fields:
        assert key in ("flow", "heat") or f"`physics.{key}`" in text, key


def test_every_promise_names_a_test_that_exists():
    text = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    named = re.findall(r"`(tests/\w+\.py)::(\w+)`", text)
    rows = [line for line in text.splitlines() if line.startswith("| ") and not line.startswith("| promise")]
    assert len(named) >= len(rows) > 20
    for file, test in named:
        assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file}: {test}"
