"""What the README and docs/*.md print is run: page by page, block by block, in the order of the page.

A YAML or Python block after a line that ends with the name of a file, "In `drop.yaml`:", becomes that file. Commands
run as printed, in a folder with the shipped scenes, which are made small first (SMALLER). Those that take
long are for the slow tests, and may have a quick one of their kind in their place (LONG). What is for a cluster is
parsed, not run. There is no other way: a language, a program or a command that this file does not know fails.
"""

import glob
import json
import os
import re
import shlex
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from conftest import merged
from pages import PAGES, ROOT, TERM, Block, blocks, commands
from ruamel.yaml import YAML
from test_materials import test_every_number_of_an_alloy_has_a_source as every_number_has_a_source
from typer.testing import CliRunner

from taichi_slm.cli import app
from taichi_slm.config.load import load_config
from taichi_slm.errors import ConfigError, StoppedError
from taichi_slm.materials import library
from taichi_slm.materials.tables import tabulate
from taichi_slm.study.plan import load_plan
from taichi_slm.verification.catalogue import chosen

# The same scenes with fewer particles and less time: it is the commands that are tested here.
SMALLER: dict[str, dict[str, Any]] = {
    "configs/track_150W.yaml": {
        "spacing": "10 um",
        "time": {"end": "20 us"},
        "output": {"snapshot_interval": "10 us", "images": ["temperature"], "images_at_most": 1},
    },
    "configs/studies/power.yaml": {"axes": [{"kind": "grid", "values": {"laser.power": [50, 150]}}]},
    "weld.yaml": {"time": {"end": "20 us"}, "spacing": "10 um", "output": {"images_at_most": 0}},
    "plate.yaml": {"spacing": "10 um", "time": {"end": "20 us"}, "output": {"images_at_most": 0}},
}
# A command as it is printed, and what the slow tests run in its place; the fast ones parse it. Commands that others
# build upon, or that build upon others, cannot be here.
LONG = {
    "taichi-slm doctor": "",
    "taichi-slm run configs/track_150W.yaml --set laser.power=100 --out runs/weaker": "",
    "taichi-slm run plate.yaml --out runs/plate": "",
    "taichi-slm run powder.yaml --out runs/powder": "",
    "taichi-slm materials aluminium --plot aluminium.png": "",
    "taichi-slm run weld.yaml --out runs/weld": "",
    "taichi-slm run passes.yaml --out runs/passes": "",
    "taichi-slm run layers.yaml --out runs/layers": "",
    'taichi-slm run powder.yaml --set laser.power=150 --set "laser.path.0.speed=1.5 m/s" --out runs/stronger': "",
    "taichi-slm study configs/studies/power.yaml": "",
    "taichi-slm compare studies/power/runs/*": "",
    "taichi-slm study configs/studies/process_map.yaml --out $SCRATCH/map": (
        "taichi-slm study configs/studies/power.yaml"
    ),
    "taichi-slm verify --tier full": "taichi-slm verify hydrostatic beer_lambert",
    "taichi-slm bench accuracy": "taichi-slm bench speed --quick",
    "taichi-slm bench speed skips": "taichi-slm bench speed --quick",
    "taichi-slm stress": "taichi-slm stress drop --quick",
}
LONG_PYTHON = {"studies.md"}  # pages whose Python runs a study
OTHER_PYTHON = {"README.md"}  # test_readme.py runs it, and looks at what it prints
CLUSTER = {"dask", "srun", "sleep"}  # programs of a cluster; what stands beside them is parsed
SHOWN = {"text", "diff", "math"}  # languages of blocks that nothing can run
USAGE_ERROR = typer.BadParameter.__mro__[1]  # of click, which typer has its own copy of since 0.22


def for_a_cluster(block: Block) -> bool:
    """Whether a block of shell is a job script, or starts a scheduler and workers."""
    return block.text.startswith("#!") or any(line.split()[0] in CLUSTER for line in commands(block))


def mentioned() -> Iterator[tuple[str, str]]:
    """(page, command) of every `taichi-slm ...` that is not in a block: within a line, or an indented line."""
    for page in PAGES:
        text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for found in re.findall(r"`(taichi-slm [^`]+)`|^    (taichi-slm .*)$", text, re.MULTILINE):
            yield page.name, " ".join((found[0] or found[1]).split())


