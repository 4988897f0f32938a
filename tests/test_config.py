"""Configs: every mistake gets exit code 2 and one exact line; every shipped one is valid and round-trips."""

from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from taichi_slm.config.document import resolve
from taichi_slm.config.load import load_config, schema_json
from taichi_slm.config.units import to_si
from taichi_slm.errors import ConfigError

CONFIGS = Path(__file__).parents[1] / "configs"
GOOD = """\
dimension: 2
spacing: 4 um
bodies:
  - {shape: plate, length: 1 mm, depth: 0.1 mm}
  - shape: powder_row
    length: 1 mm
    radius: 25 um
laser:
  power: 150
  beam_radius: 54 um
  path: [{kind: line, start: [0], end: [1e-3], speed: 1.0}]
time: {end: 1.2e-3}
"""


def _is_scene(path: Path) -> bool:
    """A base file has no dimension, neither its own nor one that it takes over."""
    keys = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    return "dimension" in keys or "extends" in keys


SCENES = [path for path in sorted(CONFIGS.glob("*.yaml")) if _is_scene(path)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working directory, so that messages name files as a user would."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(text, name="scene.yaml"):
    data = text if isinstance(text, bytes) else text.encode("utf-8")
    Path(name).write_bytes(data)
    return name


def errors(text, *overrides, name="scene.yaml"):
    """The lines that a config is refused with."""
    with pytest.raises(ConfigError) as caught:
        load_config(write(text, name), overrides)
    assert caught.value.exit_code == 2
    return str(caught.value).split("\n")


# --------------------------------------------------------------------------- good ones


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_config_is_valid_and_round_trips(path, folder):
    loaded = load_config(path)
    assert loaded.warnings == ()
    again = load_config(write(loaded.resolved_text))
    assert again.config == loaded.config
    assert again.warnings == ()
    assert again.resolved == loaded.resolved


def test_scenes_are_found():
    assert len(SCENES) >= 10


def test_numbers_and_units(folder):
    config = load_config(write(GOOD), ["laser.power=1.5e2", "bodies.1.radius=30e-6"]).config
    assert config.spacing == 4e-6
    assert config.laser.power == 150.0
    assert config.bodies[1].radius == 30e-6


@pytest.mark.parametrize(
    ("text", "value"),
    [("50e-6", 50e-6), ("1e-3", 1e-3), ("-.5", -0.5), ("5.", 5.0), ("017", 17), ("0o17", 15), ("0x1F", 31),
     ("~", None), ("true", True), ("no", "no"), ("12:30", "12:30"), ("1e400", "1e400"), (".nan", ".nan"),
     ("1_000", "1_000"), ("2001-01-01", "2001-01-01")],
)  # fmt: skip
def test_yaml_1_2_core_schema(text, value):
    assert resolve(text) == value
    assert type(resolve(text)) is type(value)


@pytest.mark.parametrize("text", ["3.7 um", "0.25 mm", "1.5e3 nm", "54um", "-2 cm", "7 µm", "12 m"])
def test_common_units_agree_with_pint(text):
    import pint

    assert to_si(text, "m") == pytest.approx(pint.UnitRegistry().Quantity(text).to("m").magnitude, rel=1e-15)


def test_unit_of_a_decimal_is_exact():
    assert to_si("54 um", "m") == 54e-6
    assert to_si("20 degC", "K") == 293.15
    assert to_si("27 %", "") == 0.27


def test_a_term_without_what_it_needs_is_off_unless_asked_for(folder):
    physics = load_config(write(GOOD), ["physics.flow=false"]).config.physics
    assert (physics.surface_tension, physics.marangoni, physics.viscous_heating) == (False, False, False)
    assert physics.radiation
    assert errors(GOOD, "physics.surface_tension=false", "physics.marangoni=true") == [
        "--set physics.marangoni=true: physics.marangoni: this needs physics.surface_tension, which is off."
    ]


def test_schema_file_is_up_to_date():
    assert (CONFIGS / "schema.json").read_text(encoding="utf-8") == schema_json()


# --------------------------------------------------------------------------- one mistake each


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("spacing:", "seed: true\nspacing:", "scene.yaml:2: seed: expected a whole number; 'True' is given."),
        ("time:", "materials: {m: {extends: steel_304, solidus: 1800}}\ntime:",
         "scene.yaml:12: materials.m: material 'm': solidus 1800 K is not below liquidus 1773 K."),
        ("spacing:", "spacng:", "scene.yaml:2: spacng: unknown key. Did you mean 'spacing'?"),
        ("  power: 150", "  powr: 150", "scene.yaml:9: laser.powr: unknown key. Did you mean 'power'?"),
        ("length: 1 mm, ", "lenght: 1 mm, ",
         "scene.yaml:4: bodies.0.lenght: unknown key of 'plate'. Did you mean 'length'?"),
        ("shape: plate", "shape: plat",
         "scene.yaml:4: bodies.0.shape: 'plat' is not one of plate, powder_row, powder_bed, "
         "droplet, box, container. Did you mean 'plate'?"),
        ("shape: plate", "shap: plate", "scene.yaml:4: bodies.0.shap: unknown key. Did you mean 'shape'?"),
        ("time:", "power: 3\ntime:", "scene.yaml:12: power: unknown key. Did you mean 'laser.power'?"),
        ("4 um", "4 kg", "scene.yaml:2: spacing: '4 kg' is in kilogram, which cannot be turned into m."),
        ("4 um", "4 furlongs per egg",
         "scene.yaml:2: spacing: 'furlongs per egg' is not a unit; expected one such as 'm'."),
        ("4 um", "-4 um", "scene.yaml:2: spacing: must be greater than 0; '-4 um' is given."),
        ("4 um", "0", "scene.yaml:2: spacing: must be greater than 0; '0' is given."),
        ("4 um", ".nan", "scene.yaml:2: spacing: .nan is not a finite number."),
        ("4 um", ".inf", "scene.yaml:2: spacing: .inf is not a finite number."),
        ("4 um", "1e400", "scene.yaml:2: spacing: 1e400 is not a finite number."),
        ("4 um", "1e400 um", "scene.yaml:2: spacing: 1e400 um is not a finite number."),
        ("4 um", "yes", "scene.yaml:2: spacing: 'yes' is not a number with a unit such as '1 m'."),
        ("4 um", "", "scene.yaml:2: spacing: expected a number or a string with a unit such as '1 m'; "
         "nothing is given."),
        ("4 um", "[4]", "scene.yaml:2: spacing: expected a number or a string with a unit such as '1 m'; "
         "a list is given."),
        ("150", "true", "scene.yaml:9: laser.power: expected a number or a string with a unit such as '1 W'; "
         "'True' is given."),
        ("dimension: 2", "dimension: 4", "scene.yaml:1: dimension: '4' is not one of 2, 3."),
        ("dimension: 2\n", "", "scene.yaml:1: dimension: this key is required."),
        ("  power: 150\n", "", "scene.yaml:8: laser.power: this key is required."),
        ("[{kind: line", "[{kind: lin",
         "scene.yaml:11: laser.path.0.kind: 'lin' is not one of line, dwell. Did you mean 'line'?"),
        ("start: [0]", "start: [0, 0]",
         "scene.yaml:11: laser.path.0.start: a beam in a 2-D scene has 1 coordinate (x), not 2."),
        ("time: {end: 1.2e-3}", "time: 3",
         "scene.yaml:12: time: expected keys with values below it; '3' is given."),
        ("time:", "seed: 1.5\ntime:", "scene.yaml:12: seed: expected a whole number; '1.5' is given."),
        ("time:", "title: [a]\ntime:", "scene.yaml:12: title: expected text; a list is given."),
        ("time:", "physics: {flow: maybe}\ntime:",
         "scene.yaml:12: physics.flow: expected true or false; 'maybe' is given."),
        ("time:", "spacing: 5 um\ntime:", "scene.yaml:12: spacing: this key was already given on line 2."),
        ("time:", "3: 4\ntime:", "scene.yaml:12: '3' is not a key: keys are words."),
        ("time:", "title: !!python/object:os.system ls\ntime:",
         "scene.yaml:12: title: tags are not read: remove '!!python/object:os.system'."),
        ("time:", "<<: {seed: 1}\ntime:",
         "scene.yaml:12: <<: merge keys are not read; write 'extends: other.yaml'."),
        ("time:", "\tseed: 1\ntime:",
         "scene.yaml:12: a tab is used for indentation; YAML takes spaces only."),
        ("time:", "title: 'x\ntime:", "scene.yaml:12: a quote is opened here and never closed."),
        ("time:", "title: *a\ntime:", "scene.yaml:12: title: '*a' has no anchor '&a' above it."),
        ("time:", "title: &a [*a]\ntime:", "scene.yaml:12: title.0: '*a' contains itself."),
        ("time:", "---\ntime:", "scene.yaml:12: a second document starts here; a config is one document."),
        ("radius: 25 um", "radius: 25 um\n    material: steel_30",
         "scene.yaml:8: bodies.1.material: there is no material 'steel_30': there are "
         "316L, IN625, Ti6Al4V, steel_304, steel_304_physical. Did you mean 'steel_304'?"),
        ("time:", "materials: {steel: {extends: 316l}}\ntime:",
         "scene.yaml:12: materials.steel.extends: there is no material '316l': there are "
         "316L, IN625, Ti6Al4V, steel, steel_304, steel_304_physical. Did you mean '316L'?"),
        ("time:", "physics: {heat: false}\ntime:",
         "scene.yaml:8: laser: a laser heats nothing while physics.heat is off; leave one of the two out."),
        ("time:", "physics: {recoil: true}\ntime:",
         "scene.yaml:12: physics.recoil: this needs physics.evaporation, which is off."),
        ("time:", "numerics: {smoothing: 2}\ntime:",
         "scene.yaml:12: numerics.surface_smoothing: the kernel of the surface must be at least as wide as that of the "
         "flow; 1.8 is less than a smoothing of 2."),
        ("end: [1e-3]", "end: [1]\ndomain: {lower: [-1e-3, -1e-3], upper: [2e-3, 1e-3]}",
         "scene.yaml:12: '{' of line 11 is not closed, or a ',' is missing."),
        ("time:", "domain: {lower: [-1e-3, -1e-3], upper: [1.1e-3, 1e-5]}\ntime:",
         "scene.yaml:5: bodies.1: this body reaches out of the domain."),
        ("4 um", "1 nm", "scene.yaml:2: spacing: about 1.4e+11 particles, more than 50,000,000: "
         "a unit may be missing."),
        ("radius: 25 um", "radius: 1 um",
         "scene.yaml:7: bodies.1.radius: a grain of radius 1e-06 m is smaller than one particle "
         "(spacing 4e-06 m)."),
        ("[0], end: [1e-3]", "[5], end: [6]", "scene.yaml:11: laser.path: the beam never meets a body."),
        ("depth: 0.1 mm", "depth: 0.1 mm, width: 1 mm",
         "scene.yaml:4: bodies.0.width: a width means nothing in 2-D."),
        ("time:", "output: {images: [state, cut]}\ntime:",
         "scene.yaml:12: output.images.1: a picture 'cut' exists in 3-D only."),
    ],
)  # fmt: skip
def test_one_mistake(old, new, line, folder):
    text = GOOD.replace(old, new, 1)
    assert text != GOOD
    assert errors(text) == [line]


