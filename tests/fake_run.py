"""A stand-in for the simulation: a comet of heat runs over a powder row, in closed form."""

import contextlib
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from taichi_slm.config.load import LoadedConfig
from taichi_slm.config.material import Material
from taichi_slm.config.schema import Config
from taichi_slm.run import driver
from taichi_slm.scene.scene import Scene

SOLIDUS, LIQUIDUS, AMBIENT = 1673.0, 1773.0, 293.0
SPEED, BEAM = 2.0, 27e-6
GRAIN = 25e-6


def material(name: str = "steel_304") -> Material:
    law = {"constant": 1.0}
    both = {"solid": law, "liquid": law}
    properties = dict.fromkeys(("density", "heat_capacity", "conductivity", "viscosity"), both)
    return Material.model_validate({"name": name, "solidus": SOLIDUS, "liquidus": LIQUIDUS, **properties})


def config(
    dimension: int = 2, spacing: float = 10e-6, length: float = 400e-6, end: float = 4e-4, **changes
) -> Config:
    plate = {"shape": "plate", "length": length, "depth": 0.5 * length if length < 5e-4 else 280e-6}
    if dimension == 3:
        plate["width"] = 0.5 * length
    return Config.model_validate(
        {
            "title": "a comet over a powder row",
            "dimension": dimension,
            "spacing": spacing,
            "bodies": [plate, {"shape": "powder_row", "length": length, "radius": GRAIN}],
            "time": {"end": end, **changes.pop("time", {})},
            **changes,
        }
    )


def loaded(parsed: Config, text: str = "title: as given\n") -> LoadedConfig:
    return LoadedConfig(parsed, text, parsed.model_dump(mode="json"), Path("comet.yaml"))


