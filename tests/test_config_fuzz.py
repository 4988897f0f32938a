"""Configs that nobody would write: mutated, random, hostile. A ConfigError each, never anything else."""

import math
import os
import random
import re
import string
from copy import deepcopy
from io import StringIO
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from taichi_slm.config.load import load_config, resolved_yaml
from taichi_slm.config.schema import Config
from taichi_slm.config.units import to_si
from taichi_slm.errors import ConfigError

CONFIGS = Path(__file__).parents[1] / "configs"

VALUES = (
    None,
    True,
    -1,
    0,
    3,
    1e-300,
    1e300,
    "x",
    "",
    "4 kg",
    "steel_304",
    "dwell",
    [],
    [1, 2],
    {},
    {"a": 1},
    math.pi,
)


def _places(value, path=()):
    yield path
    children = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    for key, child in children:
        yield from _places(child, (*path, key))


def _mutate(data, rng):
    """Change one thing of a config: delete, rename, repeat, move or retype."""
    *above, last = rng.choice([path for path in _places(data) if path])
    parent = data
    for key in above:
        parent = parent[key]
    action = rng.choice(("delete", "rename", "retype", "repeat"))
    if action == "retype":
        parent[last] = deepcopy(rng.choice(VALUES))  # or the next mutation changes it for all
    elif action == "delete":
        del parent[last]
    elif isinstance(parent, dict):
        letters = list(last)
        rng.shuffle(letters)
        parent["".join(letters) if action == "rename" else last + "s"] = parent.pop(last)
    else:
        parent.insert(0, parent[last])


def test_mutated_configs_never_give_a_traceback(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scenes = [path for path in sorted(CONFIGS.glob("*.yaml")) if "bodies" in originals(path)]
    rng = random.Random(1)
    writer = YAML(typ="safe", pure=True)
    refused = 0
    for number in range(300):
        data = originals(scenes[number % len(scenes)])
        for _ in range(rng.randint(1, 3)):
            if data:
                _mutate(data, rng)
        stream = StringIO()
        writer.dump(data, stream)
        Path("scene.yaml").write_text(stream.getvalue(), encoding="utf-8")
        for line in refusal("scene.yaml"):
            refused += 1
            assert line.startswith("scene.yaml"), line
            assert "pydantic" not in line
            assert "Value error" not in line
    assert refused > 200


SPOILED = (
    lambda text, rng: text.replace("  ", "\t", 1),
    lambda text, rng: _number(text, rng, "1e400"),
    lambda text, rng: _number(text, rng, ".nan"),
    lambda text, rng: _number(text, rng, "-1"),
    lambda text, rng: _number(text, rng, "9" * rng.randint(1, 400)),
    lambda text, rng: text + rng.choice(text.splitlines()) + "\n",
    lambda text, rng: text[: rng.randrange(len(text))],
    lambda text, rng: "".join(rng.sample(list(text), len(text))),
    lambda text, rng: text.replace(":", rng.choice((": &a", ": *a", ": !!python/name:os.system", ": |", ": [")), 1),
    lambda text, rng: "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
        f"{b}: &{b} [{','.join(['*' + a] * 9)}]\n" for a, b in pairwise("abcdefghi")) + text,
    lambda text, rng: text * 200,
)  # fmt: skip


def _number(text, rng, value):
    places = list(re.finditer(r"(?<=[:\[ ])[0-9.]+", text))
    place = rng.choice(places)
    return text[: place.start()] + value + text[place.end() :]


@pytest.mark.parametrize("count", [100, pytest.param(3000, marks=pytest.mark.slow)])
def test_spoiled_files_are_refused_and_leave_nothing(tmp_path, monkeypatch, count):
    """Tabs, numbers beyond all measure, repeated and torn lines, anchors, tags, wrong encodings, bytes put in."""
    monkeypatch.chdir(tmp_path)
    texts = [path.read_text(encoding="utf-8") for path in sorted(CONFIGS.glob("track_1*.yaml"))]
    rng = random.Random(2)
    refused = 0
    for number in range(count):
        text = SPOILED[number % len(SPOILED)](rng.choice(texts), rng)
        data = bytearray(text.encode(rng.choice(("utf-8", "utf-8", "utf-8", "utf-16", "latin-1")), "replace"))
        if rng.random() < 0.2:
            data[rng.randrange(len(data))] = rng.randrange(256)
        Path("scene.yaml").write_bytes(data)
        lines = refusal("scene.yaml")
        refused += bool(lines)
        assert all(line.startswith(("scene.yaml", "... and ")) for line in lines), lines
        assert os.listdir() == ["scene.yaml"]
    assert refused > 0.7 * count  # a number may be another, a line may be cut off at its comment


