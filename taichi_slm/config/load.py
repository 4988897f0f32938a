"""YAML file -> validated Config. Every error at once, each with file, line, key and a sentence."""

import io
import json
import os
import re
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_slm.config.checks import NEEDS, check
from taichi_slm.config.document import (
    DEEPEST,
    LARGEST_FILE,
    Node,
    Problem,
    SyntaxProblemError,
    decode,
    parse,
    planted,
    printable,
)
from taichi_slm.config.explain import explain
from taichi_slm.config.schema import Config
from taichi_slm.config.shipped import located
from taichi_slm.errors import ConfigError

LONGEST_CHAIN = 20  # files that extend one another
MOST_LINES = 100  # of errors that are shown


@dataclass(frozen=True)
class LoadedConfig:
    """A config and where it came from."""

    config: Config
    """The scene, validated and frozen; `Simulation` takes it."""
    text: str
    """The file as given; of a mapping, its JSON."""
    resolved: dict[str, Any]
    """Every key with its value, in SI."""
    path: Path
    """Where it was read."""
    warnings: tuple[str, ...] = ()
    """What is allowed but probably not meant."""
    bases: tuple[Path, ...] = ()
    """The files it extends, nearest first."""

    @property
    def resolved_text(self) -> str:
        """The same scene as YAML with every default spelled out."""
        return resolved_yaml(self.config)