def test_all_mistakes_at_once(folder):
    text = GOOD.replace("spacing", "spacng").replace("150", "-1").replace("25 um", "25 kg") + "spacng: 3\n"
    assert errors(text, "laser.paht=3", "seed=x", "bodies.7.radius=1", "nonsense") == [
        "--set bodies.7.radius=1: bodies: '7' is not the number of an entry: this list has entries 0 to 1.",
        "--set laser.paht=3: laser.paht: unknown key. Did you mean 'path'?",
        "--set nonsense: expected key.path=value, as in laser.power=200.",
        "--set seed=x: seed: expected a whole number; 'x' is given.",
        "scene.yaml:2: spacng: unknown key. Did you mean 'spacing'?",
        "scene.yaml:7: bodies.1.radius: '25 kg' is in kilogram, which cannot be turned into m.",
        "scene.yaml:9: laser.power: must be at least 0; '-1' is given.",
        "scene.yaml:13: spacng: this key was already given on line 2.",
    ]


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (b"", "scene.yaml:1: this file is empty."),
        (b"# only a comment\n", "scene.yaml:1: this file is empty."),
        (b"- 1\n- 2\n", "scene.yaml:1: expected keys with values, not a list."),
        (b"hello\n", "scene.yaml:1: expected keys with values, not 'hello'."),
        (b"a: \x00\n", "scene.yaml: this is a binary file, not YAML."),
        (b"\x7fELF\x01\x02", "scene.yaml:1: control character U+007F is not allowed in YAML."),
        (b"a: 1\nb: \xff\n", "scene.yaml:2: byte 0xff is not UTF-8 text."),
        ("a: 1".encode("utf-16"), "scene.yaml: this is UTF-16; save it as UTF-8."),
        (b"a: 1\nb: \x1b[31m\n", "scene.yaml:2: control character U+001B is not allowed in YAML."),
        (b"#" * 1_000_001, "scene.yaml: this file is larger than 1 MB; a config is a page of text."),
        (b"[" * 20_000, "scene.yaml:1: more than 30 levels deep."),
        (b'a: "\\ud800"\n', "scene.yaml:1: a: half of a surrogate pair is not text."),
    ],
)
def test_what_is_no_config_at_all(data, line, folder):
    assert line in errors(data)


