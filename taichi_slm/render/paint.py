"""Which colour a particle gets, and the key that explains it; the colour-blind can tell them apart."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from taichi_slm.output.snapshots import Snapshot

UNMELTED = np.array([0xB9, 0xC3, 0xCC])  # solid, never melted: light grey-blue
RESOLIDIFIED = np.array([0x4F, 0x81, 0xB0])  # solid again: blue
MUSHY = np.array(
    [[0xFF, 0xE4, 0x9A], [0xF6, 0xA0, 0x3C]]
)  # from hardly to almost liquid: pale yellow to orange
LIQUID = np.array([0xC8, 0x32, 0x12])  # vermilion
GREY = np.array([0xC9, 0xCC, 0xCF])
GROUPS = np.array(  # Okabe and Ito, after the grey of group 0
    [
        [0xD5, 0x5E, 0x00],
        [0x00, 0x72, 0xB2],
        [0x00, 0x9E, 0x73],
        [0xCC, 0x79, 0xA7],
        [0xE6, 0x9F, 0x00],
        [0x56, 0xB4, 0xE9],
        [0xF0, 0xE4, 0x42],
    ]
)
DARKEST = 0.06  # start of a colour map: pure black would swallow the outlines
ALMOST = 1e-3  # liquid fractions this close to 0 or 1 are solid or liquid


@dataclass(frozen=True)
class Scales:
    """What the colours of one run mean, the same from its first picture to its last."""

    temperature: tuple[float, float]  # [K]
    speed: float  # largest [m/s]
    materials: tuple[str, ...]
    tracers: int  # largest group
    melting: float | None  # [K]
    flow: float = 1.0  # speed that most of the melt stays below [m/s]
    force: float = 1.0  # acceleration by surface forces that most of the surface stays below [m/s^2]
    height: tuple[float, float] = (0.0, 0.0)  # of the melt, lowest and highest [m]; 3-D


@dataclass(frozen=True)
class Key:
    """The legend: an optional bar of colours with ticks along it, and swatches."""

    title: str
    bar: np.ndarray | None = None  # shape [n, 3]
    ticks: list[tuple[float, str]] = field(default_factory=list)  # (0 to 1 along the bar, label)
    swatches: list[tuple[np.ndarray, str]] = field(default_factory=list)
    lines: list[tuple[float, str]] = field(default_factory=list)  # (thickness [px], label)


def colours(kind: str, values: np.ndarray, scales: Scales) -> np.ndarray:
    """Colours of the points of a 3-D picture of ``kind``: uint8, shape [n, 3].

    ``values``, shape [n]: temperature [K] of a cut, height [m] of an isosurface, speed [m/s] of streamlines.
    """
    name, (low, high) = {
        "cut": ("inferno", scales.temperature),
        "isosurface": ("viridis", scales.height),
        "streamlines": ("viridis", (0.0, scales.flow)),
    }[kind]
    return _look_up(name, (np.asarray(values) - low) / (high - low))


def paint(kind: str, snapshot: Snapshot, scales: Scales) -> np.ndarray:
    """Colours of the particles for a picture of ``kind``: uint8, shape [n, 3]."""
    arrays = snapshot.arrays
    if kind == "temperature":
        low, high = scales.temperature
        return _look_up("inferno", (arrays["temperature"] - low) / (high - low))
    if kind == "state":
        return _state(arrays["liquid_fraction"], arrays["ever_liquid"].astype(bool))
    if kind == "velocity":
        speed = np.linalg.norm(arrays["velocity"], axis=1)
        colours = _look_up("viridis", speed / scales.speed)
        colours[arrays["liquid_fraction"] <= ALMOST] = GREY
        return colours
    if kind == "surface_force":
        size = np.linalg.norm(surface_acceleration(snapshot), axis=1)
        colours = _look_up("viridis", size / scales.force)
        colours[arrays["liquid_fraction"] <= ALMOST] = GREY
        return colours
    if kind in ("tracer", "material"):
        return _groups(arrays[kind])
    raise ValueError(f"no picture is called '{kind}'")


def surface_acceleration(snapshot: Snapshot) -> np.ndarray:
    """Acceleration by surface tension and its gradient [m/s^2], shape [n, dimension]."""
    return np.asarray(snapshot.arrays["surface_force"] / snapshot.arrays["density"][:, None])


def key(kind: str, scales: Scales, dimension: int) -> Key:
    """The legend of a picture of ``kind``."""
    lines = [] if scales.melting is None else [(3.5, f"melting point, {scales.melting:.0f} K")]
    if kind in ("temperature", "cut"):
        low, high = scales.temperature
        ticks = [((t - low) / (high - low), f"{t:.0f}") for t in _round_ticks(low, high)]
        if kind == "cut":
            lines.append((0.0, f"longest arrow: {scales.speed:g} m/s"))
        return Key("temperature [K]", _table("inferno"), ticks, lines=lines)
    solid = [
        (MUSHY.mean(axis=0).astype(int), "mushy"),
        (RESOLIDIFIED, "solid again"),
        (UNMELTED, "never melted"),
    ]
    if kind == "isosurface":
        low, high = (1e6 * z for z in scales.height)
        ticks = [((z - low) / (high - low), f"{round(z)}") for z in _round_ticks(low, high, 3)]
        return Key(f"height of the surface at {scales.melting:.0f} K [µm]", _table("viridis"), ticks, solid)
    if kind == "streamlines":
        ticks = [(v / scales.flow, f"{v:g}") for v in _round_ticks(0.0, scales.flow)]
        return Key("speed of the melt [m/s]", _table("viridis"), ticks, solid)
    if kind == "state":
        mushy = _state(np.linspace(0.01, 0.99, 64), np.ones(64, dtype=bool))
        swatches = [(LIQUID, "liquid"), (RESOLIDIFIED, "solid again"), (UNMELTED, "never melted")]
        if lines and dimension == 2:
            lines.append((1.5, "isotherms"))
        return Key("liquid fraction", mushy, [(0.0, "0"), (0.5, "0.5"), (1.0, "1")], swatches, lines)
    if kind == "velocity":
        ticks = [(v / scales.speed, f"{v:g}") for v in _round_ticks(0.0, scales.speed)]
        if scales.melting is None:
            return Key("speed [m/s]", _table("viridis"), ticks)
        return Key("speed of the melt [m/s]", _table("viridis"), ticks, [(GREY, "solid")], lines)
    if kind == "surface_force":
        ticks = [(a / scales.force, f"{a / 1e6:g}") for a in _round_ticks(0.0, scales.force)]
        title = "acceleration by surface forces [µm/µs²]"
        return Key(title, _table("viridis"), ticks, [(GREY, "solid")], lines)
    if kind == "tracer":
        groups = range(1, scales.tracers + 1)
        named = [(GREY, "others")] + [(_groups(np.array([g]))[0], f"group {g}") for g in groups]
        return Key("tracer particles", swatches=named[:6], lines=lines)
    named = [(_groups(np.array([k]))[0], name) for k, name in enumerate(scales.materials)]
    return Key("material", swatches=named[:6], lines=lines)


def _state(fraction: np.ndarray, ever_liquid: np.ndarray) -> np.ndarray:
    colours = MUSHY[0] + fraction[:, None] * (MUSHY[1] - MUSHY[0])
    solid = fraction <= ALMOST
    colours[solid] = np.where(ever_liquid[solid, None], RESOLIDIFIED, UNMELTED)
    colours[fraction >= 1.0 - ALMOST] = LIQUID
    return colours.astype(np.uint8)


def _groups(number: np.ndarray) -> np.ndarray:
    cycled = GROUPS[(number - 1) % len(GROUPS)]
    return np.where(number[:, None] == 0, GREY, cycled).astype(np.uint8)


@lru_cache(maxsize=4)
def _table(name: str) -> np.ndarray:
    from matplotlib import colormaps

    return (255 * colormaps[name](np.linspace(DARKEST, 1.0, 256))[:, :3]).round().astype(np.uint8)


def _look_up(name: str, share: np.ndarray) -> np.ndarray:
    return _table(name)[(255 * np.clip(share, 0.0, 1.0)).round().astype(int)]


def _round_ticks(low: float, high: float, parts: int = 5) -> list[float]:
    """Round numbers, about ``parts``, between ``low`` and ``high``, and both ends; none too close to an end."""
    step = round_up((high - low) / parts)
    inner = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    return [low, *(t for t in inner if t - low > 0.45 * step and high - t > 0.45 * step), high]


def round_up(value: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is not below ``value``; 1 for nothing."""
    if value <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * min(m for m in (1, 2, 5, 10) if m * power >= value * (1 - 1e-9)))


def round_length(wanted: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that is not above ``wanted``."""
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(m for m in (1, 2, 5) if m * power <= wanted * (1 + 1e-9)))
