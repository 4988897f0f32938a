"""The alloys that ship, and the materials of a config made from them.

A material is found by name: first among the config's own ``materials``, then among ``alloys/*.yaml``. Both
may say ``extends``. Merging is per top-level field (a whole law replaces a whole law); ``scale`` factors
multiply, ``sources`` join. An entry may carry the name of the alloy it extends: it then takes its place.
"""

import difflib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_slm.config.material import Material, MaterialOverride
from taichi_slm.errors import ConfigError

ALLOY_FOLDER = Path(__file__).parent / "alloys"
REQUIRED = ("density", "heat_capacity", "conductivity", "viscosity")


@cache
def alloy_names() -> tuple[str, ...]:
    """Names of the alloys that ship, sorted."""
    return tuple(sorted(path.stem for path in ALLOY_FOLDER.glob("*.yaml")))


@cache
def _alloy_file(name: str) -> MaterialOverride:
    from ruamel.yaml import YAML

    data = YAML(typ="safe").load((ALLOY_FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))
    try:
        return MaterialOverride.model_validate(data)
    except ValidationError as error:
        raise ConfigError(f"alloy file {name}.yaml: {_sentence(error)}") from None


def load_alloy(name: str) -> Material:
    """A material that ships, by its name."""
    return resolve(name, {})


def resolve(name: str, overrides: Mapping[str, MaterialOverride]) -> Material:
    """The complete material ``name``: an entry of ``overrides`` (the config's ``materials``) or an alloy.

    Raises ConfigError for an unknown name, a circle of ``extends``, and a material that lacks a law.
    """
    merged: dict[str, Any] = {}
    for _, part in reversed(_chain(name, overrides)):
        _merge(merged, part)
    missing = [field for field in REQUIRED if field not in merged]
    if missing:
        raise ConfigError(
            f"material '{name}' has no {' and no '.join(missing)}: "
            f"give it, or let it extend one of {', '.join(alloy_names())}"
        )
    try:
        return Material(name=name, **merged)
    except ValidationError as error:
        raise ConfigError(f"material '{name}': {_sentence(error)}") from None


def _chain(name: str, overrides: Mapping[str, MaterialOverride]) -> list[tuple[str, MaterialOverride]]:
    """The entry ``name`` and all it extends, the most special first."""
    chain: list[tuple[str, MaterialOverride]] = []
    wanted: str | None = name
    own = True  # still among the entries of the config; from an alloy file on, only alloy files
    while wanted is not None:
        seen = [entry for entry, _ in chain]
        # An entry may extend the alloy whose name it bears.
        own = own and wanted in overrides and not (seen[-1:] == [wanted] and wanted in alloy_names())
        if (own and wanted in seen) or (not own and seen.count(wanted) > 1):
            raise ConfigError(f"materials extend each other in a circle: {' -> '.join([*seen, wanted])}")
        if not own and wanted not in alloy_names():
            raise ConfigError(_unknown(wanted, name, overrides))
        part = overrides[wanted] if own else _alloy_file(wanted)
        chain.append((wanted, part))
        wanted = part.extends
    return chain


def _merge(merged: dict[str, Any], part: MaterialOverride) -> None:
    """Lay the fields that ``part`` gives over those in ``merged``."""
    fields = {field: getattr(part, field) for field in type(part).model_fields}
    given = {field: value for field, value in fields.items() if value is not None}
    given.pop("extends", None)
    scale = dict(merged.get("scale", {}))
    for quantity, factor in given.pop("scale").items():
        scale[quantity] = scale.get(quantity, 1.0) * factor
    sources = {**merged.get("sources", {}), **given.pop("sources", {})}
    # The two ways to say how stiff the mushy zone is exclude each other: the later one counts.
    if "viscosity" in given and given["viscosity"].solid is not None:
        merged.pop("mushy_viscosity_factor", None)
    merged.update(given, scale=scale, sources=sources)


def _unknown(wanted: str, asked: str, overrides: Mapping[str, MaterialOverride]) -> str:
    known = sorted({*alloy_names(), *overrides})
    close = difflib.get_close_matches(wanted, known, n=3, cutoff=0.5)
    where = "" if wanted == asked else f" (which '{asked}' extends)"
    hint = f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(known)}"
    return f"there is no material '{wanted}'{where}: {hint}"


def _sentence(error: ValidationError) -> str:
    parts = []
    for item in error.errors(include_url=False):
        where = ".".join(str(key) for key in item["loc"])
        text = item["msg"].removeprefix("Value error, ")
        parts.append(f"{where}: {text}" if where else text)
    return "; ".join(parts)
