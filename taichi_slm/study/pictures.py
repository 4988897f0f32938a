"""A study at a glance: results over what was changed, and the last picture of every run."""

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from taichi_slm.output.atomic import write_bytes
from taichi_slm.study.folder import StudyFolder
from taichi_slm.study.plan import Plan, short

Row = dict[str, Any]
DPI = 120
THUMBNAIL = (640, 400)  # pixels, at most
CAPTION = 28  # pixels
MOST_PICTURES = 100
KINDS = ("state", "temperature")  # the frozen track first


def overview(plan: Plan, rows: list[Row], path: Path) -> bool:
    """Draw the results that ``plan`` wants shown; False, and no picture, where no run has any."""
    shown = [name for name in plan.overview.show if any(_number(row.get(name)) is not None for row in rows)]
    if not shown:
        return False
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    x, by = _axes(plan, rows)
    across = min(3, len(shown))
    down = math.ceil(len(shown) / across)
    figure = Figure(figsize=(4.4 * across, 3.4 * down + 0.4), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    figure.suptitle(plan.title)
    for place, name in enumerate(shown, 1):
        axes = figure.add_subplot(down, across, place)
        if plan.overview.kind == "map" and by is not None:
            _map(figure, axes, rows, x, by, name)
        else:
            _lines(axes, rows, x, by, name)
        axes.set_xlabel(x)
        axes.set_title(name, fontsize=10)
        axes.grid(alpha=0.3)
    stream = io.BytesIO()
    canvas.print_figure(stream, dpi=DPI, format="png")
    write_bytes(path, stream.getvalue())
    return True


def _axes(plan: Plan, rows: list[Row]) -> tuple[str, str | None]:
    """The columns along x and of the colours: as the study says, else the first that vary."""
    varying = (
        [key for key in plan.keys if len({str(row.get(key)) for row in rows}) > 1] or plan.keys or ["seed"]
    )
    x = plan.overview.x or next((key for key in varying if key != plan.overview.by), varying[0])
    rest = [key for key in varying if key != x]
    return x, plan.overview.by or (rest[0] if rest else None)


def _lines(axes: Any, rows: list[Row], x: str, by: str | None, name: str) -> None:
    """Every run a point; a line through the means at one x, per value of ``by``; failed runs are red crosses."""
    place = _places(axes, rows, x)
    series = sorted({_text(row.get(by)) for row in rows}, key=_sorting) if by else [""]
    few = len(series) <= 10
    failed = []
    for each in series:
        found: dict[float, list[float]] = {}
        for row in rows:
            value = _number(row.get(name))
            if value is None or (by and _text(row.get(by)) != each):
                continue
            if row["state"] == "done":
                found.setdefault(place(row), []).append(value)
            else:
                failed.append((place(row), value))
        points = [(at, value) for at in sorted(found) for value in found[at]]
        if not points:
            continue
        (drawn,) = axes.plot(*zip(*points, strict=True), "o", ms=4, color=None if few else "tab:blue")
        if few:
            means = [(at, sum(found[at]) / len(found[at])) for at in sorted(found)]
            axes.plot(*zip(*means, strict=True), "-", lw=1, color=drawn.get_color(), label=each)
    if failed:
        axes.plot(*zip(*failed, strict=True), "x", color="tab:red", label="not done")
    if axes.get_legend_handles_labels()[0] and (failed or (by and few)):
        axes.legend(title=by, fontsize=7, title_fontsize=7)


def _places(axes: Any, rows: list[Row], x: str) -> Callable[[Row], float]:
    """Where a run stands along x: at its number, or, if some have none, one after the other by name."""
    if all(_number(row.get(x)) is not None for row in rows):
        return lambda row: float(row[x])
    words = sorted({_text(row.get(x)) for row in rows}, key=_sorting)
    axes.set_xticks(range(len(words)), [word[:20] for word in words])
    return lambda row: float(words.index(_text(row.get(x))))


def _map(figure: Any, axes: Any, rows: list[Row], x: str, by: str, name: str) -> None:
    """The result as a colour over two keys; a cross where a run has none."""
    points = [
        (
            _number(row.get(x)),
            _number(row.get(by)),
            _number(row.get(name)) if row["state"] == "done" else None,
        )
        for row in rows
    ]
    known = [(a, b, c) for a, b, c in points if a is not None and b is not None and c is not None]
    absent = [(a, b) for a, b, c in points if a is not None and b is not None and c is None]
    if known:
        a, b, c = zip(*known, strict=True)
        figure.colorbar(axes.scatter(a, b, c=c, s=120, cmap="viridis"), ax=axes)
    if absent:
        axes.plot(*zip(*absent, strict=True), "x", color="tab:red")
    axes.set_ylabel(by)


def contact_sheet(plan: Plan, folder: StudyFolder) -> bool:
    """Paste the last picture of every run, with what it changed below; False where there is none."""
    found = [(run, picture) for run in plan.runs if (picture := _last_picture(folder, run.name))]
    if not found:
        return False
    from PIL import Image, ImageDraw, ImageFont

    tiles = [(run, small) for run, path in found[:MOST_PICTURES] if (small := _thumbnail(path)) is not None]
    if not tiles:
        return False
    across = math.ceil(math.sqrt(len(tiles) * 0.7))
    down = math.ceil(len(tiles) / across)
    width, height = (max(getattr(small, side) for _, small in tiles) for side in ("width", "height"))
    sheet = Image.new("RGB", (across * width, down * (height + CAPTION)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(16)
    for place, (run, small) in enumerate(tiles):
        left, top = place % across * width, place // across * (height + CAPTION)
        sheet.paste(small, (left, top + CAPTION))
        words = [f"{key} = {short(value)}" for key, value in run.changes.items() if short(value)]
        draw.text(
            (left + 8, top + 6), f"{run.number}: {', '.join(words)}, seed {run.seed}"[:80], "black", font
        )
    stream = io.BytesIO()
    sheet.save(stream, "PNG")
    write_bytes(folder.contact_sheet, stream.getvalue())
    return True


def _thumbnail(path: Path) -> Any:
    """The picture at ``path``, small; None where it is only half there, its run having been killed."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            small = picture.convert("RGB")
    except (OSError, ValueError):
        return None
    small.thumbnail(THUMBNAIL)
    return small


def _last_picture(folder: StudyFolder, name: str) -> Path | None:
    renders = folder.run(name).renders
    for kind in (*KINDS, ""):
        pictures = sorted(renders.glob(f"{kind}*.png"))
        if pictures:
            return pictures[-1]
    return None


def _number(value: Any) -> float | None:
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if number else None


def _text(value: Any) -> str:
    return "-" if value is None else short(value) or str(value)


def _sorting(text: str) -> tuple[float, str]:
    try:
        return float(text), ""
    except ValueError:
        return math.inf, text
