"""What a person sees of a study: a live panel on a terminal, a line per run elsewhere."""

import time
from collections.abc import Sequence

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table

from taichi_slm.errors import StorageError
from taichi_slm.run.progress import clock
from taichi_slm.run.run_folder import read_json
from taichi_slm.study.execute import End
from taichi_slm.study.folder import StudyFolder

MOST_BARS = 20
LOOK_SECONDS = 1.0


class View:
    """Shows how far the runs ``names`` are; use it as a context manager."""

    def __init__(self, title: str, folder: StudyFolder, names: Sequence[str], console: Console) -> None:
        self.title, self.folder, self.console = title, folder, console
        self.ends: dict[str, End] = {}
        self._names = list(names)
        self._began = time.perf_counter()
        self._looked = 0.0
        self._live = (
            Live(console=console, refresh_per_second=2, transient=True) if console.is_terminal else None
        )

    def __enter__(self) -> "View":
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def ended(self, end: End) -> None:
        """A run came to its end."""
        self.ends[end.name] = end
        if not end.begun and end.state != "failed":
            return
        took = f" in {clock(end.seconds)}" if end.begun else " before; --retry does it again"
        said = f": {end.sentence}" if end.sentence else ""
        self.say(f"[{len(self.ends)}/{len(self._names)}] {end.name}: {end.state}{took}{said}")

    def say(self, text: str) -> None:
        """Print a line, above the panel if there is one."""
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def look(self) -> None:
        """Bring the panel up to date, once a second."""
        now = time.perf_counter()
        if self._live and now - self._looked > LOOK_SECONDS:
            self._looked = now
            self._live.update(self._panel())

    def _panel(self) -> Panel:
        states = [end.state for end in self.ends.values()]
        count = len(self._names)
        running = self._running()
        bars = Table.grid(padding=(0, 2), expand=True)
        bars.add_column(no_wrap=True, max_width=50)
        bars.add_column(ratio=1)
        bars.add_column(justify="right", no_wrap=True)
        total = (len(states) + sum(share for _, share in running)) / count
        left = clock((time.perf_counter() - self._began) * (1 / total - 1)) if total > 0 else "-"
        bars.add_row(f"{states.count('done')} of {count} done, {states.count('failed')} failed",
                     ProgressBar(total=1.0, completed=total), f"ETA {left}")  # fmt: skip
        for name, share in running[:MOST_BARS]:
            bars.add_row(f"  {name}", ProgressBar(total=1.0, completed=share), f"{100 * share:.0f} %")
        if len(running) > MOST_BARS:
            bars.add_row(f"  and {len(running) - MOST_BARS} more", "", "")
        return Panel(Group(bars), title=self.title, title_align="left")

    def _running(self) -> list[tuple[str, float]]:
        """Runs that say of themselves that they run, and how far they are."""
        found = []
        for name in self._names:
            path = self.folder.run(name).status
            if name not in self.ends and path.is_file():
                try:
                    status = read_json(path)
                except StorageError:
                    continue
                if status.get("state") == "running":
                    found.append((name, float(status.get("progress") or 0.0)))
        return found
