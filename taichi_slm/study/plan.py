"""Study file -> the runs it asks for, every one of them checked as a scene before the first starts."""

import csv
import hashlib
import io
import itertools
import json
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_slm.config.document import Node, Problem, SyntaxProblemError, decode, parse, printable, resolve
from taichi_slm.config.explain import explain
from taichi_slm.config.load import LoadedConfig, file_bytes, load_config, refused
from taichi_slm.config.units import unit_at
from taichi_slm.errors import ConfigError
from taichi_slm.study.schema import (
    Axis,
    Csv,
    Grid,
    LatinHypercube,
    Overview,
    Points,
    Study,
    Zip,
    split_quantity,
)

MOST_RUNS = 10_000
LONGEST_LABEL = 60  # characters


@dataclass(frozen=True)
class Change:
    """One key of the scene that a run changes, and where the study says so."""

    key: str
    value: Any
    where: str

    @property
    def override(self) -> str:
        """As after ``--set``; JSON is YAML."""
        return f"{self.key}={json.dumps(self.value, ensure_ascii=False)}"


@dataclass(frozen=True)
class PlannedRun:
    """One run: its name, which is also its identity, and its scene."""

    name: str
    number: int  # from 1
    changes: dict[
        str, Any
    ]  # each key of the axes -> value as it is run, in SI, also where it is the scene's own
    seed: int
    scene: str  # YAML with every key


@dataclass(frozen=True)
class Plan:
    """A study that has passed every check."""

    name: str
    title: str
    text: str  # the file as given
    runs: tuple[PlannedRun, ...]
    overview: Overview
    arch: str
    precision: str
    warnings: tuple[str, ...] = ()
    analyse: bool = True  # whether the table has the chief numbers of the analysis
    units: dict[str, str] = field(default_factory=dict)  # SI units of the keys that have one

    @property
    def keys(self) -> list[str]:
        """The keys that the axes name, in their order."""
        return list(dict.fromkeys(key for run in self.runs for key in run.changes))

    def as_json(self) -> dict[str, Any]:
        """The content of plan.json."""
        runs = [{"number": r.number, "name": r.name, "seed": r.seed, "changes": r.changes} for r in self.runs]
        return {"title": self.title, "arch": self.arch, "precision": self.precision, "runs": runs}


def load_plan(path: Path, arch: str = "cpu", precision: str = "f64") -> Plan:
    """Read and check the study at ``path`` and every run of it.

    Raises ConfigError, whose text has one line per error, of the study or of its runs.
    """
    problems: list[Problem] = []
    try:
        text = decode(file_bytes(path, str(path)), str(path))
        tree = parse(text, str(path), problems)
        if tree is None or not isinstance(tree.value, dict):
            sentence = "this file is empty" if tree is None else "expected keys with values"
            raise SyntaxProblemError(Problem(f"{path}:1", (), sentence))
        study = Study.model_validate(tree.plain())
        if problems:
            raise refused(problems)
        scene = path.parent / study.scene
        if not os.path.isfile(scene):  # unlike Path's, it has an answer for any name
            raise SyntaxProblemError(
                _problem(tree, ("scene",), f"there is no file '{printable(str(scene), 200)}'")
            )
        points, common = _points(study, tree, path), _common(study, tree)
    except ValidationError as error:
        raise refused([*problems, *explain(error, tree or Node(None, str(path)), Study)]) from None
    except SyntaxProblemError as error:
        raise refused([*problems, error.problem]) from None
    runs, warnings, units = _checked(scene, common, points, f"{arch} {precision}")
    title = study.title or path.stem
    plan = Plan(path.stem, title, text, runs, study.overview, arch, precision, warnings, study.analyse, units)
    for place in ("x", "by"):
        key = getattr(study.overview, place)
        if key is not None and key not in [*plan.keys, "seed"]:
            sentence = f"'{printable(key)}' is not a key of the axes: {', '.join(plan.keys)}"
            raise refused([_problem(tree, ("overview", place), sentence)])
    return plan


# --------------------------------------------------------------------------- axes


def _points(study: Study, tree: Node, path: Path) -> list[list[Change]]:
    """What each run changes: all points of all axes with each other, once per seed."""
    axes = [list(_axis(axis, _node(tree, "axes", i), path)) for i, axis in enumerate(study.axes)]
    if study.seeds is not None or study.repeats > 1:
        axes.append(list(_seeds(study, tree, path)))
    count = math.prod(len(axis) for axis in axes)
    if count > MOST_RUNS:
        sentence = f"these axes ask for {count:,} runs; a study has {MOST_RUNS:,} at most"
        raise SyntaxProblemError(_problem(tree, ("axes",), sentence))
    points = [list(itertools.chain(*parts)) for parts in itertools.product(*axes)]
    for point in points:
        _check_keys(point)
    return points


