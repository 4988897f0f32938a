"""A study at a glance: results over what was changed, and the last picture of every run."""

import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_slm.output.atomic import write_bytes
from taichi_slm.output.numbers import handy, name_and_unit
from taichi_slm.study.folder import StudyFolder
from taichi_slm.study.plan import Plan, PlannedRun, last_word, short

Row = dict[str, Any]
DPI = 120
THUMBNAIL = (640, 400)  # pixels, at most
CAPTION = 28  # pixels
MOST_PICTURES = 100
MOST_LINES = 7  # values of a key that get a line and an entry in the legend
KINDS = ("state", "temperature")  # the frozen track first


def overview(plan: Plan, rows: list[Row], path: Path) -> bool:
    """Draw the results that ``plan`` wants shown; False, and no picture, where no run that is done has any."""
    done = [row for row in rows if row["state"] == "done"]
    shown = [name for name in plan.overview.show if any(_number(row.get(name)) is not None for row in done)]
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
    key, groups = _scale(plan, rows, x), _scale(plan, rows, by)
    for place, name in enumerate(shown, 1):
        axes = figure.add_subplot(down, across, place)
        result = _scale(plan, rows, name)
        if plan.overview.kind == "map" and by is not None:
            _map(figure, axes, rows, key, groups, result)
        else:
            _lines(axes, rows, key, groups if by else None, result)
        axes.set_xlabel(key.label)
        axes.set_title(result.label, fontsize=10)
        axes.grid(alpha=0.3)
    stream = io.BytesIO()
    canvas.print_figure(stream, dpi=DPI, format="png")
    write_bytes(path, stream.getvalue())
    return True


@dataclass(frozen=True)
class _Scale:
    """How a column is shown: a name with its unit, numbers in that unit."""

    column: str
    label: str
    factor: float

    def number(self, row: Row) -> float | None:
        """The number of ``row`` in the unit shown."""
        value = _number(row.get(self.column))
        return None if value is None else value / self.factor

    def text(self, row: Row) -> str:
        """The value of ``row`` in words, without its unit."""
        number = self.number(row)
        value = row.get(self.column) if number is None or isinstance(row.get(self.column), int) else number
        return "-" if value is None else short(value) or str(value)


def _scale(plan: Plan, rows: list[Row], column: str | None) -> _Scale:
    """A key has the unit of the config, a result that in which its name ends."""
    column = column or ""
    name, unit = (column, plan.units[column]) if column in plan.units else name_and_unit(column)
    sizes = [abs(number) for row in rows if (number := _number(row.get(column))) is not None]
    factor, unit = handy(max(sizes, default=0.0), unit)
    return _Scale(column, f"{name} [{unit}]" if unit else name, factor)


def _axes(plan: Plan, rows: list[Row]) -> tuple[str, str | None]:
    """The columns along x and of the colours: as the study says, else the first that vary."""
    varying = (
        [key for key in plan.keys if len({str(row.get(key)) for row in rows}) > 1] or plan.keys or ["seed"]
    )
    x = plan.overview.x or next((key for key in varying if key != plan.overview.by), varying[0])
    rest = [key for key in varying if key != x]
    return x, plan.overview.by or (rest[0] if rest else None)


def _lines(axes: Any, rows: list[Row], x: _Scale, by: _Scale | None, result: _Scale) -> None:
    """Every run a point; a line through the means at one x, per value of ``by``; runs not done cross the lower edge.

    Many values of ``by``, or one of its own for every run, are colours of a scale, without lines.
    """
    place = _places(axes, rows, x)
    done = [row for row in rows if row["state"] == "done" and result.number(row) is not None]
    series = sorted({by.text(row) for row in rows}, key=_sorting) if by else [""]
    graded = by is not None and (len(series) > MOST_LINES or 2 < len(series) == len(rows))
    if by is not None and graded and all(by.number(row) is not None for row in rows):
        if done:
            points = [(place(row), result.number(row), by.number(row)) for row in done]
            a, b, c = zip(*points, strict=True)
            axes.figure.colorbar(axes.scatter(a, b, c=c, s=20, cmap="viridis"), ax=axes, label=by.label)
    else:
        for each in series:
            _line(
                axes,
                [(place(row), result.number(row) or 0.0) for row in done if not by or by.text(row) == each],
                each,
            )
    failed = [place(row) for row in rows if row["state"] != "done"]
    if failed:
        axes.plot(failed, [0.02] * len(failed), "x", color="tab:red", label="not done",
                  transform=axes.get_xaxis_transform())  # fmt: skip
    if any(axes.get_legend_handles_labels()[1]):
        axes.legend(title=by.label if by and not graded else None, fontsize=7, title_fontsize=7)


