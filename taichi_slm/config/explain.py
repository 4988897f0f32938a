"""pydantic's complaints -> sentences with file, line, key and "did you mean"."""

import difflib
import types
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from taichi_slm.config.document import Node, Problem, printable
from taichi_slm.config.schema import Config

FILE_KEYS = ("extends",)  # keys of a file that are not keys of the Config


@dataclass(frozen=True)
class Place:
    """Where an error is: its path as a user writes it, the nearest value there is, what belongs there."""

    path: tuple[str | int, ...]
    node: Node
    exists: bool  # node is the value at `path` itself, not one that encloses it
    model: type[BaseModel] | None  # whose key the last one is
    branch: str | None  # its name, where it is one of several
    about: FieldInfo | None
    kind: Any  # the type that belongs at `path`
    around: Node  # the value that holds it


def explain(error: ValidationError, tree: Node, root: type[BaseModel] = Config) -> list[Problem]:
    """One problem per error of ``error``, which came from validating ``tree`` as a ``root``."""
    problems: list[Problem] = []
    mended: set[tuple[str | int, ...]] = set()  # keys that a misspelt one was meant to be
    for item in error.errors(include_url=False):
        place = locate(tree, item["loc"], root)
        problem = _problem(item, place)
        problems.append(problem)
        if item["type"] == "extra_forbidden" and problem.meant:
            mended.add((*place.path[:-1], problem.meant))
    return [p for p in problems if not (p.path in mended and p.sentence.startswith("this key is required"))]


def locate(tree: Node, loc: Iterable[str | int], root: type[BaseModel] = Config) -> Place:
    """Follow pydantic's ``loc``, which names branches of unions too, through the tree and the schema."""
    kind: Any = root
    around: Any = None
    node, exists = tree, True
    holder = tree
    path: list[str | int] = []
    model: type[BaseModel] | None = None
    branch: str | None = None
    about: FieldInfo | None = None
    for key in loc:
        branches = _branches(kind)
        if branches is not None and str(key) in branches[1]:
            kind, branch = branches[1][str(key)], str(key)
            continue
        if key == "[key]":  # the key itself is wrong, and it is in the path already
            kind = get_args(_bare(around))[0]
            break
        around = kind
        model, about, kind, branch = _descend(kind, key, branch)
        path.append(key)
        holder = node
        below = node.child(key) if exists else None
        node, exists = (below, True) if below is not None else (node, False)
    return Place(tuple(path), node, exists, model, branch, about, kind, holder)


def _descend(
    kind: Any, key: str | int, branch: str | None
) -> tuple[type[BaseModel] | None, FieldInfo | None, Any, str | None]:
    """What ``key`` is in a ``kind``: (the model it is a key of, its field, its type, the model's branch)."""
    bare = _bare(kind)
    if isinstance(bare, type) and issubclass(bare, BaseModel):
        about = bare.model_fields.get(str(key))
        if about is None:
            return bare, None, Any, branch
        inner = Annotated[about.annotation, about] if about.discriminator else about.annotation
        return bare, about, inner, branch
    arguments = get_args(bare)
    if get_origin(bare) is dict:
        return None, None, arguments[1], None
    if (
        get_origin(bare) is tuple
        and isinstance(key, int)
        and key < len(arguments)
        and arguments[-1] is not ...
    ):
        return None, None, arguments[key], None
    return None, None, arguments[0] if arguments else Any, None


def _bare(kind: Any) -> Any:
    """A type without Annotated and without `| None`."""
    while True:
        if get_origin(kind) is Annotated:
            kind = get_args(kind)[0]
        elif get_origin(kind) in (Union, types.UnionType):
            members = [member for member in get_args(kind) if member is not type(None)]
            if len(members) != 1:
                return kind
            kind = members[0]
        else:
            return kind


def _branches(kind: Any) -> tuple[str, dict[str, type[BaseModel]]] | None:
    """(discriminator, {its value: model}) of a tagged union, or None."""
    while get_origin(kind) in (Union, types.UnionType):  # `Program | None`
        members = [member for member in get_args(kind) if member is not type(None)]
        if len(members) != 1:
            return None
        kind = members[0]
    if get_origin(kind) is not Annotated:
        return None
    union, *notes = get_args(kind)
    tag = next((note.discriminator for note in notes if getattr(note, "discriminator", None)), None)
    if not isinstance(tag, str):
        return None
    models: tuple[type[BaseModel], ...] = get_args(union)
    return tag, {get_args(m.model_fields[tag].annotation)[0]: m for m in models}