def _check_keys(point: Sequence[Change]) -> None:
    """Keys are paths; of two changes to one key, or to a key and one below it, the second would undo the first."""
    for i, change in enumerate(point):
        if not re.fullmatch(r"[^\s=]+", change.key):
            sentence = f"'{printable(change.key)}' is not the path of a key, as laser.power is"
            raise SyntaxProblemError(Problem(change.where, (), sentence))
        for other in point[:i]:
            a, b = f"{change.key}.", f"{other.key}."
            if a.startswith(b) or b.startswith(a):
                sentence = f"this key is changed at {other.where} already, as {printable(other.key)}"
                raise SyntaxProblemError(Problem(change.where, (change.key,), sentence))


def _axis(axis: Axis, node: Node, path: Path) -> Iterator[list[Change]]:
    """The points of one axis."""
    if isinstance(axis, Grid | Zip):
        columns = [
            [Change(key, value, _node(node, "values", key, i).where) for i, value in enumerate(values)]
            for key, values in axis.values.items()
        ]
        combined = itertools.product(*columns) if isinstance(axis, Grid) else zip(*columns, strict=True)
        yield from map(list, combined)
    elif isinstance(axis, Points):
        for i, point in enumerate(axis.points):
            yield [Change(key, value, _node(node, "points", i, key).where) for key, value in point.items()]
    elif isinstance(axis, LatinHypercube):
        yield from _latin(axis, node)
    else:
        yield from _table(axis, node, path)


def _latin(axis: LatinHypercube, node: Node) -> Iterator[list[Change]]:
    from scipy.stats import qmc

    sample = qmc.LatinHypercube(len(axis.ranges), seed=axis.seed).random(axis.count)
    for row in sample:
        point = []
        for share, (key, ends) in zip(row, axis.ranges.items(), strict=True):
            (low, unit), (high, _) = map(split_quantity, ends)
            number = float(f"{low + share * (high - low):.6g}")
            value = f"{number!r} {unit}" if unit else number
            point.append(Change(key, value, _node(node, "ranges", key).where))
        yield point


def _table(axis: Csv, node: Node, path: Path) -> Iterator[list[Change]]:
    """The rows of a CSV file; an empty cell leaves its key as it is in the scene."""
    where = _node(node, "file").where
    file = path.parent / axis.file
    text = decode(file_bytes(file, where, is_base=False), str(file))
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise SyntaxProblemError(
            Problem(f"{file}:{reader.line_num}", (), f"this is not CSV: {error}")
        ) from None
    rows = [(number, row) for number, row in lines if any(row)]
    if len(rows) < 2:
        raise SyntaxProblemError(Problem(str(file), (), "expected a line of keys and lines of values"))
    (first, keys), *values = rows
    if not all(keys) or len(set(keys)) < len(keys):
        raise SyntaxProblemError(Problem(f"{file}:{first}", (), "each column needs a key of its own"))
    for number, row in values:
        here = f"{file}:{number}"
        if len(row) != len(keys):
            sentence = f"expected {len(keys)} values, as in the first line; {len(row)} are given"
            raise SyntaxProblemError(Problem(here, (), sentence))
        yield [Change(key, resolve(cell), here) for key, cell in zip(keys, row, strict=True) if cell]


def _seeds(study: Study, tree: Node, path: Path) -> Iterator[list[Change]]:
    """One change of the seed per repeat."""
    key = "repeats" if study.seeds is None else "seeds"
    seeds = study.seeds
    if seeds is None:
        first = study.set.get("seed")
        if not isinstance(first, int):
            first = load_config(path.parent / study.scene).config.seed
        seeds = [first + i for i in range(study.repeats)]
    for seed in seeds:
        yield [Change("seed", seed, _node(tree, key).where)]


def _common(study: Study, tree: Node) -> list[Change]:
    return [Change(key, value, _node(tree, "set", key).where) for key, value in study.set.items()]


def _node(tree: Node, *keys: str | int) -> Node:
    """The value at ``keys``, or the nearest one above it."""
    for key in keys:
        tree = tree.child(key) or tree
    return tree


def _problem(tree: Node, keys: tuple[str, ...], sentence: str) -> Problem:
    return Problem(_node(tree, *keys).where, keys, sentence)


# --------------------------------------------------------------------------- checks


