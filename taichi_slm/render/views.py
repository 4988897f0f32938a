"""Pictures of a run from its folder alone: one plotter, one camera, the same colours from first to last."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_slm.config.load import load_config
from taichi_slm.config.schema import Config
from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import make_folder, write_bytes
from taichi_slm.output.snapshots import Snapshot, read_series, read_snapshot, spread
from taichi_slm.render.frame import FOOTER, HEADER, MARGIN, frame
from taichi_slm.render.isotherm import PlaneField, smooth
from taichi_slm.render.overlay import draw_key, draw_scale_bar, draw_text
from taichi_slm.render.paint import ALMOST, Scales, key, paint, round_length, round_up
from taichi_slm.render.particles import Particles, arrows, draw_polygons

THIN_STEP = 500.0  # between the thin isotherms [K]
LABELLED = 150  # isotherms at least this wide carry their temperature [px]
ARROW_CELL, ARROW_LENGTH = 26, 60  # one velocity arrow in a square of this side, the longest one [px]
HEADROOM = 0.45  # how far above the first picture's top a frame reaches at most, as a share of its height


def render_run(folder: Path, images: Sequence[str] | None = None) -> list[Path]:
    """Draw the pictures of the run in ``folder`` into its renders/; ``images`` replaces output.images.

    Reads config.resolved.yaml, provenance.json and the snapshots, nothing else. Returns the files, in order.
    """
    config = load_config(folder / "config.resolved.yaml").config
    series = read_series(folder / "snapshots.pvd")
    if not series:
        raise StorageError(f"{folder} has no snapshots to draw")
    kinds = list(config.output.images if images is None else images)
    chosen = spread([path for _, path in series], config.output.images_at_most)
    if not kinds or not chosen:
        return []
    snapshots = [read_snapshot(path) for path in chosen]
    studio = Studio(folder, config, snapshots)
    make_folder(folder / "renders")
    files = []
    for path, snapshot in zip(chosen, snapshots, strict=True):
        files += studio.shoot(snapshot, kinds, path.stem)
    studio.close()
    return files


@dataclass(frozen=True)
class Clock:
    """Simulated time as it is written on every picture of a run."""

    factor: float
    unit: str
    decimals: int

    @classmethod
    def for_end(cls, end: float) -> "Clock":
        """The unit that suits a run of ``end`` [s]."""
        factor, unit = next(
            ((f, u) for f, u in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")) if end >= 0.1 * f), (1e-9, "ns")
        )
        return cls(factor, unit, max(0, 4 - len(str(int(end / factor)))))

    def text(self, time: float) -> str:
        """``time`` [s] as "t = 0.240 ms"."""
        return f"t = {time / self.factor:.{self.decimals}f} {self.unit}"


class Studio:
    """The plotter and all that stays the same through a run."""

    def __init__(self, folder: Path, config: Config, snapshots: list[Snapshot]) -> None:
        import pyvista as pv
        from vtkmodules.vtkCommonCore import vtkLogger

        self.folder, self.config = folder, config
        self.title = config.title or folder.resolve().name
        self.scales = scales(folder, config, snapshots)
        self.frame = frame(visible(snapshots), 0.6 * config.spacing)
        self.clock = Clock.for_end(config.time.end)
        size = self.frame.window
        self.scale_bar = round_length(0.2 * (size[0] - 2 * MARGIN) / self.frame.scale)
        vtkLogger.SetStderrVerbosity(
            vtkLogger.VERBOSITY_ERROR
        )  # it warns of a missing display, then does without
        self.plotter: Any = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
        self.plotter.renderer.SetBackground(1.0, 1.0, 1.0)
        self.plotter.enable_anti_aliasing("msaa", multi_samples=8)

    def close(self) -> None:
        """Give the plotter back."""
        self.plotter.close()

    def shoot(self, snapshot: Snapshot, kinds: Sequence[str], name: str) -> list[Path]:
        """One picture of ``snapshot`` for each of ``kinds``; returns the files."""
        files = []
        for kind, image in self.draw(snapshot, kinds):
            path = self.folder / "renders" / f"{kind}_{name}.png"
            write_bytes(path, png(image))
            files.append(path)
        return files

    def draw(self, snapshot: Snapshot, kinds: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
        """Each of ``kinds`` with its picture of ``snapshot``, uint8, shape [height, width, 3]."""
        particles = Particles(snapshot, snapshot.spacing * self.frame.scale)
        field = self._field(snapshot)
        for kind in kinds:
            plotter = self.plotter
            plotter.clear_actors()
            particles.draw(plotter, paint(kind, snapshot, self.scales))
            if kind == "velocity" and snapshot.dimension == 2:
                self._arrows(snapshot)
            self._isotherms(kind, field, snapshot)
            self._surround(kind, snapshot)
            self.frame.aim(plotter, distance=20.0 * float(np.ptp(snapshot.arrays["position"], axis=0).max()))
            plotter.render()
            yield kind, plotter.screenshot(return_img=True)

    def _field(self, snapshot: Snapshot) -> PlaneField | None:
        if self.scales.melting is None:
            return None
        position = snapshot.arrays["position"]
        plane, distance = position[:, [0, -1]], position[:, 1] if snapshot.dimension == 3 else None
        return smooth(
            plane,
            snapshot.arrays["temperature"],
            snapshot.spacing,
            self.scales.temperature[0] + 100.0,
            distance,
        )

    def _arrows(self, snapshot: Snapshot) -> None:
        moving = snapshot.arrays["liquid_fraction"] > ALMOST
        cell, longest = ARROW_CELL / self.frame.scale, ARROW_LENGTH / self.frame.scale
        mesh = arrows(snapshot, moving, cell, longest, self.scales.speed)
        if mesh is not None:
            draw_polygons(self.plotter, mesh, np.full((mesh.n_cells, 3), 20, dtype=np.uint8))

    def _isotherms(self, kind: str, field: PlaneField | None, snapshot: Snapshot) -> None:
        if field is None or self.scales.melting is None:
            return
        if kind == "state" and snapshot.dimension == 2:
            for level in np.arange(THIN_STEP, self.scales.temperature[1], THIN_STEP):
                lines = field.lines(level)
                self._line(lines, snapshot, 1.4, (0.15, 0.15, 0.15))
                if level < self.scales.melting:
                    self._label(lines, level)
        melting = field.lines(self.scales.melting)
        self._line(melting, snapshot, 6.0, (1.0, 1.0, 1.0))
        self._line(melting, snapshot, 3.0, (0.0, 0.0, 0.0))

    def _line(
        self, lines: list[np.ndarray], snapshot: Snapshot, width: float, colour: tuple[float, ...]
    ) -> None:
        import pyvista as pv

        if not lines:
            return
        points = np.zeros((sum(len(line) for line in lines), 3))
        flat = np.concatenate(lines)
        points[:, 0], points[:, snapshot.dimension - 1] = flat[:, 0], flat[:, 1]
        points += snapshot.spacing * (1.0 + 0.05 * (6.0 - width)) * self.frame.towards
        cells, start = [], 0
        for line in lines:
            cells += [len(line), *range(start, start + len(line))]
            start += len(line)
        self.plotter.add_mesh(
            pv.PolyData(points, lines=np.array(cells)),
            color=colour,
            line_width=width,
            lighting=False,
            render=False,
        )

    def _label(self, lines: list[np.ndarray], level: float) -> None:
        """Write ``level`` where the longest of ``lines`` is lowest."""
        if not lines:
            return
        line = max(lines, key=len)
        lowest = line[np.argmin(line[:, 1])]
        x, y = self.frame.pixels(np.array([[*lowest, 0.0]]))[0]
        x = float(np.clip(x, 2.5 * MARGIN, self.frame.window[0] - 2.5 * MARGIN))
        if np.ptp(line[:, 0]) * self.frame.scale > LABELLED:
            draw_text(self.plotter, f"{level:.0f} K", (x, y - 13), 22, "centre", backed=True)

    def _surround(self, kind: str, snapshot: Snapshot) -> None:
        wide, high = self.frame.window
        plotter, text_line = self.plotter, high - HEADER + 22
        draw_text(plotter, self.title, (MARGIN, text_line), bold=True)
        draw_text(
            plotter, self.clock.text(snapshot.time), (wide - MARGIN, text_line), side="right", bold=True
        )
        long = self.scale_bar * self.frame.scale
        legend = key(kind, self.scales, snapshot.dimension)
        draw_key(plotter, legend, MARGIN, FOOTER - 92, wide - 2 * MARGIN - long - 60)
        draw_scale_bar(plotter, self.scale_bar, self.frame.scale, wide - MARGIN, FOOTER - 84)


def png(pixels: np.ndarray) -> bytes:
    """``pixels``, uint8, shape [height, width, 3], as the bytes of a PNG."""
    import io

    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", compress_level=4)
    return buffer.getvalue()


def visible(snapshots: list[Snapshot]) -> np.ndarray:
    """The points [m], shape [n, dimension], that all pictures must show; high spatter is moved in."""
    first = snapshots[0].arrays["position"]
    low, high = first.min(axis=0), first.max(axis=0)
    reach = HEADROOM * float(high[-1] - low[-1])
    points = np.concatenate([snapshot.arrays["position"] for snapshot in snapshots])
    if snapshots[0].dimension == 3:
        points = points[points[:, 1] >= 0.0]  # the half in front is cut away
    return np.clip(points, low - reach, high + reach)


def scales(folder: Path, config: Config, snapshots: list[Snapshot]) -> Scales:
    """The colour scales that hold for all of ``snapshots``."""
    import json

    low = config.ambient_temperature
    hottest = max(float(np.percentile(s.arrays["temperature"], 99.9)) for s in snapshots)
    high = 500.0 * np.ceil(max(hottest, low + 200.0) / 500.0)
    fastest = max(float(np.percentile(np.linalg.norm(s.arrays["velocity"], axis=1), 99.9)) for s in snapshots)
    materials = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))["materials"]
    melting = [0.5 * (m["solidus_K"] + m["liquidus_K"]) for m in materials if m["solidus_K"] is not None]
    return Scales(
        temperature=config.output.temperature_range or (low, float(high)),
        speed=round_up(fastest),
        materials=tuple(m["name"] for m in materials),
        tracers=max(int(s.arrays["tracer"].max()) for s in snapshots),
        melting=melting[0] if melting else None,
    )