def load_config(scene: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> LoadedConfig:
    """Read a scene, the files it extends, and ``overrides`` ("laser.power=200"); validate; check.

    ``scene`` is a file, or where there is no such file the name of a scene that ships ("track_150W"), or the keys
    and values themselves. Raises ConfigError, whose text has one line per error.
    """
    problems: list[Problem] = []
    bases: tuple[Path, ...] = ()
    try:
        if isinstance(scene, Mapping):
            file, tree = Path("scene.yaml"), planted(scene, "scene")
            text = json.dumps(tree.plain(), indent=2, default=str) + "\n"  # which is YAML too
        else:
            file = located(Path(scene))
            text, tree, bases = _read(file, problems)
        for override in overrides:
            tree = _set(tree, override, problems)
    except SyntaxProblemError as error:
        raise refused([*problems, error.problem]) from None
    try:
        config = Config.model_validate(tree.plain())
    except ValidationError as error:
        raise refused([*problems, *explain(error, tree)]) from None
    if problems:
        raise refused(problems)
    config = _without_dependents(config)
    errors, warnings = check(config, tree)
    if errors:
        raise refused(errors)
    resolved = config.model_dump(mode="json")
    return LoadedConfig(config, text, resolved, file, tuple(map(str, warnings)), bases)


def refused(problems: list[Problem]) -> ConfigError:
    """The error whose text has one line per problem, in reading order."""
    lines = list(dict.fromkeys(str(problem) for problem in sorted(problems, key=_reading_order)))
    if len(lines) > MOST_LINES:
        lines[MOST_LINES:] = [f"... and {len(lines) - MOST_LINES:,} more errors"]
    return ConfigError("\n".join(lines))


def _reading_order(problem: Problem) -> tuple[str, int]:
    name, _, line = problem.where.rpartition(":")
    return (name, int(line)) if line.isdigit() else (problem.where, 0)


def _without_dependents(config: Config) -> Config:
    """Terms that nobody asked for and that need one that is off are off: what is resolved is what is run.

    An imposed temperature can drive a Marangoni flow without ``heat``, but only where that is asked for.
    """
    physics = config.physics
    off: dict[str, bool] = {}
    for term, needed in NEEDS.items():
        wanted = (*needed, "heat") if term == "marangoni" else needed
        absent = any(not off.get(need, getattr(physics, need)) for need in wanted)
        if absent and term not in physics.model_fields_set:
            off[term] = False
    return config.model_copy(update={"physics": physics.model_copy(update=off)}) if off else config


# --------------------------------------------------------------------------- files


def _read(path: Path, problems: list[Problem]) -> tuple[str, Node, tuple[Path, ...]]:
    """The text of ``path``, its tree laid over those of the files it extends, and these files."""
    chain: list[Path] = []
    layers: list[Node] = []
    first = ""
    file: Path | None = path
    named = str(path)  # who asks for the file
    while file is not None:
        data = file_bytes(file, named, is_base=bool(layers))
        real = Path(os.path.realpath(file))
        if real in chain:
            circle = " -> ".join(each.name for each in [*chain, real])
            raise SyntaxProblemError(
                Problem(named, ("extends",), f"files extend each other in a circle: {circle}")
            )
        if len(chain) == LONGEST_CHAIN:
            raise SyntaxProblemError(
                Problem(named, ("extends",), f"more than {LONGEST_CHAIN} files extend each other")
            )
        chain.append(real)
        text = decode(data, str(file))
        first = first or text
        layer = parse(text, str(file), problems)
        if layer is None:
            raise SyntaxProblemError(Problem(f"{file}:1", (), "this file is empty"))
        if not isinstance(layer.value, dict):
            shown = "a list" if isinstance(layer.value, list) else f"'{printable(str(layer.value))}'"
            raise SyntaxProblemError(Problem(layer.where, (), f"expected keys with values, not {shown}"))
        entries = dict(layer.value)
        base = entries.pop("extends", None)
        layers.append(replace(layer, value=entries))
        file, named = (None, "") if base is None else (_base(base, file, chain[0].parent), base.where)
    tree = layers[-1]
    for layer in reversed(layers[:-1]):
        tree = _over(tree, layer)
    return first, tree, tuple(chain[1:])


def file_bytes(file: Path, named: str, is_base: bool = False) -> bytes:
    """The content of ``file``, whose name stands at ``named`` (file:line); ``is_base``: below `extends` there."""
    shown = f"'{printable(str(file), 200)}'"
    path: tuple[str, ...] = ("extends",) if is_base else ()
    try:
        if not stat.S_ISREG(os.stat(file).st_mode):
            kind = "a folder" if os.path.isdir(file) else "not a file"
            raise SyntaxProblemError(
                Problem(named, path, f"{shown} is {kind}" if is_base else f"this is {kind}")
            )
        with open(file, "rb") as handle:
            return handle.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        missing = f"there is no file {shown}" if is_base else "there is no such file"
        raise SyntaxProblemError(Problem(named, path, missing)) from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        reason = getattr(error, "strerror", None) or str(error)
        unread = f"{shown} cannot be read" if is_base else "this file cannot be read"
        raise SyntaxProblemError(Problem(named, path, f"{unread}: {reason}")) from None


def _base(node: Node, file: Path, root: Path) -> Path:
    """The file that ``extends`` names: a plain relative path, inside the folder of the config."""
    name = node.value
    refusal = None
    if not isinstance(name, str) or not name:
        refusal = "expected the name of a YAML file"
    elif not name.endswith((".yaml", ".yml")) or re.search(r"[^\w./+ -]", name):
        refusal = f"'{printable(name)}' is not the plain name of a .yaml file"
    elif name.startswith(("/", "~")) or ".." in name.split("/"):
        refusal = (
            f"'{printable(name)}' must lie in the folder of the config or below: no absolute path, no '..'"
        )
    elif not Path(os.path.realpath(file.parent / name)).is_relative_to(root):
        refusal = f"'{printable(name)}' leads out of the folder of the config"
    if refusal is not None:
        raise SyntaxProblemError(Problem(node.where, ("extends",), refusal))
    return file.parent / str(name)


def _over(base: Node, change: Node) -> Node:
    """``change`` laid over ``base``: mappings join key by key, all else is replaced."""
    if not isinstance(base.value, dict) or not isinstance(change.value, dict):
        return change
    entries = dict(base.value)
    for key, value in change.value.items():
        entries[key] = _over(entries[key], value) if key in entries else value
    return replace(change, value=entries)


# --------------------------------------------------------------------------- --set


def _set(tree: Node, override: str, problems: list[Problem]) -> Node:
    """The tree with one ``key.path=value`` of the command line laid over it."""
    where = f"--set {printable(override)}"
    name, equals, text = override.partition("=")
    keys = name.strip().split(".")
    if not equals or not all(keys) or len(keys) > DEEPEST:
        problems.append(Problem(where, (), "expected key.path=value, as in laser.power=200"))
        return tree
    found: list[Problem] = []
    try:
        value = parse(text, where, found, line_numbers=False)
    except SyntaxProblemError as error:
        found.append(error.problem)
        value = None
    if found:
        problems += [replace(problem, path=(*keys, *problem.path)) for problem in found]
        return tree
    try:
        return _replaced(tree, keys, value or Node(None, where), where, ())
    except SyntaxProblemError as error:
        problems.append(error.problem)
        return tree


def _replaced(node: Node, keys: list[str], value: Node, where: str, above: tuple[str | int, ...]) -> Node:
    """A copy of ``node`` with ``value`` at ``keys``; missing mappings on the way are made."""
    if not keys:
        return value
    key, rest = keys[0], keys[1:]
    if isinstance(node.value, list):
        count = len(node.value)
        if not re.fullmatch(r"\d{1,9}", key) or int(key) >= count:
            numbers = f"entries 0 to {count - 1}" if count else "none"
            sentence = f"'{printable(key)}' is not the number of an entry: this list has {numbers}"
            raise SyntaxProblemError(Problem(where, above or (key,), sentence))
        items = list(node.value)
        items[int(key)] = _replaced(items[int(key)], rest, value, where, (*above, int(key)))
        return replace(node, value=items)
    if not isinstance(node.value, dict) and node.value is not None:
        raise SyntaxProblemError(
            Problem(where, above, f"'{printable(str(node.value))}' has no keys below it")
        )
    entries = dict(node.value) if isinstance(node.value, dict) else {}
    entries[key] = _replaced(entries.get(key, Node(None, where)), rest, value, where, (*above, key))
    return replace(node, value=entries, where=node.where if node.value is not None else where)


# --------------------------------------------------------------------------- what goes out


def resolved_yaml(config: Config) -> str:
    """``config`` as YAML with every key, in SI; it loads back to an equal Config.

    Materials list only what the config says about them: the alloys that ship have their own files.
    """
    import ruamel.yaml

    data = config.model_dump(mode="json")
    data["materials"] = {
        name: material.model_dump(mode="json", exclude_none=True)
        for name, material in config.materials.items()
    }
    writer = ruamel.yaml.YAML(typ="safe", pure=True)
    writer.default_flow_style = False
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    writer.width = 120
    writer.Representer = _representer()
    stream = io.StringIO()
    stream.write("# Every key with its value, in SI units.\n")
    writer.dump(data, stream)
    return stream.getvalue()


def _representer() -> Any:
    """ruamel's, but with unprintable text in double quotes: only there does every line break survive."""
    from ruamel.yaml.representer import SafeRepresenter

    class Representer(SafeRepresenter):
        pass

    def text(representer: Any, value: str) -> Any:
        style = None if value.isprintable() else '"'
        return representer.represent_scalar("tag:yaml.org,2002:str", value, style=style)

    Representer.add_representer(str, text)
    return Representer


def schema_json() -> str:
    """The JSON schema of a config file, for editors, as text."""
    from taichi_slm.config.editor_schema import editor_schema

    return json.dumps(editor_schema(), indent=2, ensure_ascii=False) + "\n"