def _checked(
    scene: Path, common: list[Change], points: Sequence[list[Change]], machine: str
) -> tuple[tuple[PlannedRun, ...], tuple[str, ...], dict[str, str]]:
    """Every run as a scene that has passed its checks, the warnings, the keys' units; all errors at once."""
    runs: list[PlannedRun] = []
    keys = list(dict.fromkeys(change.key for point in points for change in point if change.key != "seed"))
    units: dict[str, str] = {}
    drawn = False  # whether a seed makes a difference to any run
    errors: dict[str, list[int]] = {}  # line -> numbers of the runs that it is said of
    warnings: dict[str, None] = {}
    first: dict[str, PlannedRun] = {}
    for number, point in enumerate(points, 1):
        changes = [*common, *point]
        try:
            loaded = load_config(scene, [change.override for change in changes])
        except ConfigError as error:
            for line in str(error).splitlines():
                errors.setdefault(_located(line, changes), []).append(number)
            continue
        warnings |= dict.fromkeys(loaded.warnings)
        run = _planned(loaded, point, keys, number, machine)
        units |= {key: unit for key in keys if (unit := unit_at(loaded.config, key))}
        drawn = drawn or any(body.shape == "powder_bed" for body in loaded.config.bodies)
        twin = first.setdefault(run.name.rpartition("-")[2], run)
        if twin is not run:
            where = point[-1].where if point else str(scene)
            said = f"{where}: run {number} is the same scene as run {twin.number}; a repeat needs a seed of its own."
            errors.setdefault(said, []).append(number)
        runs.append(run)
    if errors:
        shown = [line + _of(numbers, len(points)) for line, numbers in errors.items()]
        more = [f"... and {len(shown) - 100:,} more errors"] if len(shown) > 100 else []
        raise ConfigError("\n".join(shown[:100] + more))
    if len({run.seed for run in runs}) > 1 and not drawn:
        warnings["no run has a powder_bed: runs that differ in their seed alone will be equal"] = None
    return tuple(runs), tuple(warnings), units


def _located(line: str, changes: Sequence[Change]) -> str:
    """An error of a scene, with the place in the study in front where the study is to blame."""
    for change in changes:
        said = f"--set {printable(change.override)}: "
        if line.startswith(said):
            return f"{change.where}: {line[len(said) :]}"
    return line


def _of(numbers: Sequence[int], count: int) -> str:
    if len(numbers) == count:
        return ""
    shown = ", ".join(map(str, numbers[:5])) + (", ..." if len(numbers) > 5 else "")
    return f" (run {shown} of {count})"


def _planned(
    loaded: LoadedConfig, point: Sequence[Change], keys: Sequence[str], number: int, machine: str
) -> PlannedRun:
    """The run of ``point``, one of those of a study whose axes have the keys ``keys``."""
    values = {key: _value_at(loaded.resolved, key) for key in keys}
    text = loaded.resolved_text
    digest = hashlib.sha256(f"{machine}\n{text}".encode()).hexdigest()[:10]
    shown = {change.key: values[change.key] for change in point if change.key != "seed"}
    if any(change.key == "seed" for change in point):
        shown["seed"] = loaded.config.seed
    words = [f"{last_word(key)}={short(value)}" for key, value in shown.items()]
    label = re.sub(r"[^\w.+=-]", "", "_".join(words), flags=re.ASCII)[:LONGEST_LABEL].strip(".-_") or "run"
    return PlannedRun(f"{label}-{digest}", number, values, loaded.config.seed, text)


def short(value: Any) -> str:
    """A value in few characters; nothing where it is a list or a mapping."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if isinstance(value, list | dict) else str(value)


def last_word(key: str) -> str:
    """The last word of a key's path that is no number: "speed" of laser.path.0.speed."""
    return next((word for word in reversed(key.split(".")) if not word.isdigit()), key)


def _value_at(resolved: Any, key: str) -> Any:
    """The value of ``key`` in a resolved config: in SI, whatever unit the study gave it in; None without one."""
    for word in key.split("."):
        if isinstance(resolved, list):
            resolved = resolved[int(word)] if word.isdigit() and int(word) < len(resolved) else None
        else:
            resolved = resolved.get(word) if isinstance(resolved, dict) else None
    return resolved


def with_only(plan: Plan, number: int | None) -> Plan:
    """The plan with the one run ``number`` (from 1), or all of it."""
    if number is None:
        return plan
    if not 1 <= number <= len(plan.runs):
        raise ConfigError(f"--only {number}: this study has runs 1 to {len(plan.runs)}.")
    return replace(plan, runs=(plan.runs[number - 1],))
