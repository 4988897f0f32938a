"""What a run will take, told before it starts and without Taichi."""

import math
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from taichi_slm.backend import ON_DEMAND_FROM
from taichi_slm.config.extent import particles_about
from taichi_slm.config.load import LoadedConfig, load_config
from taichi_slm.config.material import Material
from taichi_slm.config.schema import Config, Laser, Move, PowderBed, PowderRow
from taichi_slm.errors import ConfigError
from taichi_slm.output.numbers import quantity
from taichi_slm.scene.scene import Scene
from taichi_slm.solver.needs import needs_of
from taichi_slm.solver.surroundings import keeps_slopes
from taichi_slm.sph.cells import cell_bytes, cell_size
from taichi_slm.sph.neighbours import list_room
from taichi_slm.state import bytes_of_a_particle

BUILT_AT_MOST = 2_000_000  # particles; larger scenes are counted by volume, so that the answer comes at once
RUNTIME_BYTES = 290e6  # Python, Taichi, VTK, kernels
SNAPSHOT_BYTES = 30.0  # per particle, compressed: 10 where all is cold, 60 where all moves
HISTORY_BYTES = 250.0  # per row
IMAGE_BYTES = 150e3
CHECKPOINT_SLOTS = 2
HOTTEST = 3500.0  # surface temperature of a melt pool that evaporates [K]: where the time step is asked


@dataclass(frozen=True)
class Estimate:
    """What a config asks for."""

    name: str
    title: str
    dimension: int
    spacing: float  # dx [m]
    particles: int
    counted: bool  # False: by volume, not particle by particle
    memory: float  # [bytes], once everything has been hot
    memory_cold: float  # [bytes], before anything is
    limits: dict[str, float]  # term -> largest stable step [s]
    step: float  # [s], aligned to the output
    limiter: str
    end: float  # [s]
    steps: int  # at most: a scene that is cold or finished takes fewer
    output: float  # [bytes]
    snapshots: int
    line_energy: float | None  # P/v of a moving beam [J/m]
    energy_density: float | None  # P/(v 2w layer) [J/m^3]
    warnings: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """The estimate as a page of text."""
        exact = "" if self.counted else "about "
        rows = [
            (
                "particles",
                f"{exact}{self.particles:,} ({self.dimension}-D, spacing {quantity(self.spacing, 'm')})",
            ),
            ("memory", self._memory()),
            *(
                (f"step {name}", f"{quantity(limit, 's')}{self._mark(name)}")
                for name, limit in self.limits.items()
            ),
        ]
        if self.limiter not in self.limits:
            rows.append((f"step {self.limiter}", f"{quantity(self.step, 's')}{self._mark(self.limiter)}"))
        rows += [
            ("steps", f"at most {self.steps:,} to {quantity(self.end, 's')}"),
            ("output", f"{size_text(self.output)} ({self.snapshots:,} snapshots)"),
        ]
        if self.line_energy is not None:
            rows.append(("line energy", f"P/v = {self.line_energy:,.4g} J/m"))
        if self.energy_density is not None:
            rows.append(("energy density", f"P/(v 2w layer) = {self.energy_density * 1e-9:,.4g} J/mm^3"))
        head = f"{self.name}: valid" + (f", {self.title}" if self.title else "")
        return [
            head,
            *(f"  {name:<16}{value}" for name, value in rows),
            *(f"  warning: {warning}" for warning in self.warnings),
        ]

    def _memory(self) -> str:
        most = size_text(self.memory)
        return most if self.memory_cold == self.memory else f"{size_text(self.memory_cold)} cold, {most} hot"

    def _mark(self, name: str) -> str:
        return "  <- rules" if name == self.limiter else ""


def estimate(loaded: LoadedConfig) -> Estimate:
    """What ``loaded`` asks for. Raises ConfigError where its scene cannot be built."""
    from taichi_slm.solver.timestep import limits

    config = loaded.config
    try:
        count, counted, scene = _count(config)
        found = limits(config, _materials(config, scene), _hottest(config))
    except ConfigError as error:
        raise ConfigError(f"{loaded.path}: {error}") from None
    step, limiter = _step(config, found)
    interval = config.output.history_interval or config.time.end / 400
    steps = math.ceil(config.time.end / interval) * math.ceil(interval / step * (1 - 1e-9))
    line, density = energy_density(config)
    memory = memory_bytes(config, count, scene)
    snapshots, output = output_bytes(config, count)
    warnings = [*loaded.warnings, *_shortages(memory, output)]
    if step > interval * (1 + 1e-9):
        warnings.append("output.history_interval is shorter than a stable step: it rules the step")
    return Estimate(
        name=str(loaded.path),
        title=config.title,
        dimension=config.dimension,
        spacing=config.spacing,
        particles=count,
        counted=counted,
        memory=memory,
        memory_cold=memory_bytes(config, count, scene, cold=True),
        limits=found,
        step=min(step, interval),
        limiter=limiter,
        end=config.time.end,
        steps=steps,
        output=output,
        snapshots=snapshots,
        line_energy=line,
        energy_density=density,
        warnings=warnings,
    )


def validate_all(paths: Sequence[str | Path], overrides: Sequence[str] = ()) -> Iterator[str]:
    """Lines of the estimate of every config; at the end a ConfigError with all refusals, if there are any."""
    refusals = []
    for path in paths:
        try:
            yield from estimate(load_config(path, overrides)).lines()
        except ConfigError as error:
            refusals.append(str(error))
    if refusals:
        raise ConfigError("\n".join(refusals))


