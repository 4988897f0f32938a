#!/usr/bin/env python3
"""Write docs/results.md and docs/images/ from finished runs: ``python scripts/make_results.py RUNS``.

RUNS is a folder of run folders. Of several runs of one config the newest counts. The layout depends on the
runs alone: the same folders give the same bytes.
"""

import argparse
import io
import os
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from taichi_slm.errors import SlmError
from taichi_slm.output.atomic import make_folder, write_bytes, write_text
from taichi_slm.output.history import read_history
from taichi_slm.output.snapshots import read_series
from taichi_slm.render.views import Clock
from taichi_slm.run.progress import clock
from taichi_slm.run.run_folder import RunFolder, read_json

MOST_BYTES = 6_000_000  # of all pictures together
WIDTHS = (1200, 1000, 800, 640, 500)  # tried in turn until they fit [px]
COLOURS = 256
HEAD = """# Results

Made by `python scripts/make_results.py {runs}` from runs of version {version} ({git}) on {machine}.
Every row is one command, printed above its pictures. Wall times are of that machine, compiling and output
included. Sizes of the pool are the largest it ever had. In 2-D the beam is a line source.
"""


@dataclass(frozen=True)
class Run:
    """One finished run."""

    folder: RunFolder
    facts: dict[str, Any]
    summary: dict[str, Any]

    @property
    def scene(self) -> str:
        """Name of the config."""
        return Path(self.facts["config"]).stem

    @property
    def command(self) -> str:
        """What was typed, without the paths of one machine."""
        words = ["taichi-slm", *(tidy(word) for word in self.facts["argv"][1:])]
        return shlex.join(words)


def find_runs(folder: Path) -> list[Run]:
    """The newest finished run of each config in ``folder``, by name."""
    newest: dict[str, Run] = {}
    for path in sorted(folder.iterdir()):
        if not (path / "summary.json").is_file():
            continue
        run = Run(RunFolder.open(path), read_json(path / "provenance.json"), read_json(path / "summary.json"))
        if run.summary["status"] != "done":
            print(f"left out: {path} is {run.summary['status']}", file=sys.stderr)
        elif run.scene not in newest or run.facts["started"] >= newest[run.scene].facts["started"]:
            newest[run.scene] = run
    return [newest[scene] for scene in sorted(newest)]


def table(runs: list[Run]) -> list[str]:
    """The accounts of every run, a row each."""
    names = (
        "scene", "particles", "steps", "wall time", "largest T [K]", "largest speed [m/s]",
        "pool length [µm]", "pool width [µm]", "pool depth [µm]", "energy error", "mass error", "removed",
    )  # fmt: skip
    rows = []
    for run in runs:
        s = run.summary
        pool = s["melt_pool"]
        rows.append(
            [
                f"[{run.scene}](#{run.scene.lower()})",
                f"{s['particles']:,}",
                f"{s['steps']:,}",
                clock(s["wall_time_s"]),
                _number(s["max_temperature_K"], ",.0f"),
                _number(s["max_speed_m_s"], ".2f"),
                *(_micrometres(pool[key]) for key in ("length_m", "width_m", "depth_m")),
                _number(s["energy"]["relative_error"], ".1e"),
                _number(s["mass"]["relative_error"], ".1e"),
                f"{s['mass'].get('removed', 0):,}",
            ]
        )
    return _markdown(names, rows)


def tracks(runs: list[Run]) -> list[str]:
    """What solidified again, for the runs that melted anything."""
    names = (
        "scene", "track length [µm]", "width [µm]", "depth below the plate [µm]", "height [µm]",
        "roughness [µm]", "pieces", "powder never melted",
    )  # fmt: skip
    rows = []
    for run in runs:
        track = run.summary["melt_pool"]["track"]
        if track["particles"]:
            keys = ("length_m", "width_m", "depth_m", "mean_height_m", "roughness_m")
            sizes = [_micrometres(track[key]) for key in keys]
            rows.append([run.scene, *sizes, str(track["pieces"]), f"{track['unmelted_powder']:,}"])
    return ["", "## Tracks after solidification", "", *_markdown(names, rows)] if rows else []


def pictures(run: Run) -> list[tuple[Path, str]]:
    """The pictures worth a place, with captions: at the largest pool and at the end; others at both ends."""
    times = [time for time, _ in read_series(run.folder.series)]
    history = read_history(run.folder.history)
    pool = history["melt_length_m"]
    largest = float(history["time_s"][np.nanargmax(pool)]) if np.nanmax(pool) > 0.0 else times[-1]
    stamp = Clock.for_end(times[-1])
    chosen = []
    for kind in ("state", "temperature", "velocity", "tracer", "material"):
        files = {int(path.stem.split("_")[-1]): path for path in run.folder.renders.glob(f"{kind}_*.png")}
        if not files:
            continue
        at_largest = min(files, key=lambda k: (abs(times[k] - largest), k))
        ends = [min(files), max(files)] if kind in ("tracer", "material") else [at_largest, max(files)]
        for index in dict.fromkeys(ends if kind != "temperature" else ends[:1]):
            chosen.append((files[index], f"{kind}, {stamp.text(times[index])}"))
    return chosen


def shrink(source: Path | io.BytesIO, width: int) -> bytes:
    """The picture at most ``width`` [px] wide, with a palette of its own, as the bytes of a PNG."""
    image = Image.open(source).convert("RGB")
    if image.width > width:
        image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    palette = image.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=2, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    palette.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def write(runs_folder: Path, docs: Path) -> None:
    """Write ``docs``/results.md and the pictures beside it."""
    runs = find_runs(runs_folder)
    if not runs:
        raise SystemExit(f"no finished run in {runs_folder}")
    facts = runs[0].facts
    machine = f"{facts['machine']['processor']}, {facts['machine']['cores']} cores"
    head = HEAD.format(
        runs=tidy(str(runs_folder)), version=facts["version"], git=facts["git"][:12], machine=machine
    )
    lines = [head, *table(runs), *tracks(runs)]
    wanted: dict[str, Path] = {}
    for run in runs:
        lines += ["", f"## {run.scene}", "", f"    {run.command}"]
        for source, caption in pictures(run):
            name = f"{run.scene}_{source.name}"
            wanted[name] = source
            lines += ["", f"![{run.scene}: {caption}](images/{name})", "", f"*{caption}*"]
    for width in WIDTHS:
        images = {name: shrink(source, width) for name, source in wanted.items()}
        total = sum(map(len, images.values()))
        if total <= MOST_BYTES:
            break
    make_folder(docs / "images")
    for run in runs:  # pictures of an older run of the same scene
        for old in docs.glob(f"images/{run.scene}_*.png"):
            if old.name not in images:
                old.unlink()
    for name, data in images.items():
        write_bytes(docs / "images" / name, data)
    write_text(docs / "results.md", "\n".join(lines) + "\n")
    size = f"{len(images)} pictures, {total / 1e6:.1f} MB, {width} px wide"
    print(f"{docs / 'results.md'}: {len(runs)} runs, {size}")


def _markdown(names: tuple[str, ...], rows: list[list[str]]) -> list[str]:
    lines = [names, ("---", *("---:" for _ in names[1:])), *rows]
    return ["| " + " | ".join(line) + " |" for line in lines]


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _micrometres(value: float | None) -> str:
    return "-" if value is None else f"{1e6 * value:.1f}"


def tidy(word: str) -> str:
    """An absolute path relative to the working directory, or its last part; anything else as it is."""
    if not os.path.isabs(word):
        return word
    relative = os.path.relpath(word)
    return Path(word).name if relative.startswith("..") else relative


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
