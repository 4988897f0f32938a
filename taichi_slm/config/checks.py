"""Checks that need several keys at once.

What contradicts itself is an error; what is allowed and probably not meant is a warning.
"""

from collections.abc import Iterator
from math import dist
from typing import Any

from taichi_slm.config.document import Node, Problem
from taichi_slm.config.explain import closest
from taichi_slm.config.extent import Extent, bodies_extent, particles_about
from taichi_slm.config.schema import (
    ONLY_3D,
    AnyBody,
    Box,
    Config,
    Container,
    Droplet,
    Laser,
    Move,
    Plate,
    PowderBed,
    PowderRow,
    RampProgram,
)
from taichi_slm.errors import ConfigError

PARTICLES_AT_MOST = 50_000_000
SMALLEST, LARGEST = 1e-30, 1e30  # of any number in a config, SI

# term: what it cannot do without
NEEDS = {
    "surface_tension": ("flow",),
    "marangoni": ("flow", "surface_tension"),
    "viscous_heating": ("flow", "heat"),
    "radiation": ("heat",),
    "evaporation": ("heat",),
    "recoil": ("flow", "evaporation"),
}

Path = tuple[str | int, ...]


def check(config: Config, tree: Node) -> tuple[list[Problem], list[Problem]]:
    """Errors and warnings of ``config``, which was read from ``tree``."""
    findings = _Findings(tree)
    _magnitudes(config.model_dump(), (), findings)
    if findings.errors:
        return findings.errors, []
    _physics(config, findings)
    for number, body in enumerate(config.bodies):
        _coordinates(config.dimension, body, ("bodies", number), findings)
        _body(config, body, ("bodies", number), findings)
    _size(config, findings)
    _times(config, findings)
    _pictures(config, findings)
    if not findings.errors:  # what follows measures the scene
        _domain(config, findings)
    if config.laser is not None:
        _laser(config, config.laser, findings)
    _materials(config, findings)
    return findings.errors, findings.warnings


class _Findings:
    """Errors and warnings, each at the line of its key."""

    def __init__(self, tree: Node) -> None:
        self.tree = tree
        self.errors: list[Problem] = []
        self.warnings: list[Problem] = []

    def error(self, path: Path, sentence: str, meant: str | None = None) -> None:
        self.errors.append(Problem(self.where(path), path, sentence, meant))

    def warn(self, path: Path, sentence: str) -> None:
        self.warnings.append(Problem(self.where(path), path, sentence))

    def where(self, path: Path) -> str:
        """The line of the key, or of the nearest mapping around one that is not given."""
        node = self.tree
        for key in path:
            below = node.child(key)
            if below is None:
                break
            node = below
        return node.where


def _magnitudes(value: Any, at: Path, findings: _Findings) -> None:
    """Squares and cubes of every number must stay numbers."""
    if isinstance(value, float) and value != 0 and not SMALLEST < abs(value) < LARGEST:
        findings.error(at, f"{value:g} is beyond all measure: a unit may be missing")
    for key, child in value.items() if isinstance(value, dict) else ():
        _magnitudes(child, (*at, key), findings)
    for index, child in enumerate(value) if isinstance(value, list | tuple) else ():
        _magnitudes(child, (*at, index), findings)


def _physics(config: Config, findings: _Findings) -> None:
    physics = config.physics
    for term, needed in NEEDS.items():
        off = [need for need in needed if not getattr(physics, need)]
        if getattr(physics, term) and off:
            findings.error(("physics", term), f"this needs physics.{off[0]}, which is off")
    if not physics.flow and not physics.heat:
        findings.error(("physics",), "both flow and heat are off: nothing is left to compute")
    if config.laser is not None and not physics.heat:
        findings.error(
            ("laser",), "a laser heats nothing while physics.heat is off; leave one of the two out"
        )
    numerics = config.numerics
    if physics.flow and numerics.surface_smoothing < numerics.smoothing:
        findings.error(
            ("numerics", "surface_smoothing"),
            f"the kernel of the surface must be at least as wide as that of the flow; "
            f"{numerics.surface_smoothing:g} is less than a smoothing of {numerics.smoothing:g}",
        )