def one_letter_slips(key, rng):
    """A letter left out, put in, mistaken, and two exchanged."""
    at, letter = rng.randrange(len(key)), rng.choice(string.ascii_lowercase)
    yield key[:at] + key[at + 1 :]
    yield key[:at] + letter + key[at:]
    yield key[:at] + letter + key[at + 1 :]
    at = rng.randrange(max(1, len(key) - 1))
    yield key[:at] + key[at + 1 : at + 2] + key[at] + key[at + 2 :]


@pytest.mark.parametrize("count", [100, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_slip_of_one_letter_is_guessed_and_its_line_is_right(tmp_path, count):
    """In keys of shipped scenes as they are and with every default spelled out; names of materials are no keys."""
    rng = random.Random(4)
    shipped = [CONFIGS / f"{name}.yaml" for name in ("track_150W", "spot_weld_3ms", "droplet_thermal_cycle")]
    texts = [path.read_text(encoding="utf-8") for path in shipped]
    texts += [load_config(path).resolved_text for path in shipped]
    places = [
        (text, number, found)
        for text in texts
        for number, line in enumerate(text.split("\n"))
        for found in re.finditer(r"(?:(?<=^)|(?<=[\s{,]))([a-z_]{2,})(?=:)", line.split("#")[0])
        if found[1] not in ("fluid", "weld_steel")
    ]
    done = guessed = 0
    for text, number, found in (rng.choice(places) for _ in range(count)):
        for slip in one_letter_slips(found[1], rng):
            if slip == found[1]:
                continue
            lines = text.split("\n")
            lines[number] = lines[number][: found.start(1)] + slip + lines[number][found.end(1) :]
            (tmp_path / "scene.yaml").write_text("\n".join(lines), encoding="utf-8")
            here = [said for said in refusal(tmp_path / "scene.yaml") if f"scene.yaml:{number + 1}: " in said]
            assert here, (slip, found[1])
            done += 1
            guessed += any(f"Did you mean '{found[1]}'" in said for said in here)
            break
    assert guessed > 0.95 * done


def refusal(path):
    """The lines that a config is refused with, if it is."""
    try:
        load_config(path)
    except ConfigError as error:
        return str(error).split("\n")
    return []


def originals(path):
    """The merged keys of a shipped config, as its author wrote them."""
    data = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    if "extends" in data:
        data = {**originals(path.parent / data.pop("extends")), **data}
    return data


@given(data=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_refused_with_a_sentence(data, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(data)
    with pytest.raises(ConfigError):
        load_config(path)


@given(text=st.text(alphabet="abc:- \n[]{}&*!|>'\"%@`#?,\t0.1e\\xu", max_size=60))
@settings(max_examples=500, deadline=None)
def test_any_yaml_like_text_is_refused_with_a_sentence(text, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "like.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError):
        load_config(path)


@given(text=st.text(alphabet="0123456789.eE+-*^/ ()umKsW%°µ", max_size=30))
@settings(max_examples=300, deadline=None)
def test_any_quantity_is_a_finite_number_or_refused(text):
    try:
        value = to_si(text, "m")
    except ValueError:
        return
    assert math.isfinite(value)


@given(title=st.text(max_size=40))
@settings(max_examples=100, deadline=None)
@example(title="\x85")
@example(title="a\r\n b\u2028")
@example(title="1e-3")
def test_any_title_round_trips(title, tmp_path_factory):
    config = Config.model_validate(
        {"title": title, "dimension": 2, "spacing": 1e-5, "time": {"end": 1e-3},
         "bodies": [{"shape": "box", "corner": [0, 0], "size": [1e-3, 1e-3]}]}
    )  # fmt: skip
    path = tmp_path_factory.mktemp("titles") / "scene.yaml"
    path.write_bytes(resolved_yaml(config).encode("utf-8"))
    assert load_config(path).config == config
