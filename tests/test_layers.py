"""The direction of flow: who may import whom, and that a command loads only what it needs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SLOW = (
    "taichi.lang",
    "pyvista",
    "vtk",
    "vtkmodules",
    "matplotlib",
)  # a lazy `taichi` that nobody used is empty


def test_imports_run_one_way():
    """The contracts in pyproject.toml."""
    code = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout


@pytest.mark.parametrize(
    "command",
    [
        "import taichi_slm.cli",
        "from taichi_slm import load_config; load_config('configs/track_150W.yaml')",
        "from taichi_slm.run.estimate import validate_all; "
        "from pathlib import Path; list(validate_all([Path('configs/track_150W.yaml')], ()))",
    ],
    ids=["cli", "load_config", "validate"],
)
def test_neither_taichi_nor_vtk_is_loaded(command):
    """`--help`, `validate` and reading a config start at once."""
    code = f"{command}; import sys; print([name for name in {SLOW!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_version_of_every_home_is_the_same():
    """The version that the package, the citation and the change log name."""
    from importlib.metadata import version

    number = version("taichi-slm")
    assert f'version = "{number}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f"version: {number}" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {number}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
