#!/usr/bin/env python3
"""Write docs/paper_figures.md and docs/images/paper/ from finished runs: ``python scripts/paper_figures.py RUNS``.

RUNS is a folder of run folders of the shipped scenes; of several runs of one the newest counts. Each figure of the
paper that shows a result is made again, with what agrees and what does not; every number in these sentences is
computed from the runs.
"""

import argparse
import io
import sys
from collections.abc import Callable
from pathlib import Path

import paper_curves
import paper_pictures
from make_results import Run, find_runs, shrink, tidy
from paper_sheet import Figure
from PIL import Image

from taichi_slm.errors import SlmError
from taichi_slm.output.atomic import make_folder, write_bytes, write_text

WIDTH = 1100  # of the pictures [px]
HEAD = """# The paper's figures

Figures 3 and 5 to 13 of Russell, Souto-Iglesias and Zohdi (2018), made again by
`python scripts/paper_figures.py {runs}` from runs of version {version} ({git}). The paper's own pictures are
not shown here; have them beside this page. What is said of agreement was judged by eye and by the numbers, which are
computed from the runs. In 2-D the beam is a line source, in the paper as here. The absorptivity of the tracks is not in
the paper, and its beam width and powder size can be read in two ways: [tracks.md](tracks.md) says what was chosen.
"""
MAKERS: list[tuple[tuple[str, ...], Callable[..., list[Figure]]]] = [
    (("droplet_thermal_cycle",), paper_curves.drop),
    (("column_two_fluids",), paper_curves.column),
    (("spot_weld_3ms",), paper_pictures.weld),
    (("track_150W",), paper_pictures.track),
    (("track_tracers",), paper_pictures.tracers),
    (("track_50W", "track_100W", "track_150W", "track_200W"), paper_pictures.powers),
    (("track_100W", "track_doped"), paper_pictures.doped),
]


def make(runs: dict[str, Run]) -> list[Figure]:
    """The figures that ``runs``, by scene, allow; a scene that is missing is named on stderr."""
    figures: list[Figure] = []
    for scenes, maker in MAKERS:
        missing = [scene for scene in scenes if scene not in runs]
        if missing:
            print(f"left out: {maker.__doc__} needs a run of {', '.join(missing)}", file=sys.stderr)
            continue
        given = [runs[scene] for scene in scenes]
        figures += maker(given[0] if len(given) == 1 else given)
    return sorted(figures, key=lambda figure: figure.number)


def write(runs_folder: Path, docs: Path) -> None:
    """Write ``docs``/paper_figures.md and its pictures."""
    runs = {run.scene: run for run in find_runs(runs_folder)}
    figures = make(runs)
    if not figures:
        raise SystemExit(f"no finished run of a scene of the paper in {runs_folder}")
    facts = figures[0].runs[0].facts
    lines = [HEAD.format(runs=tidy(str(runs_folder)), version=facts["version"], git=facts["git"][:12])]
    make_folder(docs / "images" / "paper")
    total = 0
    for figure in figures:
        name = f"figure_{figure.number:02d}.png"
        data = png(figure)
        total += len(data)
        write_bytes(docs / "images" / "paper" / name, data)
        lines += ["", f"## Figure {figure.number}", ""]
        lines += [f"    {run.command}" for run in figure.runs]
        lines += ["", f"![{figure.about}](images/paper/{name})", "", f"*{figure.about}.*", ""]
        lines += [f"**Agrees.** {figure.agrees}", "", f"**Differs, or is open.** {figure.differs}"]
    write_text(docs / "paper_figures.md", "\n".join(lines) + "\n")
    print(f"{docs / 'paper_figures.md'}: {len(figures)} figures, {total / 1e6:.1f} MB")


def png(figure: Figure) -> bytes:
    """The picture of ``figure``, at most :data:`WIDTH` wide, with a palette of its own unless it is smooth."""
    buffer = io.BytesIO()
    if figure.smooth:
        image = figure.image
        image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS).save(
            buffer, format="PNG", optimize=True
        )
        return buffer.getvalue()
    figure.image.save(buffer, format="PNG")
    buffer.seek(0)
    return shrink(buffer, WIDTH)


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