def _coordinates(dimension: int, body: AnyBody, at: Path, findings: _Findings) -> None:
    """Every list of coordinates has one per axis."""
    for key in ("velocity", "centre", "corner", "size"):
        values = getattr(body, key, None)
        if values is not None and len(values) != dimension:
            findings.error(
                (*at, key), f"a {dimension}-D scene has {dimension} coordinates, not {len(values)}"
            )
    if isinstance(body, Plate | PowderBed):
        if dimension == 3 and body.width is None:
            findings.error((*at, "width"), "this key is required in 3-D")
        if dimension == 2 and body.width is not None:
            findings.error((*at, "width"), "a width means nothing in 2-D")
    if isinstance(body, PowderRow) and dimension == 2 and body.rows > 1:
        findings.error((*at, "rows"), "parallel rows exist in 3-D only")
    if isinstance(body, Droplet) and dimension == 3 and body.arrangement == "rings":
        findings.error((*at, "arrangement"), "'rings' exists in 2-D only; use 'lattice'")


def _body(config: Config, body: AnyBody, at: Path, findings: _Findings) -> None:
    dx = config.spacing
    if isinstance(body, Plate | PowderRow | PowderBed):
        thin = [
            key for key in ("length", "depth", "width", "height") if (getattr(body, key, None) or dx) < dx
        ]
        for key in thin:
            findings.error(
                (*at, key), f"{getattr(body, key):g} m is less than one particle (spacing {dx:g} m)"
            )
        if isinstance(body, Plate) and not thin:
            _cold_layers(body, dx, (*at, "cold_layers"), findings)
    if isinstance(body, Box | Container):
        for axis, length in enumerate(body.size):
            if length < dx:
                findings.error(
                    (*at, "size", axis), f"{length:g} m is less than one particle (spacing {dx:g} m)"
                )
    if isinstance(body, PowderRow):
        _grain(body.radius, dx, (*at, "radius"), findings)
        if body.length < 2 * body.radius:
            findings.error(
                (*at, "length"), f"{body.length:g} m is shorter than one grain of radius {body.radius:g} m"
            )
    if isinstance(body, PowderBed):
        _bed(body, dx, at, findings)
    if isinstance(body, Droplet):
        _grain(body.radius, dx, (*at, "radius"), findings, "droplet")
        if abs(body.stretch) >= 0.9:
            findings.error((*at, "stretch"), "a stretch of 0.9 and more leaves no drop")
        if body.follow_density and body.program is None:
            findings.warn(
                (*at, "follow_density"), "without a program the density has no first rate to follow"
            )
    _program(config, body, at, findings)


def _cold_layers(plate: Plate, dx: float, at: Path, findings: _Findings) -> None:
    layers = round(plate.depth / dx)
    if plate.cold_layers > layers:
        findings.error(at, f"{plate.cold_layers} cold layers in a plate of {layers} layers of particles")
    elif plate.cold_layers == layers:
        findings.warn(at, "the whole plate is held at its initial temperature")


def _grain(radius: float, dx: float, at: Path, findings: _Findings, what: str = "grain") -> None:
    across = 2 * radius / dx
    if across < 1:
        findings.error(at, f"a {what} of radius {radius:g} m is smaller than one particle (spacing {dx:g} m)")
    elif across < 3:
        findings.warn(at, f"a {what} of radius {radius:g} m is only {across:.2g} particles across")


def _bed(bed: PowderBed, dx: float, at: Path, findings: _Findings) -> None:
    low = bed.min_radius if bed.min_radius is not None else bed.mean_radius - 2 * bed.std_radius
    high = bed.max_radius if bed.max_radius is not None else bed.mean_radius + 2 * bed.std_radius
    if low <= 0:
        findings.error((*at, "min_radius"), "mean_radius - 2 std_radius is not positive: give min_radius")
    elif not low <= bed.mean_radius <= high:
        findings.error(at, f"the mean radius {bed.mean_radius:g} m is not between {low:g} and {high:g} m")
    else:
        _grain(low, dx, (*at, "min_radius" if bed.min_radius else "mean_radius"), findings)
        if 2 * low > bed.height:
            findings.error((*at, "height"), f"no grain fits: the smallest is {2 * low:g} m across")
    if bed.fractions is not None:
        if len(bed.fractions) != len(bed.materials or ()):
            findings.error(
                (*at, "fractions"), f"{len(bed.fractions)} fractions for {len(bed.materials or ())} materials"
            )
        elif sum(bed.fractions) == 0:
            findings.error((*at, "fractions"), "all fractions are zero")
        elif abs(sum(bed.fractions) - 1) > 1e-6:
            findings.warn((*at, "fractions"), f"the fractions add up to {sum(bed.fractions):g}, not to 1")


