"""YAML text -> a tree of values in which each value knows the file and line it came from.

The scanner and parser are ruamel.yaml's (YAML 1.2); scalars are resolved here by the core schema, so that
``50e-6`` is a number, ``no`` is text, and no tag can build an object.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

LARGEST_FILE = 1_000_000  # bytes
LARGEST_TREE = 200_000  # values, after aliases are expanded
DEEPEST = 30  # levels

Scalar = str | int | float | bool | None


@dataclass(frozen=True)
class Node:
    """One value of a config, and where it was given: ``file:line`` or ``--set key=value``."""

    value: "dict[str, Node] | list[Node] | Scalar"
    where: str
    size: int = 1  # values in and below this one

    def plain(self) -> Any:
        """The value and all below it as ordinary Python objects."""
        if isinstance(self.value, dict):
            return {key: child.plain() for key, child in self.value.items()}
        if isinstance(self.value, list):
            return [child.plain() for child in self.value]
        return self.value

    def child(self, key: Any) -> "Node | None":
        """The value under a key of a mapping or an index of a list, if there is one."""
        if isinstance(self.value, dict):
            return self.value.get(key) if isinstance(key, str) else None
        if isinstance(self.value, list) and isinstance(key, int) and 0 <= key < len(self.value):
            return self.value[key]
        return None


def planted(value: Any, where: str) -> Node:
    """The tree of ordinary Python objects: mappings, lists, tuples, numpy's, and what YAML calls scalars."""
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        value = value.tolist()
    if isinstance(value, Mapping):
        entries = {str(key): planted(item, where) for key, item in value.items()}
        return Node(entries, where, 1 + sum(item.size for item in entries.values()))
    if isinstance(value, list | tuple):
        items = [planted(item, where) for item in value]
        return Node(items, where, 1 + sum(item.size for item in items))
    return Node(value, where)


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where, which key, a sentence without its full stop, and what was meant."""

    where: str
    path: tuple[str | int, ...]
    sentence: str
    meant: str | None = None

    def __str__(self) -> str:
        parts = [printable(self.where, 300)]
        if self.path:
            parts.append(".".join(printable(str(key)) for key in self.path))
        hint = f" Did you mean '{printable(self.meant)}'?" if self.meant else ""
        return f"{': '.join(parts)}: {printable(self.sentence, 400)}.{hint}"


class SyntaxProblemError(Exception):
    """The text is not YAML that can be read further; carries the one problem."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(str(problem))
        self.problem = problem


def printable(text: str, longest: int = 60) -> str:
    """``text`` on one line, without control characters, cut to a readable length."""
    text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[: longest + 1])
    return text if len(text) <= longest else text[: longest - 3] + "..."


def decode(data: bytes, name: str) -> str:
    """UTF-8 bytes, with or without a byte-order mark, as text. Raises :class:`SyntaxProblemError`."""
    if len(data) > LARGEST_FILE:
        raise _refusal(name, "this file is larger than 1 MB; a config is a page of text")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise _refusal(name, "this is UTF-16; save it as UTF-8")
    if b"\0" in data:
        raise _refusal(name, "this is a binary file, not YAML")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise _refusal(f"{name}:{line}", f"byte 0x{data[error.start]:02x} is not UTF-8 text") from None
    strange = re.search(r"[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", text)
    if strange is not None:
        line = text.count("\n", 0, strange.start()) + 1
        raise _refusal(f"{name}:{line}", f"control character U+{ord(strange[0]):04X} is not allowed in YAML")
    return text


def parse(text: str, name: str, problems: list[Problem], line_numbers: bool = True) -> Node | None:
    """The tree of the one document in ``text``, or None where it is empty.

    What leaves the rest readable (a key given twice, a tag) is appended to ``problems``; what does not raises
    :class:`SyntaxProblemError`. ``line_numbers=False`` is for text of one line, from a command.
    """
    import ruamel.yaml

    reader = ruamel.yaml.YAML(typ="safe", pure=True)
    try:
        return _Composer(name, line_numbers, problems).document(reader.parse(text))
    except ruamel.yaml.error.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        if "unexpected end of stream" in str(error.problem):
            mark = error.context_mark or mark
        where = f"{name}:{mark.line + 1}" if line_numbers and mark else name
        raise _refusal(where, _reworded(error, text, mark)) from None
    except (ruamel.yaml.error.YAMLError, ValueError, LookupError, TypeError, AttributeError, AssertionError):
        # ruamel's own slips on malformed input (an escape such as \U99999999, say) mean the same to a user
        raise _refusal(name, "this is not valid YAML") from None


def _refusal(where: str, sentence: str, path: tuple[str | int, ...] = ()) -> SyntaxProblemError:
    return SyntaxProblemError(Problem(where, path, sentence))


def _reworded(error: Any, text: str, mark: Any) -> str:
    problem = str(error.problem)
    lines = text.split("\n")
    line = lines[mark.line] if mark and mark.line < len(lines) else ""
    if "\\t" in problem or "\t" in line[: len(line) - len(line.lstrip())]:
        return "a tab is used for indentation; YAML takes spaces only"
    if problem == "mapping values are not allowed here":
        return "a second ':' on this line, or a key indented deeper than the one above it"
    if problem == "could not find expected ':'":
        return "a key without ':' after it"
    if "unexpected end of stream" in problem:
        return "a quote is opened here and never closed"
    if str(error.context).startswith("while parsing a flow"):
        bracket = "[" if "sequence" in error.context else "{"
        opened = f" of line {error.context_mark.line + 1}" if "\n" in text else ""
        return f"'{bracket}'{opened} is not closed, or a ',' is missing"
    return f"this is not valid YAML: {problem}"


