"""The scenes that ship, by their names: the folder configs/ of a checkout, or its copy in an installed package."""

import difflib
import os
from pathlib import Path

from taichi_slm.config.document import Problem
from taichi_slm.errors import ConfigError, StorageError
from taichi_slm.output.atomic import refuse_existing, write_bytes

BASES = ("paper",)  # for `extends` only: no scene of its own
SCHEMA = "schema.json"  # named in the first line of every scene, for editors
_PACKAGE = Path(__file__).parents[1]


def folder() -> Path:
    """Where the scenes are: setup.py puts configs/ inside the package; in a checkout it lies beside it."""
    inside = _PACKAGE / "configs"
    return inside if inside.is_dir() else _PACKAGE.parent / "configs"


def scene_names() -> list[str]:
    """Names of the scenes that ship, sorted."""
    return sorted(path.stem for path in folder().glob("*.yaml") if path.stem not in BASES)


def scene_path(name: str) -> Path:
    """The file of the scene ``name``. Raises ConfigError, with a guess, for one that does not ship."""
    if name in scene_names():
        return folder() / f"{name}.yaml"
    close = difflib.get_close_matches(name, scene_names(), n=1)
    raise ConfigError(str(Problem(name, (), "no scene of this name ships", close[0] if close else None)))


def located(path: Path) -> Path:
    """``path``, or where there is no such file but a scene of that name ships, the scene's file.

    Raises ConfigError, with a guess, where a scene that ships has nearly that name.
    """
    if os.path.isfile(path):
        return path
    names = scene_names()
    if str(path) in names:
        return scene_path(str(path))
    close = difflib.get_close_matches(path.stem, names, n=1, cutoff=0.75)
    if close and not os.path.lexists(path):
        raise ConfigError(str(Problem(str(path), (), "there is no such file", close[0])))
    return path


def list_scenes() -> list[str]:
    """A line for every scene: name, dimension, title."""
    from taichi_slm.config.load import load_config

    configs = {name: load_config(scene_path(name)).config for name in scene_names()}
    return [f"{name:<24}{config.dimension}-D  {config.title}" for name, config in configs.items()]


def copy_scene(name: str, file: Path) -> list[Path]:
    """Copy the scene ``name`` to ``file``, and beside it what it names: the files it extends, and the schema.

    Returns what was written; what is there with the same content stays. Raises StorageError for anything else that
    is in the way.
    """
    from taichi_slm.config.load import load_config

    source = scene_path(name)
    beside = [*load_config(source).bases, folder() / SCHEMA]
    wanted = {file.parent / each.name: each for each in beside}
    if file in wanted:
        raise StorageError(f"{file}: '{name}' needs another file of this name beside it: choose another one")
    refuse_existing([file, *(target for target, each in wanted.items() if not _same(target, each))])
    wanted[file] = source
    missing = [target for target in wanted if not target.exists()]
    for target in missing:
        write_bytes(target, wanted[target].read_bytes())
    return missing


def _same(target: Path, source: Path) -> bool:
    return target.is_file() and target.read_bytes() == source.read_bytes()