def parse(where: str, command: str, whole: bool = True) -> None:
    """Let the true parser read a command, without running it; ``whole``: an argument that is missing is an error."""
    words = shlex.split(os.path.expandvars(command))
    known = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert words[1] in known or words[1].startswith("--"), f"{where}: there is no command '{words[1]}'"
    if "--help" in words or words[1].startswith("--"):
        return
    try:
        context = known[words[1]].make_context(words[1], words[2:])
    except USAGE_ERROR as error:
        if type(error).__name__ == "MissingParameter" and not whole:
            return
        pytest.fail(f"{where}: {command}: {error.format_message()}")
    if words[1] == "verify":
        chosen(context.params["case"] or ())
    for word in words[2:]:
        assert not word.startswith("configs/") or list(ROOT.glob(word)), f"{where}: there is no {word}"


@pytest.fixture
def place(tmp_path, monkeypatch) -> Iterator[Path]:
    """A working folder with the shipped scenes, made small, and a folder of alloys of its own."""
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    for name in SMALLER:
        if name.startswith("configs/"):
            write_smaller(tmp_path, name, (ROOT / name).read_text(encoding="utf-8"))
    alloys = tmp_path / "taichi_slm" / "materials" / "alloys"
    shutil.copytree(library.ALLOY_FOLDER, alloys)
    monkeypatch.setattr(library, "ALLOY_FOLDER", alloys)  # where a page may add one
    monkeypatch.chdir(tmp_path)
    forget_alloys()
    yield tmp_path
    forget_alloys()


def forget_alloys() -> None:
    """Let the library look into its folder anew."""
    library.alloy_names.cache_clear()
    library._alloy_file.cache_clear()


def write_smaller(place: Path, name: str, text: str) -> None:
    """The YAML file ``name``, with what SMALLER says laid over it."""
    if name in SMALLER:
        text = json.dumps(merged(YAML(typ="safe").load(text), SMALLER[name]))
    (place / name).write_text(text, encoding="utf-8")


def run(where: str, command: str, exit_code: int = 0) -> None:
    """Run a command of this program in this process."""
    words = [found for word in shlex.split(command)[1:] for found in sorted(glob.glob(word)) or [word]]
    done = CliRunner().invoke(app, words)
    code = getattr(done.exception, "exit_code", done.exit_code)
    assert code == exit_code, f"{where}: {command}\n{done.output}\n{done.exception!r}"


def run_and_stop(where: str, command: str, folder: Path) -> None:
    """Run a command into a run folder, and stop it as soon as that is there: what `resume` goes on from."""

    def stop() -> None:
        while not folder.is_dir():
            time.sleep(0.01)
        (folder / "STOP").touch()

    thread = threading.Thread(target=stop, daemon=True)
    thread.start()
    run(where, command, StoppedError.exit_code)
    thread.join()


def run_yaml(place: Path, block: Block) -> None:
    """A scene or a study is valid; one with a name becomes a file."""
    tree = YAML(typ="safe").load(block.text)
    if block.file:
        write_smaller(place, block.file, block.text)
        forget_alloys()
    if "axes" in tree:
        path = place / "configs" / "studies" / "block.yaml"
        path.write_text(block.text, encoding="utf-8")
        assert load_plan(path).runs, block.where
    elif not block.file or "bodies" in tree or "extends" in tree:
        path = place / "block.yaml"
        path.write_text(block.text, encoding="utf-8")
        load_config(path)


SLOW_PAGES = {"analysis.md"}  # half a minute


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.slow) if page.name in SLOW_PAGES else page
        for page in PAGES
        if page != TERM
    ],
    ids=lambda page: page.name,
)
def test_a_page_does_what_it_prints(page, place):
    for block in blocks(page):
        if block.language == "sh" and not for_a_cluster(block):
            for command in commands(block):
                if command.startswith("python3 -m venv "):
                    continue  # the two set-up lines, which test_readme.py knows and the gate runs
                assert command.startswith("taichi-slm "), f"{block.where}: nobody runs '{command}'"
                resumed = re.search(r"--out (\S+)$", command)
                if command in LONG:
                    parse(block.where, command)
                elif resumed and f"taichi-slm resume {resumed[1]}" in commands(block):
                    run_and_stop(block.where, command, Path(resumed[1]))
                else:
                    run(block.where, command)
        elif block.language == "sh":
            parse_script(block)
        elif block.language == "yaml":
            run_yaml(place, block)
        elif block.language == "python":
            code = compile(block.text, block.where, "exec")
            if page.name not in LONG_PYTHON | OTHER_PYTHON:
                exec(code, {"__name__": "__main__"})
        else:
            assert block.language in SHOWN, f"{block.where}: a block of '{block.language}'"


