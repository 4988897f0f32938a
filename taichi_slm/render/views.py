"""Pictures of a run from its folder alone: one plotter, one camera, the same colours from first to last."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from taichi_slm.config.load import load_config
from taichi_slm.config.schema import ONLY_3D, Config, Picture
from taichi_slm.errors import ConfigError, StorageError
from taichi_slm.output.atomic import make_folder, write_bytes
from taichi_slm.output.snapshots import Snapshot, read_series, read_snapshot, spread
from taichi_slm.render.frame import FOOTER, HEADER, MARGIN, Frame, corners, frame
from taichi_slm.render.inside import Region, draw_inside
from taichi_slm.render.isotherm import PlaneField, draw_isotherms, smooth
from taichi_slm.render.overlay import draw_key, draw_scale_bar, draw_text, set_dots
from taichi_slm.render.paint import ALMOST, Scales, key, paint, round_length, round_up, surface_acceleration
from taichi_slm.render.particles import Particles, draw_arrows

FINE = 2  # dots along a pixel where edges are smoothed: it is the mean of four, in half the time of multisampling
HEADROOM = 0.45  # how far above the first picture's top a frame reaches at most, as a share of its height


def render_run(
    folder: Path, images: Sequence[str] | None = None, share: int = 0, shares: int = 1
) -> list[Path]:
    """Draw the pictures of the run in ``folder`` into its renders/; ``images`` replaces output.images.

    Reads config.resolved.yaml, provenance.json and the snapshots, nothing else. Returns the files, in order.
    Of ``shares`` processes at work on one run, this is number ``share``: every picture is drawn by one of them.
    """
    config, kinds, series = open_run(folder, images)
    chosen = spread(series, config.output.images_at_most)
    if not kinds or not chosen:
        return []
    snapshots = [read_snapshot(path) for path in chosen]
    studio = Studio(folder, config, snapshots)
    make_folder(folder / "renders")
    files = []
    for path, snapshot in list(zip(chosen, snapshots, strict=True))[share::shares]:
        files += studio.shoot(snapshot, kinds, path.stem)
    studio.close()
    return files


def open_run(folder: Path, images: Sequence[str] | None = None) -> tuple[Config, list[str], list[Path]]:
    """Config, kinds of pictures and snapshots of the run in ``folder``; ``images`` replaces output.images.

    A run without snapshots is a StorageError; a kind that does not exist, or not for this run, a ConfigError.
    """
    config = load_config(folder / "config.resolved.yaml").config
    series = [path for _, path in read_series(folder / "snapshots.pvd")]
    if not series:
        raise StorageError(f"{folder} has no snapshots to draw")
    kinds: list[str] = list(config.output.images if images is None else images)
    for kind in kinds:
        if kind not in get_args(Picture):
            raise ConfigError(f"no picture is called '{kind}'; there are {', '.join(get_args(Picture))}")
        if kind in ONLY_3D and config.dimension == 2:
            raise ConfigError(f"a picture '{kind}' exists in 3-D only, and {folder} is a run in 2-D")
        if kind == "surface_force" and not config.physics.surface_tension:
            raise ConfigError(f"a picture '{kind}' shows surface tension, which is off in {folder}")
    return config, kinds, series


def open_plotter(window: tuple[int, int]) -> Any:
    """A plotter with a white, empty window of so many pixels, off-screen."""
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkLogger

    # VTK warns of a missing display, then does without
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    plotter: Any = pv.Plotter(off_screen=True, window_size=list(window), lighting="none")
    plotter.add_light(pv.Light(light_type="headlight", intensity=0.9))  # for meshes that ask for it
    plotter.renderer.SetBackground(1.0, 1.0, 1.0)
    return plotter


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
    """The plotter and all that stays the same through a run.

    A ``box`` [m], shape [2, dimension], lower and upper corner, makes close-ups of what is in it.
    """

    def __init__(
        self, folder: Path, config: Config, snapshots: list[Snapshot], box: np.ndarray | None = None
    ) -> None:
        self.folder, self.config = folder, config
        self.title = config.title or folder.resolve().name
        self.clock = Clock.for_end(config.time.end)
        self.box = box
        snapshots = [self._boxed(snapshot) for snapshot in snapshots]
        self.scales = scales(folder, config, snapshots)
        points = visible(snapshots) if box is None else corners(*box)
        self.whole = frame(points, 0.6 * config.spacing)
        self.region: Region | None = None
        self.close_up: dict[str, Frame] = {}
        if config.dimension == 3 and self.scales.melting is not None:
            self.region = Region.of(snapshots, config.spacing)
            self.close_up = {kind: self.region.frame(kind) for kind in ONLY_3D}
            self.scales = replace(self.scales, height=(self.region.molten[0][2], self.region.molten[1][2]))
        self.plotter = open_plotter(self.whole.window)

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
        particles, field = None, None
        snapshot = self._boxed(snapshot)
        for kind in kinds:
            plotter, view = self.plotter, self.close_up.get(kind, self.whole)
            plotter.clear_actors()
            # The balls of a 3-D scene take their time by the dot.
            dots = FINE if snapshot.dimension == 2 or kind in ONLY_3D else 1
            plotter.render_window.SetMultiSamples(0)
            set_dots(plotter, dots)
            window = [dots * pixels for pixels in view.window]
            if plotter.window_size != window:  # to set it draws a whole picture
                plotter.window_size = window
            if kind in ONLY_3D:
                if self.region is None:
                    raise ConfigError(f"a picture '{kind}' shows melt, and nothing in {self.folder} can melt")
                draw_inside(kind, plotter, snapshot, self.region, view, self.scales)
            else:
                if kind == "surface_force" and kind not in snapshot.arrays:
                    raise ConfigError(f"the snapshots of {self.folder} have no surface_force: run it anew")
                if particles is None:
                    particles, field = (
                        Particles(snapshot, snapshot.spacing * view.scale),
                        self._field(snapshot),
                    )
                particles.draw(plotter, paint(kind, snapshot, self.scales))
                if kind in ("velocity", "surface_force") and snapshot.dimension == 2:
                    self._arrows(kind, snapshot, view)
                if field is not None:
                    thin = kind == "state" and snapshot.dimension == 2
                    draw_isotherms(plotter, field, view, snapshot.spacing, self.scales, thin)
            self._surround(kind, snapshot, view)
            view.aim(plotter, distance=20.0 * float(np.ptp(snapshot.arrays["position"], axis=0).max()))
            plotter.render()
            yield kind, shrunk(plotter.screenshot(return_img=True), dots)

    def _arrows(self, kind: str, snapshot: Snapshot, view: Frame) -> None:
        along, longest = snapshot.arrays["velocity"], self.scales.speed
        if kind == "surface_force":
            along, longest = surface_acceleration(snapshot), self.scales.force
        moving = snapshot.arrays["liquid_fraction"] > ALMOST
        position = snapshot.arrays["position"][moving]
        draw_arrows(self.plotter, position, along[moving], view, snapshot.spacing, longest)

    def _boxed(self, snapshot: Snapshot) -> Snapshot:
        """What of ``snapshot`` is in the box of a close-up; all of it where there is none."""
        if self.box is None:
            return snapshot
        position = snapshot.arrays["position"]
        keep = ((position >= self.box[0]) & (position <= self.box[1])).all(axis=1)
        return replace(snapshot, arrays={name: values[keep] for name, values in snapshot.arrays.items()})

    def _field(self, snapshot: Snapshot) -> PlaneField | None:
        if self.scales.melting is None:
            return None
        above = self.scales.temperature[0] + 100.0
        return smooth(snapshot.arrays["position"], snapshot.arrays["temperature"], snapshot.spacing, above)

    def _surround(self, kind: str, snapshot: Snapshot, view: Frame) -> None:
        wide, high = view.window
        plotter, text_line = self.plotter, high - HEADER + 22
        draw_text(plotter, self.title, (MARGIN, text_line), bold=True)
        draw_text(
            plotter, self.clock.text(snapshot.time), (wide - MARGIN, text_line), side="right", bold=True
        )
        bar = round_length(0.2 * (wide - 2 * MARGIN) / view.scale)
        long = bar * view.scale
        legend = key(kind, self.scales, snapshot.dimension)
        draw_key(plotter, legend, MARGIN, FOOTER - 92, wide - 2 * MARGIN - long - 60)
        draw_scale_bar(plotter, bar, view.scale, wide - MARGIN, FOOTER - 84)


def shrunk(image: np.ndarray, dots: int) -> np.ndarray:
    """``image``, uint8, with the mean of ``dots`` times ``dots`` for a pixel."""
    from PIL import Image

    return np.asarray(Image.fromarray(image).reduce(dots)) if dots > 1 else image


def png(pixels: np.ndarray) -> bytes:
    """``pixels``, uint8, shape [height, width, 3], as the bytes of a PNG."""
    import io

    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", compress_level=2)
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
    melts = [s.arrays["liquid_fraction"] >= 0.5 for s in snapshots]
    hottest = max(
        float(np.percentile(s.arrays["temperature"][melt if melt.any() else slice(None)], 99.5))
        for s, melt in zip(snapshots, melts, strict=True)
    )
    high = 500.0 * np.ceil(max(hottest, low + 200.0) / 500.0)
    fastest = max(float(np.percentile(np.linalg.norm(s.arrays["velocity"], axis=1), 99.9)) for s in snapshots)
    flow = [
        np.linalg.norm(s.arrays["velocity"][melt], axis=1) for s, melt in zip(snapshots, melts, strict=True)
    ]
    everyday = np.concatenate(flow)
    pulls = [
        np.linalg.norm(surface_acceleration(s)[melt], axis=1)
        for s, melt in zip(snapshots, melts, strict=True)
        if "surface_force" in s.arrays
    ]
    pulled = np.concatenate([*pulls, np.zeros(0)])
    pulled = pulled[pulled > 0.0]
    materials = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))["materials"]
    melting = [0.5 * (m["solidus_K"] + m["liquidus_K"]) for m in materials if m["solidus_K"] is not None]
    return Scales(
        temperature=config.output.temperature_range or (low, float(high)),
        speed=round_up(fastest),
        flow=round_up(float(np.percentile(everyday, 80.0)) if len(everyday) else 0.0),
        force=round_up(float(np.percentile(pulled, 90.0)) if len(pulled) else 0.0),
        materials=tuple(m["name"] for m in materials),
        tracers=max(int(s.arrays["tracer"].max()) for s in snapshots),
        melting=melting[0] if melting else None,
    )