def _program(config: Config, body: AnyBody, at: Path, findings: _Findings) -> None:
    program = body.program
    if program is None:
        return
    if config.physics.heat:
        findings.warn(
            (*at, "program"),
            "the program rules this body's temperature; physics.heat is on for the others only",
        )
    if not isinstance(program, RampProgram) and abs(program.amplitude) >= 1:
        findings.error((*at, "program", "amplitude"), "an amplitude of 1 and more cools below 0 K")


def _size(config: Config, findings: _Findings) -> None:
    about = particles_about(config)
    if about > PARTICLES_AT_MOST:
        sentence = f"about {about:.2g} particles, more than {PARTICLES_AT_MOST:,}: a unit may be missing"
        findings.error(("spacing",), sentence)


def _times(config: Config, findings: _Findings) -> None:
    end = config.time.end
    for key in ("history_interval", "snapshot_interval", "checkpoint_interval"):
        interval = getattr(config.output, key)
        if interval is not None and interval > end:
            findings.warn(("output", key), f"{interval:g} s is longer than the run ({end:g} s)")
    limits = config.output.temperature_range
    if limits is not None and limits[0] >= limits[1]:
        findings.error(("output", "temperature_range"), f"{limits[0]:g} K is not below {limits[1]:g} K")


def _pictures(config: Config, findings: _Findings) -> None:
    for number, kind in enumerate(config.output.images):
        if config.dimension == 2 and kind in ONLY_3D:
            findings.error(("output", "images", number), f"a picture '{kind}' exists in 3-D only")


def _domain(config: Config, findings: _Findings) -> None:
    domain = config.domain
    if domain is None:
        return
    if len(domain.lower) != config.dimension:
        findings.error(
            ("domain", "lower"), f"a {config.dimension}-D scene has {config.dimension} coordinates"
        )
        return
    box = Extent(tuple(domain.lower), tuple(domain.upper))
    for number, body in enumerate(config.bodies):
        if not box.contains(bodies_extent(config, [body]), config.spacing):
            findings.error(("bodies", number), "this body reaches out of the domain")


def _laser(config: Config, laser: Laser, findings: _Findings) -> None:
    dx, w = config.spacing, laser.beam_radius
    if w < 2 * dx:
        findings.warn(
            ("laser", "beam_radius"), f"the beam is only {w / dx:.2g} particles in radius; 2 is the least"
        )
    if laser.bin_size is not None and laser.bin_size > w:
        findings.warn(("laser", "bin_size"), "the bins are wider than the beam's radius")
    if laser.pulse is not None and laser.pulse.off == 0:
        findings.warn(("laser", "pulse", "off"), "a pulse that is off for no time is no pulse")
    points = list(_points(laser))
    wrong = [(path, point) for path, point in points if len(point) != config.dimension - 1]
    for path, point in wrong:
        wanted = "1 coordinate (x)" if config.dimension == 2 else "2 coordinates (x, y)"
        findings.error(path, f"a beam in a {config.dimension}-D scene has {wanted}, not {len(point)}")
    if wrong or findings.errors:
        return
    _where_it_shines(config, points, w, findings)
    end = laser.start + laser.passes * _duration(laser)
    if end <= laser.start:
        findings.error(("laser", "path"), "the beam goes nowhere and stays nowhere: the path takes no time")
    if config.time.end < end * (1 - 1e-9):
        findings.warn(
            ("time", "end"), f"the run ends at {config.time.end:g} s, before the beam does ({end:g} s)"
        )


