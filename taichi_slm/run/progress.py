"""What a person sees of a run: a live panel on a terminal, a flushed line now and then elsewhere."""

import math
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table

from taichi_slm.output.numbers import quantity

LINE_SECONDS = 10.0
LINE_FRACTION = 0.05


class Progress:
    """Shows how far a run of ``end`` [s] of simulated time is; use it as a context manager."""

    def __init__(self, title: str, end: float, console: Console) -> None:
        self.title, self.end, self.console = title, end, console
        self._start = time.perf_counter()
        self._first: float | None = None  # simulated time when this process began
        self._last_line = (-math.inf, -math.inf)  # wall time, fraction
        self._live: Live | None = None
        if console.is_terminal:
            self._live = Live(console=console, refresh_per_second=4, transient=True)

    def __enter__(self) -> "Progress":
        if self._live:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live:
            self._live.stop()

    def eta(self, simulated: float) -> float | None:
        """Seconds of wall time left if the rest is as slow as what was, or None before there is any."""
        done = simulated - (self._first or 0.0)
        if done <= 0.0:
            return None
        return (time.perf_counter() - self._start) * (self.end - simulated) / done

    def update(self, row: Mapping[str, Any]) -> None:
        """Show ``row``, a row of the history."""
        simulated = float(row["time_s"])
        if self._first is None:
            self._first = simulated
            self._start = time.perf_counter()
        if self._live:
            self._live.update(self._panel(row))
            return
        now, fraction = time.perf_counter(), simulated / self.end
        if now - self._last_line[0] >= LINE_SECONDS or fraction - self._last_line[1] >= LINE_FRACTION:
            self._last_line = (now, fraction)
            self.say(self._line(row))

    def say(self, text: str) -> None:
        """Print a line, above the panel if there is one."""
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def _line(self, row: Mapping[str, Any]) -> str:
        simulated = float(row["time_s"])
        return (
            f"{100 * simulated / self.end:3.0f} %  t {quantity(simulated, 's')}  step {row['step']:,}  "
            f"dt {quantity(row['dt_s'], 's')} ({row['dt_limiter']})  "
            f"max T {row['max_temperature_K']:,.0f} K  depth {quantity(row.get('melt_depth_m'), 'm')}  "
            f"mobile {row['mobile']:,}  hot {row['hot']:,}  ETA {clock(self.eta(simulated))}"
        )

    def _panel(self, row: Mapping[str, Any]) -> Panel:
        simulated = float(row["time_s"])
        numbers = Table.grid(padding=(0, 2))
        for _ in range(4):
            numbers.add_column(justify="left")
        cells = (
            ("time", f"{quantity(simulated, 's')} of {quantity(self.end, 's')}"),
            ("step", f"{row['step']:,}"),
            ("dt", f"{quantity(row['dt_s'], 's')} ({row['dt_limiter']})"),
            ("max T", f"{row['max_temperature_K']:,.0f} K"),
            ("max speed", f"{row['max_speed_m_s']:.2f} m/s"),
            ("melt pool", _pool(row)),
            ("mobile, hot", f"{row['mobile']:,}, {row['hot']:,} particles"),
            ("removed", f"{row['removed']:,}"),
        )
        for (a, b), (c, d) in zip(cells[::2], cells[1::2], strict=True):
            numbers.add_row(f"[dim]{a}[/]", b, f"[dim]{c}[/]", d)
        bar = Table.grid(padding=(0, 2), expand=True)
        bar.add_column(ratio=1)
        bar.add_column(justify="right", no_wrap=True)
        bar.add_row(
            ProgressBar(total=1.0, completed=simulated / self.end),
            f"{100 * simulated / self.end:.1f} %   ETA {clock(self.eta(simulated))}",
        )
        return Panel(Group(bar, numbers), title=self.title, title_align="left")


def _pool(row: Mapping[str, Any]) -> str:
    names = ("melt_length_m", "melt_width_m", "melt_depth_m")
    sizes = [quantity(row[name], "m") for name in names if row.get(name) is not None]
    return " x ".join(sizes)


def clock(seconds: float | None) -> str:
    """Wall time as 12 s, 3:05 or 1:02:03."""
    if seconds is None or not math.isfinite(seconds):
        return "-"
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
