#!/usr/bin/env python3
"""Write docs/gallery.md and docs/images/gallery/ from finished runs: ``python scripts/gallery.py RUNS``.

RUNS is a folder of run folders of the shipped scenes; of several runs of one the newest counts. One picture of each
scene, and two films. The runs are only read.
"""

import argparse
import io
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from make_results import Run, find_runs, shrink, tidy
from PIL import Image

from taichi_slm.config.load import load_config
from taichi_slm.errors import SlmError
from taichi_slm.output.atomic import make_folder, write_bytes, write_text
from taichi_slm.output.snapshots import read_series, read_snapshot
from taichi_slm.render.movie import fitting
from taichi_slm.render.views import Studio

WIDTH = 1000  # of the pictures [px]
SMOOTH = ("cut", "isosurface", "streamlines")  # of more colours than a palette has
TRACK = ((0.0, -90e-6), (1.2e-3, 95e-6))  # what is shown of a 2-D track [m]
HEAD = """# Gallery

Made by `python scripts/gallery.py {runs}` from runs of version {version} ({git}). Above each picture stands the
command that makes the run; `taichi-slm render RUN --kind KIND` makes its pictures of the kind that is named, and
`--movie` or `--gif` the films.
"""


@dataclass(frozen=True)
class Picture:
    """One picture of the gallery, or a film."""

    scene: str
    kind: str
    time: float  # [s]; for a film, its last moment
    caption: str
    box: tuple[tuple[float, float], tuple[float, float]] | None = None  # of a close-up [m]
    film: bool = False


PICTURES = [
    Picture("track_150W", "state", 9.0, "the track melts, necks and freezes", TRACK, film=True),
    Picture("spot_weld_3ms", "cut", 5e-3, "the weld in section, while the beam is on and after", film=True),
    Picture("spot_weld_3ms", "streamlines", 2.75e-3, "melt rises in the middle and turns at the rim"),
    Picture("track_3d", "isosurface", 0.2e-3, "the melting surface, cut free; the beam moves to the right"),
    Picture("track_3d", "cut", 0.2e-3, "the same pool in section"),
    Picture(
        "track_50W", "state", 0.26e-3, "too little power: the grains melt in part, the plate does not", TRACK
    ),
    Picture("track_100W", "temperature", 0.26e-3, "just enough: a calm pool", TRACK),
    Picture(
        "track_150W",
        "velocity",
        0.24e-3,
        "Marangoni flow runs away from the hot spot, both ways",
        ((0.30e-3, -60e-6), (0.72e-3, 90e-6)),
    ),
    Picture("track_200W", "state", 0.40e-3, "too much: a ragged front and a deep pool", TRACK),
    Picture("track_tracers", "tracer", 0.52e-3, "the metal of every fourth grain", TRACK),
    Picture("track_doped", "material", 9.0, "grains of twice the conductivity stay in streaks", TRACK),
    Picture(
        "track_316L_physical", "temperature", 0.3e-3, "measured properties of 316L, with evaporation", TRACK
    ),
    Picture("droplet_thermal_cycle", "velocity", 9.0, "a drop breathes with its temperature"),
    Picture("column_two_fluids", "tracer", 9.0, "the lower fluid has expanded and lifted the upper one"),
]


def draw(run: Run, picture: Picture) -> bytes:
    """``picture`` of ``run`` as the bytes of a PNG or a GIF."""
    config = load_config(run.folder.resolved).config
    series = read_series(run.folder.series)
    snapshots = [read_snapshot(path) for _, path in series]
    times = np.array([time for time, _ in series])
    box = None if picture.box is None else np.array(picture.box)
    chosen = int(np.argmin(np.abs(times - picture.time)))
    studio = Studio(run.folder.path, config, snapshots, box)
    wanted = snapshots[: chosen + 1] if picture.film else [snapshots[chosen]]
    frames = [Image.fromarray(pixels) for s in wanted for _, pixels in studio.draw(s, [picture.kind])]
    studio.close()
    if picture.film:
        return fitting(frames)
    buffer = io.BytesIO()
    image = frames[0]
    if picture.kind in SMOOTH:
        high = round(image.height * WIDTH / image.width)
        image.resize((WIDTH, high), Image.Resampling.LANCZOS).save(buffer, format="PNG", optimize=True)
        return buffer.getvalue()
    image.save(buffer, format="PNG")
    buffer.seek(0)
    return shrink(buffer, WIDTH)


def write(runs_folder: Path, docs: Path) -> None:
    """Write ``docs``/gallery.md and its pictures."""
    runs = {run.scene: run for run in find_runs(runs_folder)}
    pictures = [picture for picture in PICTURES if picture.scene in runs]
    if not pictures:
        raise SystemExit(f"no finished run of a shipped scene in {runs_folder}")
    facts = runs[pictures[0].scene].facts
    lines = [HEAD.format(runs=tidy(str(runs_folder)), version=facts["version"], git=facts["git"][:12])]
    make_folder(docs / "images" / "gallery")
    total = 0
    for picture in pictures:
        run = runs[picture.scene]
        name = f"{picture.scene}_{picture.kind}.{'gif' if picture.film else 'png'}"
        data = draw(run, picture)
        total += len(data)
        write_bytes(docs / "images" / "gallery" / name, data)
        lines += [
            "",
            f"    {run.command}",
            "",
            f"![{picture.scene}: {picture.caption}](images/gallery/{name})",
            "",
        ]
        lines += [f"*{picture.scene}, {picture.kind}: {picture.caption}.*"]
    write_text(docs / "gallery.md", "\n".join(lines) + "\n")
    print(f"{docs / 'gallery.md'}: {len(pictures)} pictures, {total / 1e6:.1f} MB")


def main() -> int:
    """Read the command line and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, help="a folder of run folders")
    parser.add_argument("--docs", type=Path, default=Path("docs"))
    arguments = parser.parse_args()
    try:
        write(arguments.runs, arguments.docs)
    except SlmError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
