"""What a run left behind, as its analysis sees it: the snapshots one after the other, and what they all share."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Config, Move
from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import read_json
from taichi_slm.output.snapshots import Snapshot, read_series, read_snapshot


@dataclass(frozen=True)
class Moment:
    """The particles at one time; rows in the order of their ids.

    Coordinates are along the beam's way, across it (3-D only) and up; the plate's top is at 0. In 2-D volumes are
    areas [m^2] and masses are per unit depth [kg/m].
    """

    time: float  # [s]
    spacing: float  # dx [m]
    id: np.ndarray  # shape [n]; the same particle keeps it from first to last
    position: np.ndarray  # [m], shape [n, dimension]
    velocity: np.ndarray  # [m/s], shape [n, dimension]
    temperature: np.ndarray  # [K], shape [n]
    excess: np.ndarray  # above the melting point [K]; minus infinity for walls and what has no solid
    liquid: np.ndarray  # bool
    ever_liquid: np.ndarray  # bool
    wall: np.ndarray  # bool
    material: np.ndarray  # index
    tracer: np.ndarray  # group
    mass: np.ndarray  # [kg]
    volume: np.ndarray  # mass over present density [m^dimension]

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.position.shape[1]

    @property
    def solid(self) -> np.ndarray:
        """What is not liquid: metal below its melting point, and walls; bool, shape [n]."""
        solid: np.ndarray = self.wall | (np.isfinite(self.excess) & ~self.liquid)
        return solid


@dataclass(frozen=True)
class Recording:
    """A run folder, opened: nothing but its facts is read yet."""

    folder: Path
    config: Config
    names: tuple[str, ...]  # of the materials
    solidus: np.ndarray  # [K], shape [materials]; infinite for one that has no solid
    liquidus: np.ndarray
    files: tuple[Path, ...]  # of the snapshots, in time

    @property
    def on_plate(self) -> bool:
        """Whether there is a plate, so that height 0 is its surface."""
        return any(body.shape == "plate" for body in self.config.bodies)

    def moments(self) -> Iterator[Moment]:
        """The snapshots in time, one in memory at once; a damaged one is a StorageError."""
        frame = along(self.config)
        density: np.ndarray | None = None
        for path in self.files:
            snapshot = read_snapshot(path)
            if density is None:  # of the first one, by id: masses do not change
                density = np.full(int(snapshot.arrays["id"].max()) + 1, np.nan)
                density[snapshot.arrays["id"]] = snapshot.arrays["density"]
            yield self._moment(snapshot, density, frame)

    def _moment(self, snapshot: Snapshot, density: np.ndarray, frame: np.ndarray) -> Moment:
        arrays = snapshot.arrays
        wall = arrays["wall"].astype(bool)
        melting = (0.5 * (self.solidus + self.liquidus))[arrays["material"]]
        excess = np.where(wall, -np.inf, arrays["temperature"] - melting)
        mass = density[arrays["id"]] * snapshot.spacing**snapshot.dimension
        return Moment(
            time=snapshot.time,
            spacing=snapshot.spacing,
            id=arrays["id"],
            position=_turned(arrays["position"], frame),
            velocity=_turned(arrays["velocity"], frame),
            temperature=arrays["temperature"],
            excess=excess,
            liquid=(excess >= 0.0) & (arrays["liquid_fraction"] >= 0.5),
            ever_liquid=arrays["ever_liquid"].astype(bool) & ~wall,
            wall=wall,
            material=arrays["material"],
            tracer=arrays["tracer"],
            mass=mass,
            volume=mass / arrays["density"],
        )


def open_run(folder: Path) -> Recording:
    """The run in ``folder``; a StorageError if it is none, or has no snapshots."""
    if not folder.is_dir():
        raise StorageError(f"there is no folder {folder}")
    missing = [name for name in ("config.resolved.yaml", "provenance.json") if not (folder / name).is_file()]
    if missing:
        raise StorageError(f"{folder} is not a run folder: {' and '.join(missing)} missing")
    series = folder / "snapshots.pvd"
    files = tuple(path for _, path in read_series(series)) if series.is_file() else ()
    if not files:
        raise StorageError(f"{folder} has no snapshots to analyse")
    materials = read_json(folder / "provenance.json").get("materials")
    try:
        facts = [(m["name"], m["solidus_K"], m["liquidus_K"]) for m in materials or ()]
    except (KeyError, TypeError):
        facts = []
    if not facts:
        raise StorageError(f"{folder / 'provenance.json'} does not name the materials of the run")
    kelvin = np.array([[np.inf if each is None else float(each) for each in row[1:]] for row in facts])
    return Recording(
        folder=folder,
        config=load_config(folder / "config.resolved.yaml").config,
        names=tuple(row[0] for row in facts),
        solidus=kelvin[:, 0],
        liquidus=kelvin[:, 1],
        files=files,
    )


def along(config: Config) -> np.ndarray:
    """Axes along and across the beam's longest straight way, and up; orthonormal rows, shape [dimension, dimension]."""
    axes = np.eye(config.dimension)
    ways = [part for part in config.laser.path if isinstance(part, Move)] if config.laser else []
    if config.dimension == 2 or not ways:
        return axes
    longest = max(ways, key=lambda way: math.dist(way.start, way.end))
    length = math.dist(longest.start, longest.end)
    if length > 0.0:
        x, y = ((b - a) / length for a, b in zip(longest.start, longest.end, strict=True))
        axes[:2, :2] = [[x, y], [-y, x]]
    return axes


def _turned(vectors: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Components along the rows of ``frame``; untouched where these are the axes already."""
    turned: np.ndarray = vectors if (frame == np.eye(len(frame))).all() else vectors @ frame.T
    return turned
