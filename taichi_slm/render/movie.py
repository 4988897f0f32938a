"""A run as a film: every snapshot, one MP4 for each kind of picture."""

import os
from collections.abc import Sequence
from pathlib import Path

from taichi_slm.config.load import load_config
from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import make_folder, storage_error
from taichi_slm.output.snapshots import read_series, read_snapshot
from taichi_slm.render.views import Studio

FRAMES_PER_SECOND = 12


def film_run(folder: Path, images: Sequence[str] | None = None) -> list[Path]:
    """Film the run in ``folder`` into renders/KIND.mp4; ``images`` replaces output.images. Returns the files."""
    import imageio.v2 as imageio

    config = load_config(folder / "config.resolved.yaml").config
    snapshots = [read_snapshot(path) for _, path in read_series(folder / "snapshots.pvd")]
    if not snapshots:
        raise StorageError(f"{folder} has no snapshots to film")
    kinds = list(config.output.images if images is None else images)
    make_folder(folder / "renders")
    studio = Studio(folder, config, snapshots)
    files = [folder / "renders" / f"{kind}.mp4" for kind in kinds]
    unfinished = [path.with_suffix(".part.mp4") for path in files]
    try:
        writers = {
            kind: imageio.get_writer(path, fps=FRAMES_PER_SECOND, macro_block_size=2)
            for kind, path in zip(kinds, unfinished, strict=True)
        }
        for snapshot in snapshots:
            for kind, image in studio.draw(snapshot, kinds):
                writers[kind].append_data(image)
        for writer in writers.values():
            writer.close()
        for path, final in zip(unfinished, files, strict=True):
            os.replace(path, final)
    except OSError as error:
        raise storage_error("write into", folder / "renders", error) from error
    finally:
        studio.close()
    return files