def test_byte_order_mark_and_windows_lines_are_read(folder):
    assert load_config(write(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())).config.dimension == 2


def test_alias_bomb(folder):
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
    for n in range(1, 30):
        bomb += f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n"
    assert errors(bomb) == ["scene.yaml:6: a5: more than 200,000 values once aliases are expanded."]


def test_anchors_are_read(folder):
    text = GOOD.replace("length: 1 mm, ", "length: &long 1 mm, ").replace(
        "    length: 1 mm", "    length: *long"
    )
    assert load_config(write(text)).config.bodies[1].length == 1e-3


def test_files_that_cannot_be_read(folder):
    for name, line in [
        ("none.yaml", "none.yaml: there is no such file."),
        (".", ".: this is a folder."),
        ("/dev/null", "/dev/null: this is not a file."),
    ]:
        with pytest.raises(ConfigError) as caught:
            load_config(name)
        assert str(caught.value) == line


# --------------------------------------------------------------------------- extends, --set


def test_extends_merges_mappings_and_replaces_lists(folder):
    Path("sub").mkdir()
    write(GOOD + "numerics: {delta: 0.2, courant: 0.3}\n", "sub/base.yaml")
    write("extends: base.yaml\nlaser: {power: 200}\n", "sub/middle.yaml")
    plate = "bodies:\n  - {shape: plate, length: 1 mm, depth: 50 um}\n"
    top = f"extends: sub/middle.yaml\nnumerics: {{delta: 0.3}}\n{plate}"
    loaded = load_config(write(top), ["numerics.courant=0.2"])
    config = loaded.config
    assert loaded.text == top
    assert (config.laser.power, config.laser.beam_radius) == (200.0, 54e-6)
    assert (config.numerics.delta, config.numerics.courant) == (0.3, 0.2)
    assert len(config.bodies) == 1


