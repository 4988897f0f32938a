"""What the README and the pages promise is there: files, keys, tests, a site. test_docs.py runs what they print."""

import re
import subprocess
import sys
from pathlib import Path

from taichi_slm.config.numerics import Numerics, Performance, Physics

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_the_set_up_lines_are_those_that_the_gate_runs():
    gate = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    (pattern,) = re.findall(r"grep -E '([^']+)' README\.md", gate)
    found = [line for line in README.splitlines() if re.match(pattern, line)]
    assert len(found) == 2
    assert "taichi-slm run" in found[0]
    assert found[1].endswith(".venv/bin/pytest")


def test_the_python_of_the_README_keeps_its_accounts(monkeypatch, capsys):
    """Blocks of other pages are run by test_docs.py."""
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    monkeypatch.chdir(ROOT)
    exec(compile(code, "README.md", "exec"), {"__name__": "__main__"})
    time, error = re.search(r"^(\d+) us, \d+ K, \d+ particles\n(\S+) ", capsys.readouterr().out).groups()
    assert int(time) == 50
    assert float(error) < 1e-6  # closed in doubles; the whole track of 2.5 ms ends at 1e-8


def test_the_links_lead_somewhere():
    """Those to files, pictures among them."""
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_set_up_stands_in_the_readme_alone():
    others = [page for page in PAGES if page.name != "README.md"]
    assert [
        page.name for page in others if re.search(r"(pip|apt|apt-get) install", page.read_text("utf-8"))
    ] == []


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


def test_the_site_builds_without_a_warning(tmp_path):
    """mkdocs.yml; strict: a link or an anchor that leads nowhere, a page outside the menu, is an error."""
    site = tmp_path / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    first, api = ((site / name).read_text(encoding="utf-8") for name in ("index.html", "api.html"))
    assert "<h1" in first
    assert 'href="first_run.html"' in first
    assert "Advance to the end" in api  # the docstring of Simulation.run
