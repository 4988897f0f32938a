"""How far the bodies of a config reach, and about how many particles they take: by their keys alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import gamma, inf, pi, prod

from taichi_slm.config.schema import AnyBody, Box, Config, Container, Droplet, Plate, PowderBed, PowderRow

BED_PACKING = 0.65  # share of a levelled bed that is metal, upper end of random packings of discs and balls


@dataclass(frozen=True)
class Extent:
    """A box: its lowest and highest corner [m]."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def contains(self, other: "Extent", slack: float) -> bool:
        """Whether ``other`` lies inside, give or take ``slack`` [m]."""
        return all(
            a <= c + slack and d <= b + slack
            for a, b, c, d in zip(self.lower, self.upper, other.lower, other.upper, strict=True)
        )

    def holds(self, point: Sequence[float]) -> bool:
        """Whether ``point`` lies inside or on the edge."""
        return all(a <= x <= b for a, x, b in zip(self.lower, point, self.upper, strict=True))

    def touches(self, other: "Extent") -> bool:
        """Whether the two have a point in common."""
        return all(
            a <= d and c <= b
            for a, b, c, d in zip(self.lower, self.upper, other.lower, other.upper, strict=True)
        )

    def grown(self, by: float) -> "Extent":
        """The box with ``by`` [m] added on every side."""
        return Extent(tuple(a - by for a in self.lower), tuple(b + by for b in self.upper))

    def horizontal(self) -> "Extent":
        """The box without the vertical, which is the last coordinate."""
        return Extent(self.lower[:-1], self.upper[:-1])


def bodies_extent(config: Config, bodies: Sequence[AnyBody]) -> Extent:
    """The smallest box around ``bodies``; their coordinates must fit the dimension."""
    boxes = [_extent(config, body) for body in bodies]
    return Extent(
        tuple(min(column) for column in zip(*(box.lower for box in boxes), strict=True)),
        tuple(max(column) for column in zip(*(box.upper for box in boxes), strict=True)),
    )


def _extent(config: Config, body: AnyBody) -> Extent:
    if isinstance(body, Droplet):
        reach = body.radius * (1 + abs(body.stretch)) / (1 - min(abs(body.stretch), 0.9)) ** 0.5
        return Extent(tuple(x - reach for x in body.centre), tuple(x + reach for x in body.centre))
    if isinstance(body, Container):
        thick = body.layers * config.spacing
        upper = [x + length + thick for x, length in zip(body.corner, body.size, strict=True)]
        upper[-1] -= thick  # open at the top
        return Extent(tuple(x - thick for x in body.corner), tuple(upper))
    if isinstance(body, Box):
        return Extent(tuple(body.corner), tuple(x + s for x, s in zip(body.corner, body.size, strict=True)))
    if isinstance(body, Plate):
        bottom, top, half = -body.depth, 0.0, (body.width or 0.0) / 2
    elif isinstance(body, PowderRow):
        bottom, top, half = 0.0, 2 * body.radius, body.rows * body.radius
    else:
        bottom, top, half = 0.0, body.height, (body.width or 0.0) / 2
    across = ((-half, half),) if config.dimension == 3 else ()
    sides = ((body.start, body.start + body.length), *across, (bottom, top))
    return Extent(tuple(low for low, _ in sides), tuple(high for _, high in sides))


def particles_about(config: Config) -> float:
    """Number of particles by volume: exact to a few per cent, for a scene of any size."""
    try:
        return sum(_volume(config, body) for body in config.bodies) / config.spacing**config.dimension
    except (OverflowError, ZeroDivisionError):  # a spacing of 1e-200 m
        return inf


def _volume(config: Config, body: AnyBody) -> float:
    """Volume of the metal [m^dimension]."""
    d = config.dimension
    ball = pi ** (d / 2) / gamma(d / 2 + 1)
    if isinstance(body, Droplet):
        return ball * body.radius**d
    if isinstance(body, Box):
        return prod(body.size)
    if isinstance(body, Container):
        thick = body.layers * config.spacing
        return prod(s + 2 * thick for s in body.size[:-1]) * (body.size[-1] + thick) - prod(body.size)
    if isinstance(body, PowderRow):
        return max(body.length // (2 * body.radius), 1) * body.rows * ball * body.radius**d
    width = (body.width or 0.0) if d == 3 else 1.0
    if isinstance(body, PowderBed):
        return BED_PACKING * body.length * width * body.height
    return body.length * width * body.depth


__all__ = ["Extent", "bodies_extent", "particles_about"]
