"""What the paper's figures share: a figure with what is said of it, panels of one run, and sheets of panels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from make_results import Run
from PIL import Image, ImageDraw, ImageFont

from taichi_slm.analysis.melt_pool import MeltPool, measure
from taichi_slm.config.load import load_config
from taichi_slm.output.snapshots import Snapshot, read_series, read_snapshot
from taichi_slm.render.frame import FOOTER, HEADER
from taichi_slm.render.views import Clock, Studio
from taichi_slm.scene.beam import BeamPath

TITLE, GAP = 44, 10  # height of a panel's title, space below it [px]
FONT = 30


@dataclass(frozen=True)
class Figure:
    """One figure of the paper, made again."""

    number: int
    about: str  # what it shows
    image: Image.Image
    runs: list[Run]
    agrees: str
    differs: str
    smooth: bool = False  # of more colours than a palette has


class Film:
    """The snapshots of a run, by time, and what is measured in them."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.config = load_config(run.folder.resolved).config
        self.series = read_series(run.folder.series)
        self.times = np.array([time for time, _ in self.series])
        material = run.facts["materials"][0]
        self.melting = 0.5 * (material["solidus_K"] + material["liquidus_K"])
        assert self.config.laser is not None
        self.beam = BeamPath(self.config.laser, self.config.dimension)

    def at(self, time: float) -> Snapshot:
        """The snapshot nearest to ``time`` [s]."""
        return read_snapshot(self.series[int(np.argmin(np.abs(self.times - time)))][1])

    @property
    def last(self) -> Snapshot:
        """The end of the run."""
        return read_snapshot(self.series[-1][1])

    def pool(self, snapshot: Snapshot) -> MeltPool:
        """The melt pool in ``snapshot``."""
        a = snapshot.arrays
        return measure(a["position"], a["temperature"], a["liquid_fraction"], self.melting, snapshot.spacing)

    def beam_at(self, snapshot: Snapshot) -> float | None:
        """Where the beam is along x [m]; None while it is off."""
        on = self.beam.on_during(snapshot.time, snapshot.time + 1e-12)
        return self.beam.position(snapshot.time)[0] if on else None

    def panels(
        self, kind: str, snapshots: Sequence[Snapshot], box: np.ndarray, name: str = ""
    ) -> tuple[list[tuple[str, Image.Image]], Image.Image]:
        """Pictures of ``kind`` of what is in ``box`` [m], shape [2, 2], with titles; and their key.

        A triangle marks the beam. All are in the same colours and to the same scale.
        """
        studio = Studio(self.run.folder.path, self.config, list(snapshots), box)
        clock = Clock.for_end(self.config.time.end)
        found = []
        for snapshot in snapshots:
            ((_, pixels),) = studio.draw(snapshot, [kind])
            panel = Image.fromarray(pixels[HEADER:-FOOTER])
            beam = self.beam_at(snapshot)
            if beam is not None:
                x = float(studio.whole.pixels(np.array([[beam, 0.0, 0.0]]))[0, 0])
                ImageDraw.Draw(panel).polygon([(x - 13, 0), (x + 13, 0), (x, 22)], fill=(200, 30, 30))
            found.append((f"{name}{clock.text(snapshot.time)}", panel))
        studio.close()
        return found, Image.fromarray(pixels[-FOOTER:])


def sheet(panels: Sequence[tuple[str, Image.Image]], key: Image.Image | None = None) -> Image.Image:
    """``panels``, pictures with titles, below one another, lettered if there are several; ``key`` at the foot."""
    wide = max(picture.width for _, picture in panels)
    high = sum(picture.height + TITLE + GAP for _, picture in panels) + (key.height if key else 0)
    paper = Image.new("RGB", (wide, high), "white")
    pen, font, y = ImageDraw.Draw(paper), ImageFont.load_default(FONT), 0
    for number, (title, picture) in enumerate(panels):
        letter = f"{chr(ord('A') + number)}   " if len(panels) > 1 else ""
        pen.text((40, y + 4), letter + title, fill=(20, 20, 20), font=font)
        paper.paste(picture, (0, y + TITLE))
        y += TITLE + picture.height + GAP
    if key is not None:
        paper.paste(key, (0, y))
    return paper


def under(picture: Image.Image, key: Image.Image) -> Image.Image:
    """``picture`` with ``key`` below it."""
    both = Image.new("RGB", (picture.width, picture.height + key.height), "white")
    both.paste(picture, (0, 0))
    both.paste(key, (0, picture.height))
    return both


def dashed(
    pen: Any, start: tuple[float, float], end: tuple[float, float], fill: tuple[int, int, int]
) -> None:
    """A dashed line between two points [px]."""
    a, b = np.array(start), np.array(end)
    count = max(2, int(np.linalg.norm(b - a) / 12))
    for k in range(0, count, 2):
        pen.line([*(a + (b - a) * k / count), *(a + (b - a) * (k + 1) / count)], fill=fill, width=3)