def _where_it_shines(
    config: Config, points: list[tuple[Path, list[float]]], w: float, findings: _Findings
) -> None:
    metal = bodies_extent(config, config.bodies).horizontal()
    if config.domain is not None:
        box = Extent(tuple(config.domain.lower), tuple(config.domain.upper)).horizontal()
        outside = [path for path, point in points if not box.holds(point)]
        for path in outside:
            findings.error(path, "the beam leaves the domain here")
    swept = Extent(
        *(tuple(extreme(xs) for xs in zip(*(p for _, p in points), strict=True)) for extreme in (min, max))
    )
    if not swept.grown(w).touches(metal):
        findings.error(("laser", "path"), "the beam never meets a body")
        return
    outside = [path for path, point in points if not metal.holds(point)]
    if outside:
        more = f", and at {len(outside) - 1} more points" if len(outside) > 1 else ""
        findings.warn(outside[0], f"the beam is beside all bodies here{more}")


def _points(laser: Laser) -> Iterator[tuple[Path, list[float]]]:
    for number, part in enumerate(laser.path):
        at: Path = ("laser", "path", number)
        if isinstance(part, Move):
            yield (*at, "start"), part.start
            yield (*at, "end"), part.end
        else:
            yield (*at, "at"), part.at


def _duration(laser: Laser) -> float:
    """Time of one pass over the path [s]."""
    return sum(dist(p.start, p.end) / p.speed if isinstance(p, Move) else p.duration for p in laser.path)


# --------------------------------------------------------------------------- materials


def _materials(config: Config, findings: _Findings) -> None:
    from taichi_slm.materials.library import alloy_names, resolve

    known = sorted({*alloy_names(), *config.materials})
    found: dict[str, Any] = {}
    for path, name, moves in _names_used(config):
        if name not in known:
            findings.error(
                path, f"there is no material '{name}': there are {', '.join(known)}", closest(name, known)
            )
        elif name not in found:
            try:
                found[name] = resolve(name, config.materials)
            except ConfigError as error:
                at: Path = ("materials", name) if name in config.materials else path
                findings.error(at, str(error))
                found[name] = None
        if found.get(name) is not None:
            _properties(config, found[name], path, moves, findings)
    extended = {entry.extends for entry in config.materials.values()}
    for name, entry in config.materials.items():
        if name in found:
            continue
        if entry.extends is not None and entry.extends not in known:
            sentence = f"there is no material '{entry.extends}': there are {', '.join(known)}"
            findings.error(("materials", name, "extends"), sentence, closest(entry.extends, known))
        elif name not in extended:
            try:
                resolve(name, config.materials)
            except ConfigError as error:
                findings.error(("materials", name), str(error))
            else:
                findings.warn(("materials", name), "no body is made of this material")


def _names_used(config: Config) -> Iterator[tuple[Path, str, bool]]:
    """(where, name, whether a body of it may move) of every material that a body names."""
    for number, body in enumerate(config.bodies):
        moves = not (isinstance(body, Container) or (isinstance(body, Box) and body.wall))
        mixed = getattr(body, "materials", None)
        if not mixed:
            yield ("bodies", number, "material"), body.material, moves
        for index, name in enumerate(mixed or ()):
            yield ("bodies", number, "materials", index), name, moves


def _properties(config: Config, material: Any, at: Path, moves: bool, findings: _Findings) -> None:
    physics = config.physics
    if moves and physics.surface_tension and material.surface_tension is None:
        findings.error(at, f"'{material.name}' has no surface_tension law, but physics.surface_tension is on")
    if moves and physics.evaporation and material.evaporation is None:
        findings.error(at, f"'{material.name}' has no evaporation data, but physics.evaporation is on")
    hottest = material.maximum_temperature
    for path, temperature in _temperatures(config, config.bodies[int(at[1])], ("bodies", at[1])):
        if temperature >= hottest:
            sentence = (
                f"{temperature:g} K is not below the end of the tables of '{material.name}' ({hottest:g} K)"
            )
            findings.error(path, sentence)


def _temperatures(config: Config, body: AnyBody, at: Path) -> Iterator[tuple[Path, float]]:
    """The temperatures that a config gives a body."""
    if body.temperature is not None:
        yield (*at, "temperature"), body.temperature
    else:
        yield ("ambient_temperature",), config.ambient_temperature
    if isinstance(body.program, RampProgram):
        for number, (_, temperature) in enumerate(body.program.points):
            yield (*at, "program", "points", number), temperature
    elif body.program is not None:
        yield (*at, "program"), body.program.mean * (1 + abs(body.program.amplitude))