def energy_density(config: Config) -> tuple[float | None, float | None]:
    """(P/v [J/m], P/(v 2w layer) [J/m^3]) of the strongest stretch; None without a moving beam or powder.

    P is the beam's power, not the absorbed one; the layer is the height of a bed, or of a row's grains.
    """
    laser = config.laser
    moves = [part for part in laser.path if isinstance(part, Move)] if laser else []
    if laser is None or not moves or laser.power == 0:
        return None, None
    line = max(laser.power * part.power_fraction / part.speed for part in moves) * _duty(laser)
    layers = [body.height for body in config.bodies if isinstance(body, PowderBed)]
    layers += [2 * body.radius for body in config.bodies if isinstance(body, PowderRow)]
    return line, line / (2 * laser.beam_radius * max(layers)) if layers else None


def _duty(laser: Laser) -> float:
    """Share of the time that a pulsed beam is on."""
    return laser.pulse.on / (laser.pulse.on + laser.pulse.off) if laser.pulse else 1.0


def memory_bytes(
    config: Config, count: int, scene: Scene | None = None, real: int = 8, cold: bool = False
) -> float:
    """Memory of a run [bytes]: the particle fields of state.py, the neighbour lists, cells, the runtime.

    ``cold``: before any of it is hot or melts, which matters in a scene that takes memory on demand.
    """
    d, performance = config.dimension, config.performance
    per_particle, on_demand = state_bytes(config, real)
    near = 2 * config.numerics.smoothing + performance.skin  # radii [dx]
    far = 2 * config.numerics.surface_smoothing + performance.skin if config.physics.flow else near
    lists = 4 * (list_room(0.0, near, d) + (list_room(near, far, d) if far > near else 0))
    lists += real * list_room(0.0, near, d) if keeps_slopes(d) and config.physics.heat else 0
    taken = per_particle + lists
    if cold and count >= ON_DEMAND_FROM:
        taken = per_particle - on_demand
    sites = 2.0 * count
    if scene is not None:
        sites = math.prod(((scene.upper - scene.lower) / scene.spacing).tolist())
    host = 2 * per_particle  # numpy copies for output and checkpoints
    return RUNTIME_BYTES + count * (taken + host) + cell_bytes(cell_size(far, 1.0), d) * sites


def state_bytes(config: Config, real: int = 8) -> tuple[int, int]:
    """Bytes of one particle's fields, and of them those that it needs only once it is hot, or moves.

    ``real`` is 8 for f64, 4 for f32.
    """
    return bytes_of_a_particle(needs_of(config, len(_material_names(config))), config.dimension, real)


def output_bytes(config: Config, count: int) -> tuple[int, float]:
    """(number of snapshots, bytes of the whole run folder)."""
    end, output = config.time.end, config.output
    snapshots = math.floor(end / (output.snapshot_interval or end / 40) * (1 + 1e-9)) + 1
    rows = math.floor(end / (output.history_interval or end / 400) * (1 + 1e-9)) + 1
    pictures = len(output.images) * min(output.images_at_most, snapshots)
    checkpoints = CHECKPOINT_SLOTS * count * state_bytes(config)[0]
    size = (
        snapshots * (count * SNAPSHOT_BYTES + 5e3)
        + rows * HISTORY_BYTES
        + pictures * IMAGE_BYTES
        + checkpoints
    )
    return snapshots, size


def _count(config: Config) -> tuple[int, bool, Scene | None]:
    from taichi_slm.scene.build import build_scene

    about = particles_about(config)
    if about > BUILT_AT_MOST:
        return round(about), False, None
    scene = build_scene(config)
    return scene.count, True, scene


def _materials(config: Config, scene: Scene | None) -> tuple[Material, ...]:
    from taichi_slm.materials.library import resolve

    if scene is not None:
        return scene.materials
    return tuple(resolve(name, config.materials) for name in _material_names(config))


def _material_names(config: Config) -> list[str]:
    """Of all bodies, each once."""
    named = (name for body in config.bodies for name in getattr(body, "materials", None) or [body.material])
    return list(dict.fromkeys(named))


def _hottest(config: Config) -> float:
    """Temperature [K] up to which the step is asked: a melt pool's, or the hottest that the config names."""
    named = [config.ambient_temperature, *(body.temperature or 0.0 for body in config.bodies)]
    for body in config.bodies:
        if body.program is not None and body.program.kind == "sine":
            named.append(body.program.mean * (1 + abs(body.program.amplitude)))
        elif body.program is not None:
            named += [temperature for _, temperature in body.program.points]
    return max(named) if config.laser is None else max(HOTTEST, *named)


def _step(config: Config, limits: dict[str, float]) -> tuple[float, str]:
    named = dict(limits)
    if config.numerics.maximum_step is not None:
        named["maximum_step"] = config.numerics.maximum_step
    limiter = min(named, key=lambda name: named[name])
    return named[limiter], limiter


def _shortages(memory: float, output: float) -> list[str]:
    """What this machine may not have enough of."""
    short = []
    available = available_memory()
    if available is not None and memory > available:
        short.append(f"memory: about {size_text(memory)} needed, {size_text(available)} free on this machine")
    try:
        free = shutil.disk_usage(Path.cwd()).free
    except OSError:
        return short
    if output > free:
        short.append(f"disk: about {size_text(output)} needed, {size_text(free)} free here")
    return short


def available_memory() -> float | None:
    """Memory that this machine can give a new process [bytes]; None where the system does not tell."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return float(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):  # Windows
        return None


def size_text(size: float) -> str:
    """``size`` [bytes] as a person reads it."""
    for unit, factor in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if size >= factor:
            return f"{size / factor:,.3g} {unit}"
    return f"{size / 1e3:,.3g} kB"