def test_an_error_names_the_file_that_its_value_came_from(folder):
    write(GOOD.replace("150", "-1"), "base.yaml")
    assert errors("extends: base.yaml\nlaser:\n  passes: 0\n") == [
        "base.yaml:9: laser.power: must be at least 0; '-1' is given.",
        "scene.yaml:3: laser.passes: must be at least 1; '0' is given.",
    ]


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("none.yaml", "scene.yaml:1: extends: there is no file 'none.yaml'."),
        ("scene.yaml",
         "scene.yaml:1: extends: files extend each other in a circle: scene.yaml -> scene.yaml."),
        ("/etc/x.yaml", "scene.yaml:1: extends: '/etc/x.yaml' must lie in the folder of the config or below: "
         "no absolute path, no '..'."),
        ("../x.yaml", "scene.yaml:1: extends: '../x.yaml' must lie in the folder of the config or below: "
         "no absolute path, no '..'."),
        ("link.yaml", "scene.yaml:1: extends: 'link.yaml' leads out of the folder of the config."),
        ("http://a.b/x.yaml",
         "scene.yaml:1: extends: 'http://a.b/x.yaml' is not the plain name of a .yaml file."),
        ("passwd", "scene.yaml:1: extends: 'passwd' is not the plain name of a .yaml file."),
        ("[a.yaml]", "scene.yaml:1: extends: expected the name of a YAML file."),
        ("", "scene.yaml:1: extends: expected the name of a YAML file."),
    ],
)  # fmt: skip
def test_extends_refuses(name, line, folder, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside") / "x.yaml"
    outside.write_text(GOOD)
    Path("link.yaml").symlink_to(outside)
    assert errors(f"extends: {name}\n") == [line]


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("laser.powr=3", "--set laser.powr=3: laser.powr: unknown key. Did you mean 'power'?"),
        ("laser.power=[1", "--set laser.power=[1: laser.power: "
         "'[' is not closed, or a ',' is missing."),
        ("laser.power", "--set laser.power: expected key.path=value, as in laser.power=200."),
        ("laser..power=3", "--set laser..power=3: expected key.path=value, as in laser.power=200."),
        ("bodies.x=3",
         "--set bodies.x=3: bodies: 'x' is not the number of an entry: this list has entries 0 to 1."),
        ("spacing.x=3", "--set spacing.x=3: spacing: '4 um' has no keys below it."),
        ("title=!!str x", "--set title=!!str x: title: tags are not read: remove '!!str'."),
        ("spacing=nan", "--set spacing=nan: spacing: nan is not a finite number."),
    ],
)  # fmt: skip
def test_set_refuses(override, line, folder):
    assert errors(GOOD, override) == [line]


