"""A study file: one validated model. Every key, its meaning and its default stand here, nowhere else."""

import math
import re
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from taichi_slm.config.material import Frozen

Values = Annotated[list[Any], Field(min_length=1)]
QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s].*?)?\s*")


def split_quantity(value: Any) -> tuple[float, str]:
    """Number and unit of ``value`` as given: (54.0, "um") for "54 um", (5e-5, "") for 5e-5."""
    found = None if isinstance(value, bool | None) else QUANTITY.fullmatch(str(value))
    if found is None or not math.isfinite(float(found[1])):
        raise ValueError("expected two numbers, with the same unit or with none")
    return float(found[1]), found[2] or ""


class Grid(Frozen):
    """Every value of each key with every value of the others."""

    kind: Literal["grid"]
    values: Annotated[dict[str, Values], Field(min_length=1)]


class Zip(Frozen):
    """The first values of all keys together, then the second ones, and so on."""

    kind: Literal["zip"]
    values: Annotated[dict[str, Values], Field(min_length=1)]

    @field_validator("values")
    @classmethod
    def _equally_long(cls, values: dict[str, list[Any]]) -> dict[str, list[Any]]:
        if len({len(each) for each in values.values()}) > 1:
            counts = ", ".join(f"{key} has {len(each)}" for key, each in values.items())
            raise ValueError(f"the lists of a zip must be equally long: {counts}")
        return values


class Points(Frozen):
    """Points written out one by one."""

    kind: Literal["list"]
    points: Annotated[list[Annotated[dict[str, Any], Field(min_length=1)]], Field(min_length=1)]


class LatinHypercube(Frozen):
    """``count`` points spread over a box so that each key's range is covered evenly."""

    kind: Literal["latin_hypercube"]
    ranges: Annotated[dict[str, tuple[Any, Any]], Field(min_length=1)]
    count: Annotated[int, Field(ge=1)]
    seed: Annotated[int, Field(ge=0)] = Field(0, description="of the points, not of the runs")

    @field_validator("ranges")
    @classmethod
    def _rising(cls, ranges: dict[str, tuple[Any, Any]]) -> dict[str, tuple[Any, Any]]:
        for key, ends in ranges.items():
            (low, unit), (high, other) = map(split_quantity, ends)
            if unit != other:
                raise ValueError(f"both ends of {key} need the same unit; '{unit}' and '{other}' are given")
            if low >= high:
                raise ValueError(f"the range of {key} must rise: {ends[0]} is not below {ends[1]}")
        return ranges


class Csv(Frozen):
    """Points from a table whose first line names the keys."""

    kind: Literal["csv"]
    file: str = Field(description="beside the study file or below")


Axis = Annotated[Grid | Zip | Points | LatinHypercube | Csv, Field(discriminator="kind")]


class Overview(Frozen):
    """What overview.png shows."""

    x: str | None = Field(None, description="key along x; by default the first that varies")
    by: str | None = Field(None, description="key of the colours; by default the second that varies")
    kind: Literal["lines", "map"] = Field("lines", description="map: `by` along y, the result as colour")
    show: Annotated[list[str], Field(min_length=1, max_length=12)] = Field(
        default=[
            "max_temperature_K", "melt_pool.length_m", "melt_pool.depth_m", "melt_pool.track.depth_m",
            "melt_pool.track.roughness_m", "melt_pool.track.unmelted_powder",
        ],
        description="columns of the table",
    )  # fmt: skip


class Study(Frozen):
    """One study, complete."""

    title: str = ""
    scene: str = Field(description="the scene that all runs start from; a path from this file")
    set: dict[str, Any] = Field(default_factory=dict, description="keys that all runs change, as with --set")
    axes: Annotated[list[Axis], Field(min_length=1)] = Field(
        description="each point of one with each of the next"
    )
    repeats: Annotated[int, Field(ge=1, le=10_000)] = Field(
        1, description="runs of each point, with the scene's seed, the next one, and so on"
    )
    seeds: Annotated[list[Annotated[int, Field(ge=0, lt=2**31)]], Field(min_length=1)] | None = Field(
        None, description="these seeds instead of `repeats`"
    )
    analyse: bool = Field(True, description="take the chief numbers of `taichi-slm analyse` into the table")
    overview: Overview = Overview()