def scene(parsed: Config) -> Scene:
    dx, plate = parsed.spacing, parsed.bodies[0]
    width = [plate.width] if parsed.dimension == 3 else []
    axes = [np.arange(0.5 * dx, plate.length, dx)]
    axes += [np.arange(0.5 * dx - 0.5 * w, 0.5 * w, dx) for w in width]
    axes += [np.arange(0.5 * dx - plate.depth, 2.0 * GRAIN, dx)]
    position = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    x, up = position[:, 0], position[:, -1]
    across = position[:, 1] if width else np.zeros(len(x))
    along = np.mod(x, 2.0 * GRAIN) - GRAIN
    grain = (up > 0.0) & (along**2 + across**2 + (up - GRAIN) ** 2 < GRAIN**2)
    keep = grain | (up < 0.0)
    position, grain, number = position[keep], grain[keep], (x[keep] // (2.0 * GRAIN)).astype(np.int32)
    count = len(position)
    return Scene(
        dimension=parsed.dimension,
        spacing=dx,
        lower=position.min(axis=0),
        upper=position.max(axis=0),
        position=position,
        velocity=np.zeros_like(position),
        temperature=np.full(count, AMBIENT),
        volume=np.full(count, dx**parsed.dimension),
        material=np.zeros(count, dtype=np.int32),
        body=grain.astype(np.int32),
        tracer=np.where(grain & (number % 4 == 1), 1, 0).astype(np.int32),
        wall=np.zeros(count, dtype=bool),
        held=position[:, -1] < -plate.depth + 3 * dx,
        materials=(material(),),
        follows_density=(),
        programs={},
    )


def settled(built: Scene) -> np.ndarray:
    """Where each powder particle comes to rest once molten: a bead with humps, filled from left to right."""
    target = built.position.copy()
    powder = np.flatnonzero(built.body == 1)
    dx = built.spacing
    if built.dimension == 3:
        target[powder, 2] *= 0.6
        target[powder, 1] *= 1.6
        return target
    order = powder[np.lexsort((target[powder, 1], np.floor(target[powder, 0] / dx)))]
    columns = np.arange(0.5 * dx, built.upper[0] + dx, dx)
    heights = 0.5 * np.pi * GRAIN * (1.0 + 0.25 * np.sin(columns / 31e-6) * np.sin(columns / 77e-6))
    counts = np.maximum(1, np.round(heights / dx)).astype(int)
    sites = np.concatenate(
        [
            np.stack([np.full(n, c), (np.arange(n) + 0.5) * dx], axis=1)
            for c, n in zip(columns, counts, strict=True)
        ]
    )
    number = min(len(order), len(sites))
    target[order[:number]] = sites[:number]
    return target


class FakeSimulation:
    """The face of taichi_slm.run.simulation.Simulation over a closed form; a step is 1e-7 s."""

    step_length = 1e-7
    moving = 0

    def __init__(self, parsed: Config, **_settings) -> None:
        self.config, self.scene = parsed, scene(parsed)
        self.time, self.steps = 0.0, 0
        self.compile_time_s = self.solver_time_s = 0.0
        self.particle_steps = 0
        self.ever_liquid = np.zeros(self.scene.count, dtype=np.uint8)
        self._settled = settled(self.scene)
        self._at = 0.0

    @property
    def finished(self) -> bool:
        return self.time >= self.config.time.end

    def compile(self) -> None:
        self.compile_time_s = 0.01

    def advance(self, until: float, pause: int | None = None) -> None:
        while self.time < until and self.steps < (pause or math.inf):
            self.time = min(until, self.time + self.step_length)
            self.steps += 1
            self.particle_steps += self.scene.count
        self.ever_liquid |= self._temperature() >= LIQUIDUS

    def pause(self) -> None:
        pass

    def _beam(self) -> float:
        return 100e-6 + SPEED * self.time

    def _temperature(self) -> np.ndarray:
        start, length = 100e-6, self.config.bodies[0].length - 200e-6
        fade = np.exp(-max(0.0, self._beam() - start - length) / 3e-4)
        behind = self._position() - np.append(
            np.full(1, min(self._beam(), start + length)), np.zeros(self._rest())
        )
        behind[:, -1] -= 20e-6
        r = np.sqrt((behind**2).sum(axis=1) + (0.4 * BEAM) ** 2)
        rise = 4200.0 * (BEAM / r) ** 0.5 * np.exp(-(behind[:, 0] + r) / 60e-6)
        warm_up = 1.0 - np.exp(-self.time / 2e-5)
        return np.where(self.scene.held, AMBIENT, AMBIENT + fade * warm_up * rise)

    def _rest(self) -> int:
        return self.config.dimension - 1

    def _position(self) -> np.ndarray:
        start = self.scene.position
        late = np.clip((self._beam() - start[:, :1] - 10e-6) / 60e-6, 0.0, 1.0)
        return start + (self.ever_liquid[:, None] > 0) * late * (self._settled - start)

    def arrays(self, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
        every = self._arrays()
        return every if names is None else {name: every[name] for name in names}

    def _arrays(self) -> dict[str, np.ndarray]:
        temperature = self._temperature()
        fraction = np.clip((temperature - SOLIDUS) / (LIQUIDUS - SOLIDUS), 0.0, 1.0)
        velocity = np.zeros_like(self.scene.position)
        velocity[:, 0] = -fraction * (temperature - LIQUIDUS) / 500.0
        count = self.scene.count
        return {
            "position": self._position(),
            "velocity": velocity,
            "temperature": temperature,
            "liquid_fraction": fraction,
            "density": np.full(count, 7000.0),
            "pressure": np.zeros(count),
            "surface_force": 7e9 * fraction[:, None] * np.eye(self.config.dimension)[-1],  # 1e6 m/s^2 upwards
            "material": self.scene.material,
            "tracer": self.scene.tracer,
            "id": np.arange(count, dtype=np.int32),
            "ever_liquid": self.ever_liquid,
            "wall": self.scene.wall.astype(np.uint8),
            "held": self.scene.held.astype(np.uint8),
        }

    def diagnostics(self) -> dict:
        temperature = self._temperature()
        return {
            "step": self.steps,
            "time_s": self.time,
            "dt_s": self.step_length,
            "dt_limiter": "sound",
            "mobile": int((temperature > SOLIDUS).sum()),
            "hot": int((temperature > AMBIENT + 1.0).sum()),
            "max_temperature_K": temperature.max(),
            "max_speed_m_s": 1.0,
            "absorbed_J": 2.0 * self.time,
            "stored_J": 1.5 * self.time,
            "radiated_J": 0.1 * self.time,
            "conducted_out_J": 0.4 * self.time,
            "energy_error": 1e-6,
            "mass_error": 0.0,
            "removed": 0,
            "packing_low": 0.97,
        }

    def checkpoint(self) -> dict[str, np.ndarray]:
        return {
            "time": np.array([self.time]),
            "steps": np.array([self.steps]),
            "ever_liquid": self.ever_liquid.copy(),
        }

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        self.time, self.steps = float(arrays["time"][0]), int(arrays["steps"][0])
        self.ever_liquid = arrays["ever_liquid"].copy()


OUTPUT = {"images": []}


def short(**changes) -> Config:
    """0.1 ms of the comet, 1000 steps and no pictures."""
    return config(spacing=20e-6, length=200e-6, end=1e-4, output=OUTPUT, **changes)


def run(tmp_path: Path, console: Console, parsed: Config | None = None, name: str = "run") -> Path:
    return driver.execute(loaded(parsed or short()), tmp_path / name, console=console)


class NobodyDraws(contextlib.nullcontext):
    """In place of `Draughtsmen`."""

    def __init__(self, *_):
        super().__init__(self)

    def draw(self) -> str:
        return ""


def driven(out: Path, monkeypatch, **changes) -> Path:
    """A run of the comet in ``out``: six snapshots, no pictures yet."""
    monkeypatch.setattr(driver, "_build", lambda parsed, *_: FakeSimulation(parsed))
    monkeypatch.setattr(driver, "Draughtsmen", NobodyDraws)
    output = {"images_at_most": 3, "history_interval": 1e-5, "snapshot_interval": 2e-5}
    parsed = config(spacing=10e-6, end=1e-4, output=output, **changes)
    with open(out / "said.txt", "w") as file:
        return driver.execute(loaded(parsed), out / "run", console=Console(file=file))


def pixels(path: Path) -> np.ndarray:
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def share(image: np.ndarray, colour) -> float:
    """Share of the pixels close to ``colour``."""
    return float((np.abs(image - np.asarray(colour)).max(axis=2) < 12).mean())