def _line(axes: Any, points: list[tuple[float, float]], label: str) -> None:
    """The points of one series, and a line through their means."""
    found: dict[float, list[float]] = {}
    for at, value in points:
        found.setdefault(at, []).append(value)
    if found:
        (drawn,) = axes.plot(*zip(*points, strict=True), "o", ms=4)
        means = [(at, sum(found[at]) / len(found[at])) for at in sorted(found)]
        axes.plot(*zip(*means, strict=True), "-", lw=1, color=drawn.get_color(), label=label)


def _places(axes: Any, rows: list[Row], x: _Scale) -> Callable[[Row], float]:
    """Where a run stands along x: at its number, or, if some have none, one after the other by name."""
    if all(x.number(row) is not None for row in rows):
        return lambda row: x.number(row) or 0.0
    words = sorted({x.text(row) for row in rows}, key=_sorting)
    axes.set_xticks(range(len(words)), [word[:20] for word in words])
    return lambda row: float(words.index(x.text(row)))


def _map(figure: Any, axes: Any, rows: list[Row], x: _Scale, by: _Scale, result: _Scale) -> None:
    """The result as a colour over two keys; a cross where a run has none."""
    points = [
        (x.number(row), by.number(row), result.number(row) if row["state"] == "done" else None)
        for row in rows
    ]
    known = [(a, b, c) for a, b, c in points if a is not None and b is not None and c is not None]
    absent = [(a, b) for a, b, c in points if a is not None and b is not None and c is None]
    if known:
        a, b, c = zip(*known, strict=True)
        figure.colorbar(axes.scatter(a, b, c=c, s=120, cmap="viridis"), ax=axes)
    if absent:
        axes.plot(*zip(*absent, strict=True), "x", color="tab:red")
    axes.set_ylabel(by.label)


def contact_sheet(plan: Plan, folder: StudyFolder) -> bool:
    """Paste the last picture of every run, with what it changed below; False where there is none."""
    found = [(run, picture) for run in plan.runs if (picture := _last_picture(folder, run.name))]
    if not found:
        return False
    from matplotlib import get_data_path
    from PIL import Image, ImageDraw, ImageFont

    tiles = [(run, small) for run, path in found[:MOST_PICTURES] if (small := _thumbnail(path)) is not None]
    if not tiles:
        return False
    across = math.ceil(math.sqrt(len(tiles) * 0.7))
    down = math.ceil(len(tiles) / across)
    width, height = (max(getattr(small, side) for _, small in tiles) for side in ("width", "height"))
    sheet = Image.new("RGB", (across * width, down * (height + CAPTION)), "white")
    draw, font = (
        ImageDraw.Draw(sheet),
        ImageFont.truetype(str(Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")), 15),
    )
    for place, (run, small) in enumerate(tiles):
        left, top = place % across * width, place // across * (height + CAPTION)
        sheet.paste(small, (left, top + CAPTION))
        draw.text((left + 8, top + 6), _caption(plan, run, font, width - 16), "black", font)
    stream = io.BytesIO()
    sheet.save(stream, "PNG")
    write_bytes(folder.contact_sheet, stream.getvalue())
    return True


def _caption(plan: Plan, run: PlannedRun, font: Any, width: int) -> str:
    """Number, changes and, where they differ, the seed of ``run``: what of it fits into ``width`` pixels."""
    words = [
        _measured(key, value, plan.units.get(key, "")) for key, value in run.changes.items() if short(value)
    ]
    if len({each.seed for each in plan.runs}) > 1:
        words.append(f"seed {run.seed}")
    text = f"{run.number}: {', '.join(words)}"
    while font.getlength(text) > width:
        text = text.removesuffix("...")[:-1].rstrip(" ,") + "..."
    return text


def _measured(key: str, value: Any, unit: str) -> str:
    """A key and its value with a unit: "power = 60 W"."""
    if unit and _number(value) is not None:
        factor, unit = handy(value, unit)
        value = float(value) / factor
    return f"{last_word(key)} = {short(value)} {unit}".rstrip()


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


def _sorting(text: str) -> tuple[float, str]:
    try:
        return float(text), ""
    except ValueError:
        return math.inf, text
