"""The config: one frozen, validated model. Every key, its unit and its default stand here and in numerics.py alone."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from taichi_slm.config.material import Frozen, MaterialOverride
from taichi_slm.config.numerics import Numerics, Performance, Physics
from taichi_slm.config.units import (
    NO_SWITCH,
    Acceleration,
    Fraction,
    Frequency,
    Length,
    NonNegativeLength,
    NonNegativeNumber,
    Number,
    PositiveLength,
    PositiveNumber,
    PositiveSpeed,
    PositiveTime,
    Power,
    Speed,
    Temperature,
    Time,
)

# --------------------------------------------------------------------------- scene

Vector = Annotated[list[Length], Field(min_length=1, max_length=3)]


class SineProgram(Frozen):
    """T(t) = mean (1 + amplitude sin(2 pi frequency t)), imposed on the whole body (paper eq. 46)."""

    kind: Literal["sine"]
    mean: Temperature
    amplitude: Number
    frequency: Frequency


class RampProgram(Frozen):
    """T(t) linear between [time, temperature] points, constant outside them (paper eq. 48)."""

    kind: Literal["ramp"]
    points: Annotated[list[tuple[Time, Temperature]], Field(min_length=1)]

    @field_validator("points")
    @classmethod
    def _increasing(cls, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        if any(b[0] <= a[0] for a, b in pairwise(points)):
            raise ValueError("the times of a ramp must increase")
        return points


Program = Annotated[SineProgram | RampProgram, Field(discriminator="kind")]


class Body(Frozen):
    """What all bodies share."""

    material: str = "steel_304"
    temperature: Temperature | None = Field(
        None, description="initial temperature [K]; the ambient one by default"
    )
    velocity: Annotated[list[Speed], Field(min_length=2, max_length=3)] | None = Field(
        None, description="initial velocity [m/s]"
    )
    program: Program | None = Field(None, description="imposed temperature history")
    tracer: Annotated[int, Field(ge=0), NO_SWITCH] = Field(0, description="tracer group")


class Plate(Body):
    """A rectangular substrate; its top is at height 0."""

    shape: Literal["plate"]
    start: Length = Field(0.0, description="x of its left end [m]")
    length: PositiveLength
    width: PositiveLength | None = Field(None, description="extent in y, centred on y = 0 (3-D) [m]")
    depth: PositiveLength
    cold_layers: Annotated[int, Field(ge=0), NO_SWITCH] = Field(
        3, description="layers of held temperature at the bottom"
    )


class PowderRow(Body):
    """A row of equal powder grains that touch each other and the plate, along x at y = 0."""

    shape: Literal["powder_row"]
    start: Length = Field(0.0, description="x of the left edge of the first grain [m]")
    length: PositiveLength
    radius: PositiveLength
    rows: Annotated[int, Field(ge=1), NO_SWITCH] = Field(
        1, description="parallel rows in y, centred on y = 0 (3-D)"
    )
    materials: list[str] | None = Field(
        None, description="grain materials, cycled along the row; replaces `material`"
    )
    tracers: list[Annotated[int, Field(ge=0), NO_SWITCH]] | None = Field(
        None, description="tracer groups, cycled along the row"
    )


class PowderBed(Body):
    """A packed bed of grains with a normal size distribution cut at both ends, dropped and rolled at random."""

    shape: Literal["powder_bed"]
    start: Length = 0.0
    length: PositiveLength
    width: PositiveLength | None = Field(None, description="extent in y, centred on y = 0 (3-D) [m]")
    height: PositiveLength = Field(
        description="levelled height of the layer [m]; grains that reach above it are not laid"
    )
    mean_radius: PositiveLength
    std_radius: NonNegativeLength = 0.0
    min_radius: PositiveLength | None = Field(None, description="default: mean - 2 std")
    max_radius: PositiveLength | None = Field(None, description="default: mean + 2 std")
    materials: list[str] | None = Field(None, description="grain materials, drawn with `fractions`")
    fractions: list[Fraction] | None = None


class Droplet(Body):
    """A disc (2-D) or ball (3-D) of liquid."""

    shape: Literal["droplet"]
    centre: Vector
    radius: PositiveLength
    arrangement: Literal["lattice", "rings"] = Field("lattice", description="rings: 2-D, concentric circles")
    stretch: Number = Field(
        0.0, description="amplitude of an n = 2 deformation at constant volume, relative to the radius"
    )
    follow_density: bool = Field(
        False,
        description="start with the radial velocity that the first rate of the reference density asks for",
    )


class Box(Body):
    """A rectangle or cuboid of material."""

    shape: Literal["box"]
    corner: Vector = Field(description="lowest corner [m]")
    size: Annotated[list[PositiveLength], Field(min_length=2, max_length=3)]
    wall: bool = Field(False, description="never moves and never melts, whatever its temperature")


class Container(Body):
    """Floor and side walls, `layers` particles thick, open at the top; they never move and never melt."""

    shape: Literal["container"]
    corner: Vector = Field(description="lowest inner corner [m]")
    size: Annotated[list[PositiveLength], Field(min_length=2, max_length=3)]
    layers: Annotated[int, Field(ge=1), NO_SWITCH] = 3


AnyBody = Annotated[Plate | PowderRow | PowderBed | Droplet | Box | Container, Field(discriminator="shape")]


class Domain(Frozen):
    """The box that particles may not leave (one that does is removed and counted)."""

    lower: Annotated[list[Length], Field(min_length=2, max_length=3)]
    upper: Annotated[list[Length], Field(min_length=2, max_length=3)]

    @model_validator(mode="after")
    def _ordered(self) -> "Domain":
        if len(self.lower) != len(self.upper) or any(
            b <= a for a, b in zip(self.lower, self.upper, strict=False)
        ):
            raise ValueError("every coordinate of domain.upper must exceed that of domain.lower")
        return self


# --------------------------------------------------------------------------- laser

Point = Annotated[list[Length], Field(min_length=1, max_length=2)]


class Move(Frozen):
    """The beam runs straight from `start` to `end`."""

    kind: Literal["line"]
    start: Point
    end: Point
    speed: PositiveSpeed
    power_fraction: NonNegativeNumber = 1.0


class Dwell(Frozen):
    """The beam stands still."""

    kind: Literal["dwell"]
    at: Point
    duration: PositiveTime
    power_fraction: NonNegativeNumber = 1.0


class Pulse(Frozen):
    """The beam is on for `on`, off for `off`, and so forth, from its start."""

    on: PositiveTime
    off: Time


class Laser(Frozen):
    """The beam: I(r) = f A P/(pi w^2) exp(-f r^2/w^2) (eq. 33), absorbed along the vertical (eq. 31, App. A).

    In 2-D the line source I(x, 0) acts per unit depth.
    """

    power: Power
    beam_radius: PositiveLength = Field(
        description="w: 1/e^2 radius of a Gaussian with exponent 2; radius of a top hat [m]"
    )
    profile: Literal["gaussian", "top_hat"] = "gaussian"
    exponent: PositiveNumber = Field(
        2.0, description="f of the Gaussian: 2 is the 1/e^2 definition; welding papers use 2 to 3"
    )
    absorptivity: Fraction | None = Field(None, description="A; the first body's material's by default")
    absorption_depth: PositiveLength | None = Field(
        None,
        description="1/alpha of Beer-Lambert [m], numerical: metals absorb in 1e-8 m; default bin_size / 3",
    )
    bin_size: PositiveLength | None = Field(
        None, description="spacing of the binning grid [m]; the particle spacing by default"
    )
    start: Time = 0.0
    path: Annotated[
        list[Annotated[Move | Dwell, Field(discriminator="kind")]], Field(min_length=1, max_length=10000)
    ]
    passes: Annotated[int, Field(ge=1, le=10000), NO_SWITCH] = Field(
        1, description="times the whole path is run"
    )
    pulse: Pulse | None = None


# --------------------------------------------------------------------------- the whole


class RunTime(Frozen):
    """When the run ends."""

    end: PositiveTime
    wall_limit: PositiveTime | None = Field(
        None, description="checkpoint and leave (exit 75) after this much wall time [s]"
    )


Picture = Literal[
    "temperature",
    "state",
    "velocity",
    "surface_force",
    "tracer",
    "material",
    "cut",
    "isosurface",
    "streamlines",
]
ONLY_3D: tuple[Picture, ...] = ("cut", "isosurface", "streamlines")


class Output(Frozen):
    """What is written, and how often in simulated time."""

    history_interval: PositiveTime | None = Field(None, description="default: end / 400")
    snapshot_interval: PositiveTime | None = Field(None, description="default: end / 40")
    checkpoint_interval: PositiveTime | None = Field(None, description="default: end / 10")
    checkpoint_steps: Annotated[int, Field(ge=1), NO_SWITCH] | None = Field(
        None, description="a checkpoint after this many flow steps, too"
    )
    checkpoint_wall: PositiveTime = Field(
        600.0, description="a checkpoint after this much wall time, too [s]"
    )
    images: list[Picture] = Field(
        default_factory=lambda: ["temperature", "state"],  # type: ignore[arg-type]
        description="kinds of pictures; in 3-D only: cut (the section y = 0), isosurface (of the melting "
        "temperature) and streamlines (of the melt)",
    )
    images_at_most: Annotated[int, Field(ge=0), NO_SWITCH] = Field(
        12, description="snapshots that become pictures at the end of a run"
    )
    temperature_range: tuple[Temperature, Temperature] | None = Field(
        None, description="of the colour bar [K]"
    )


class Config(Frozen):
    """One scene, complete."""

    title: str = ""
    dimension: Literal[2, 3]
    spacing: PositiveLength = Field(description="dx: initial particle spacing [m]")
    seed: Annotated[int, Field(ge=0, lt=2**31), NO_SWITCH] = 0
    ambient_temperature: Temperature = 293.0
    gravity: Acceleration = Field(0.0, description="downwards [m/s^2]")
    materials: dict[str, MaterialOverride] = Field(default_factory=dict)
    bodies: Annotated[list[AnyBody], Field(min_length=1)]
    domain: Domain | None = Field(None, description="default: the bodies and a margin above them")
    laser: Laser | None = None
    physics: Physics = Physics()
    numerics: Numerics = Numerics()
    performance: Performance = Performance()
    time: RunTime
    output: Output = Output()
