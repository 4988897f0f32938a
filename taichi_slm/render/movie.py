"""A run as a film: every snapshot, one MP4 or GIF for each kind of picture."""

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichi_slm.output.atomic import make_folder, storage_error, write_bytes
from taichi_slm.output.snapshots import read_snapshot
from taichi_slm.render.views import Studio, open_run

FRAMES_PER_SECOND = 12
GIF_BYTES = 2_000_000  # a GIF larger than this is made again, narrower
GIF_WIDTHS = (800, 640, 500, 400, 320)  # tried in turn [px]
GIF_COLOURS = 192


def film_run(folder: Path, images: Sequence[str] | None = None, gif: bool = False) -> list[Path]:
    """Film the run in ``folder`` into renders/KIND.mp4, or .gif; ``images`` replaces output.images. Returns the files.

    A ``gif`` is as wide as 2 MB let it be; the narrowest is written whatever its size.
    """
    config, kinds, series = open_run(folder, images)
    snapshots = [read_snapshot(path) for path in series]
    make_folder(folder / "renders")
    studio = Studio(folder, config, snapshots)
    files = [folder / "renders" / f"{kind}.{'gif' if gif else 'mp4'}" for kind in kinds]
    films: list[Any] = [(_Gif if gif else _Mp4)(path) for path in files]
    try:
        for snapshot in snapshots:
            for film, (_, image) in zip(films, studio.draw(snapshot, kinds), strict=True):
                film.add(image)
        for film in films:
            film.finish()
    except OSError as error:
        raise storage_error("write into", folder / "renders", error) from error
    finally:
        studio.close()
    return files


class _Mp4:
    """Frames go to the encoder at once, and the file gets its name when it is whole."""

    def __init__(self, path: Path) -> None:
        import imageio.v2 as imageio

        self.path, self.part = path, path.with_suffix(".part.mp4")
        try:
            self.writer = imageio.get_writer(self.part, fps=FRAMES_PER_SECOND, macro_block_size=2)
        except OSError as error:
            raise storage_error("write", path, error) from error

    def add(self, image: np.ndarray) -> None:
        """Append a frame, uint8, shape [height, width, 3]."""
        self.writer.append_data(image)

    def finish(self) -> None:
        """Close the file."""
        self.writer.close()
        os.replace(self.part, self.path)


class _Gif:
    """Frames are kept, at the largest width, until the width is known that fits."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.frames: list[Any] = []

    def add(self, image: np.ndarray) -> None:
        """Append a frame, uint8, shape [height, width, 3]."""
        from PIL import Image

        self.frames.append(_narrowed(Image.fromarray(image), GIF_WIDTHS[0]))

    def finish(self) -> None:
        """Write the file."""
        write_bytes(self.path, fitting(self.frames))


def fitting(frames: list[Any]) -> bytes:
    """``frames``, PIL images in RGB of one size, as a GIF as wide as GIF_BYTES lets it be."""
    for width in GIF_WIDTHS:
        data = animation([_narrowed(frame, width) for frame in frames])
        if len(data) <= GIF_BYTES:
            break
    return data


def animation(frames: list[Any]) -> bytes:
    """``frames``, PIL images in RGB of one size, as an endless GIF with one palette for all."""
    from PIL import Image

    wide, high = (max(1, side // 3) for side in frames[0].size)  # a ninth of the pixels shows the colours
    some = frames[:: max(1, len(frames) // 8)][-9:]
    strip = Image.new("RGB", (wide, high * len(some)))
    for number, frame in enumerate(some):
        strip.paste(frame.resize((wide, high), Image.Resampling.NEAREST), (0, number * high))
    palette = strip.quantize(GIF_COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=2)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    buffer = io.BytesIO()
    drawn[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=drawn[1:],
        loop=0,
        duration=1000 // FRAMES_PER_SECOND,
    )
    return buffer.getvalue()


def _narrowed(image: Any, width: int) -> Any:
    from PIL import Image

    if image.width <= width:
        return image
    return image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