def parse_script(block: Block) -> None:
    """A script for a cluster: bash reads it, and this program and dask know the options."""
    subprocess.run(["bash", "-n"], input=block.text, text=True, check=True)
    for command in commands(block):
        words = shlex.split(command)
        program = words[0]
        assert program in CLUSTER | {"taichi-slm"}, f"{block.where}: nobody knows '{program}'"
        if "taichi-slm" in words:
            rest = words[words.index("taichi-slm") :]
            parse(block.where, shlex.join(re.sub(r"^\$SLURM\w+$", "1", word) for word in rest))
        elif "dask" in words:
            part = words[words.index("dask") + 1]
            from distributed.cli import dask_scheduler, dask_worker

            cli = {"scheduler": dask_scheduler, "worker": dask_worker}[part].main
            options = {option for parameter in cli.params for option in parameter.opts}
            assert {word for word in words if word.startswith("--n") or word == "--port"} <= options


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if page != TERM], ids=lambda page: page.name)
def test_the_long_commands(page, place):
    done = set()
    for block in blocks(page):
        if block.language == "sh" and not for_a_cluster(block):
            for command in commands(block):
                stand_in = LONG.get(command)
                if stand_in is not None and stand_in not in done:
                    run(block.where, stand_in or command)
                    done.add(stand_in or command)
        elif block.language == "yaml":
            run_yaml(place, block)
        elif block.language == "python" and page.name in LONG_PYTHON:
            exec(compile(block.text, block.where, "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize(
    "wrong",
    [
        "taichi-slm runn configs/track_150W.yaml",
        "taichi-slm run configs/track_150W.yaml --sets laser.power=100",
        "taichi-slm run configs/track_150V.yaml",
        "taichi-slm run configs/track_150W.yaml --threads two",
        "taichi-slm render",
    ],
)
def test_a_wrong_command_fails(wrong):
    with pytest.raises((AssertionError, pytest.fail.Exception)):
        parse("here", wrong)


def test_every_long_command_is_still_printed():
    printed = {
        line for page in PAGES for block in blocks(page) if block.language == "sh" for line in commands(block)
    }
    assert set(LONG) <= printed


def test_commands_within_the_text_exist():
    found = set(mentioned())
    assert len(found) > 20
    for page, command in found:
        parse(page, command, whole=False)


def test_what_goes_wrong_is_said_so(place):
    """Each row of the table in own_scene.md: a key that is set, and the sentence that comes, or the warning."""
    page = ROOT / "docs" / "own_scene.md"
    for block in blocks(page):
        if block.language == "yaml":
            (place / block.file).write_text(block.text, encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+=[^`]+)` \| (.+) \|$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) > 5
    for override, sentence in rows:
        if sentence.startswith("warning: "):
            assert any(
                sentence.removeprefix("warning: ") in said
                for said in load_config("passes.yaml", [override]).warnings
            )
        else:
            with pytest.raises(ConfigError) as refused:
                load_config("passes.yaml", [override])
            assert sentence in str(refused.value)


def without(tree: dict[str, Any], key: str) -> dict[str, Any]:
    """``tree`` without one key."""
    return {name: value for name, value in tree.items() if name != key}


TWO_FORMS = {"constant": 1.0, "polynomial": [1.0]}
FALLING = {"table": [[900, 0.9], [800, 1.0]]}
DAMAGE = {  # what the last table of add_alloy.md says -> how to do it to the alloy of that page
    "no `viscosity`": lambda alloy: without(alloy, "viscosity"),
    "`liquidus` below `solidus`": lambda alloy: alloy | {"liquidus": 900},
    "two forms in one law": lambda alloy: alloy | {"surface_tension": TWO_FORMS},
    "a table whose temperatures fall": lambda alloy: alloy | {"surface_tension": FALLING},
    "a density that reaches zero": lambda alloy: alloy | {"maximum_temperature": 9000},
}


def test_the_alloy_is_whole_and_damage_to_it_is_refused(place):
    """The file of add_alloy.md passes the test of those that ship; each row of its last table is what is said."""
    page = ROOT / "docs" / "add_alloy.md"
    for block in blocks(page):
        if block.language == "yaml":
            run_yaml(place, block)
    every_number_has_a_source("aluminium")
    file = library.ALLOY_FOLDER / "aluminium.yaml"
    alloy = YAML(typ="safe").load(file.read_text(encoding="utf-8"))
    rows = re.findall(r"^\| (.+) \| `([^`]+)` \|$", page.read_text(encoding="utf-8"), re.MULTILINE)
    said = {row: sentence for row, sentence in rows if row in DAMAGE}
    assert len(said) == len(DAMAGE)
    for row, sentence in said.items():
        file.write_text(json.dumps(DAMAGE[row](alloy)), encoding="utf-8")
        forget_alloys()
        with pytest.raises(ConfigError) as refused:
            tabulate([library.load_alloy("aluminium")])
        assert sentence in str(refused.value), row