# --------------------------------------------------------------------------- warnings


@pytest.mark.parametrize(
    ("override", "warning"),
    [
        ("time.end=1e-5",
         "--set time.end=1e-5: time.end: the run ends at 1e-05 s, before the beam does (0.001 s)."),
        ("laser.beam_radius=5 um",
         "--set laser.beam_radius=5 um: laser.beam_radius: the beam is only 1.3 particles "
         "in radius; 2 is the least."),
        ("bodies.1.radius=5 um",
         "--set bodies.1.radius=5 um: bodies.1.radius: a grain of radius 5e-06 m is only "
         "2.5 particles across."),
        ("materials={a: {extends: 316L}}", "--set materials={a: {extends: 316L}}: materials.a: "
         "no body is made of this material."),
    ],
)  # fmt: skip
def test_warnings(override, warning, folder):
    assert load_config(write(GOOD), [override]).warnings == (warning,)


# --------------------------------------------------------------------------- a scene made in Python


def scene_of(text):
    return YAML(typ="safe", pure=True).load(text)


def test_a_mapping_is_the_same_scene_as_its_file(folder):
    loaded = load_config(scene_of(GOOD), ["laser.power=222", "seed=4"])
    assert loaded.config == load_config(write(GOOD), ["laser.power=222", "seed=4"]).config
    assert load_config(write(loaded.text)).config == load_config(write(GOOD)).config  # what a run would keep


def test_a_mapping_may_hold_numpy_and_tuples(folder):
    scene = scene_of(GOOD)
    scene["spacing"] = np.float64(5e-6)
    scene["laser"]["path"][0]["start"] = np.array([1e-4])
    scene["bodies"] = tuple(scene["bodies"])
    config = load_config(scene).config
    assert config.spacing == 5e-6
    assert list(config.laser.path[0].start) == [1e-4]


def test_a_mapping_is_checked_as_a_file_is(folder):
    scene = scene_of(GOOD)
    scene["laser"]["powr"] = scene["laser"].pop("power")
    scene["spacing"] = float("nan")
    scene[3] = object()
    with pytest.raises(ConfigError) as refused:
        load_config(scene)
    lines = str(refused.value).splitlines()
    assert "scene: laser.powr: unknown key. Did you mean 'power'?" in lines
    assert any(line.startswith("scene: spacing: nan is not a finite number") for line in lines)
    assert any(line.startswith("scene: 3: unknown key") for line in lines)
    scene = scene_of(GOOD) | {"time": {"end": 1e-5}}
    assert load_config(scene).warnings == (
        "scene: time.end: the run ends at 1e-05 s, before the beam does (0.001 s).",
    )