def _problem(item: Any, place: Place) -> Problem:
    kind, context = item["type"], item.get("ctx", {})
    where, path = place.node.where, place.path
    if kind == "extra_forbidden":
        return _unknown_key(place)
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _unknown_branch(place, context)
    if kind == "missing":
        if path and isinstance(path[-1], int):
            return Problem(where, path[:-1], f"too few entries: there is no number {path[-1] + 1}")
        note = f" ({place.about.description})" if place.about and place.about.description else ""
        return Problem(where, path, f"this key is required{note}")
    if kind == "literal_error" and place.exists:
        choices = [str(value) for value in _literals(place.kind)]
        by_key = item["loc"][-1] == "[key]"
        given = place.path[-1] if by_key else place.node.value
        shown = printable(str(given)) if not isinstance(given, dict | list) else "this"
        return Problem(where, path, f"'{shown}' is not one of {', '.join(choices)}", closest(shown, choices))
    return Problem(where, path, _sentence(kind, context, place.node.value) or _last_resort(item))


def _unknown_key(place: Place) -> Problem:
    key = str(place.path[-1])
    given = place.around.value if isinstance(place.around.value, dict) else {}
    keys = [*(place.model.model_fields if place.model else ()), *(FILE_KEYS if place.model is Config else ())]
    if key == "<<":
        return Problem(place.node.where, place.path, "merge keys are not read; write 'extends: other.yaml'")
    meant = closest(key, keys)  # a section of a base file is given already, and misspelt all the same
    if meant in given and (absent := closest(key, [each for each in keys if each not in given], 0.75)):
        meant = absent
    if meant is None and key in _homes():
        homes = [home for home in _homes()[key] if home != ".".join(map(str, place.path))]
        meant = homes[0] if homes else None
    of = f" of '{place.branch}'" if place.branch else ""
    return Problem(place.node.where, place.path, f"unknown key{of}", meant)


def _unknown_branch(place: Place, context: Any) -> Problem:
    tag = context["discriminator"].strip("'")
    branches = _branches(place.kind)
    choices = list(branches[1]) if branches else []
    given = place.node.child(tag)
    if given is None:  # the tag is missing, or its name is misspelt
        names = list(place.node.value) if isinstance(place.node.value, dict) else []
        slip = closest(tag, names)
        if slip is not None and (wrong := place.node.child(slip)) is not None:
            return Problem(wrong.where, (*place.path, slip), "unknown key", tag)
        return Problem(
            place.node.where, (*place.path, tag), f"this key is required: one of {', '.join(choices)}"
        )
    shown = printable(str(given.value)) if not isinstance(given.value, dict | list) else "this"
    sentence = f"'{shown}' is not one of {', '.join(choices)}"
    return Problem(given.where, (*place.path, tag), sentence, closest(shown, choices))


def _literals(kind: Any) -> Iterator[Any]:
    if get_origin(kind) is Literal:
        yield from get_args(kind)
    else:
        for part in get_args(kind):
            yield from _literals(part)


@cache
def _homes() -> dict[str, list[str]]:
    """Key -> the paths at which the sections of a config (not its lists) know it."""
    found: dict[str, list[str]] = {}

    def walk(model: type[BaseModel], prefix: str) -> None:
        for name, about in model.model_fields.items():
            found.setdefault(name, []).append(prefix + name)
            inner = _bare(about.annotation)
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                walk(inner, f"{prefix}{name}.")

    walk(Config, "")
    return found


def closest(word: str, choices: Iterable[str], likeness: float = 0.6) -> str | None:
    """The choice that ``word`` was probably meant to be; ``likeness``: difflib's ratio that it has at least."""
    by_form = {choice.lower().replace("-", "_"): choice for choice in choices}
    found = difflib.get_close_matches(word[:80].lower().replace("-", "_"), by_form, n=1, cutoff=likeness)
    return by_form[found[0]] if found else None


_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_EXPECTED = {
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "string": "text",
    "list": "a list",
    "tuple": "a list",
    "dict": "keys with values below it",
    "model": "keys with values below it",
}


def _sentence(kind: str, context: Any, value: Any) -> str | None:
    """pydantic's ``kind`` of error in plain words, or None for one that has none here."""
    given = "nothing is given" if value is None else f"'{printable(str(value))}' is given"
    if isinstance(value, dict | list):
        given = "a list is given" if isinstance(value, list) else "keys with values are given"
    if kind == "value_error":
        sentence = str(context["error"])
        return f"{sentence}; {given}" if sentence.startswith("expected") else sentence
    if kind in _BOUNDS:
        name, words = _BOUNDS[kind]
        return f"must be {words} {context[name]}; {given}"
    if kind in ("too_short", "too_long"):
        limit = context.get("min_length") if kind == "too_short" else context.get("max_length")
        words = "at least" if kind == "too_short" else "at most"
        return f"expected {words} {limit} entries; {len(value) if isinstance(value, list) else 0} given"
    expected = _EXPECTED.get(kind.split("_")[0])
    return f"expected {expected}; {given}" if expected else None


def _last_resort(item: Any) -> str:
    text = str(item["msg"])
    return text[:1].lower() + text[1:]