@dataclass
class _Composer:
    """Events of a YAML parser -> nodes."""

    name: str
    line_numbers: bool
    problems: list[Problem]
    anchors: dict[str, Node | None] = field(default_factory=dict)  # None: still open

    def document(self, events: Iterator[Any]) -> Node | None:
        root = None
        for event in events:
            kind = type(event).__name__
            if kind == "DocumentStartEvent":
                if root is not None:
                    raise _refusal(
                        self.where(event), "a second document starts here; a config is one document"
                    )
                root = self.node(next(events), events, (), None)
        return None if root is None or root.value is None else root

    def where(self, event: Any) -> str:
        return f"{self.name}:{event.start_mark.line + 1}" if self.line_numbers else self.name

    def node(self, event: Any, events: Iterator[Any], path: tuple[str | int, ...], where: str | None) -> Node:
        """The value that starts with ``event``; ``where`` is its key's place, if it has a key."""
        where = where or self.where(event)
        if len(path) > DEEPEST:
            raise _refusal(where, f"more than {DEEPEST} levels deep")
        kind = type(event).__name__
        if kind == "AliasEvent":
            return replace(self.aliased(event, where, path), where=where)
        if event.anchor is not None:
            self.anchors[event.anchor] = None
        if event.tag is not None:
            tag = str(event.tag).replace("tag:yaml.org,2002:", "!!")
            self.problems.append(Problem(where, path, f"tags are not read: remove '{printable(tag)}'"))
        if kind == "ScalarEvent":
            node = Node(self.scalar(event, where, path), where)
        elif kind == "SequenceStartEvent":
            node = self.sequence(where, events, path)
        else:
            node = self.mapping(where, events, path)
        if event.anchor is not None:
            self.anchors[event.anchor] = node
        return node

    def aliased(self, event: Any, where: str, path: tuple[str | int, ...]) -> Node:
        if event.anchor not in self.anchors:
            raise _refusal(where, f"'*{event.anchor}' has no anchor '&{event.anchor}' above it", path)
        node = self.anchors[event.anchor]
        if node is None:
            raise _refusal(where, f"'*{event.anchor}' contains itself", path)
        return node

    def sequence(self, where: str, events: Iterator[Any], path: tuple[str | int, ...]) -> Node:
        items: list[Node] = []
        size = 1
        for event in events:
            if type(event).__name__ == "SequenceEndEvent":
                break
            items.append(self.node(event, events, (*path, len(items)), None))
            size = _grown(size, items[-1], where, path)
        return Node(items, where, size)

    def mapping(self, where: str, events: Iterator[Any], path: tuple[str | int, ...]) -> Node:
        entries: dict[str, Node] = {}
        size = 1
        for event in events:
            if type(event).__name__ == "MappingEndEvent":
                break
            here = self.where(event)
            key = self.key(event, events, here, path)
            value = self.node(next(events), events, (*path, key or "?"), here)
            size = _grown(size, value, where, path)
            if key is None:
                continue
            if key in entries:
                earlier = entries[key].where.rpartition(":")[2]
                again = f"line {earlier}" if self.line_numbers else "before"
                self.problems.append(Problem(here, (*path, key), f"this key was already given on {again}"))
            entries.setdefault(key, value)
        return Node(entries, where, size)

    def key(self, event: Any, events: Iterator[Any], here: str, path: tuple[str | int, ...]) -> str | None:
        """The name of a key; None, and a problem noted, where it is not text."""
        node = self.node(event, events, (*path, "?"), here)
        if isinstance(node.value, str):
            return node.value
        shown = event.value if type(event).__name__ == "ScalarEvent" else "this"
        self.problems.append(Problem(here, path, f"'{printable(shown)}' is not a key: keys are words"))
        return None

    def scalar(self, event: Any, where: str, path: tuple[str | int, ...]) -> Scalar:
        text: str = event.value
        if any("\ud800" <= c <= "\udfff" for c in text):
            self.problems.append(Problem(where, path, "half of a surrogate pair is not text"))
            return ""
        return resolve(text) if event.style is None and event.tag is None else text


def _grown(size: int, child: Node, where: str, path: tuple[str | int, ...]) -> int:
    if size + child.size > LARGEST_TREE:
        raise _refusal(where, f"more than {LARGEST_TREE:,} values once aliases are expanded", path)
    return size + child.size


_WORDS: Mapping[str, Scalar] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


def resolve(text: str) -> Scalar:
    """A plain (unquoted) YAML scalar by the core schema of YAML 1.2, section 10.3.2.

    Except that what is not finite (``.nan``, ``.inf``, ``1e400``) stays text: no key takes it, and
    the message can quote it.
    """
    if text in _WORDS:
        return _WORDS[text]
    if len(text) > 300:  # too long for a number that anybody means
        return text
    if _INTEGER.fullmatch(text):
        return int(text)
    if _BASED.fullmatch(text):
        return int(text, 0)
    if _FLOAT.fullmatch(text) and math.isfinite(number := float(text)):
        return number
    return text
