"""Writes what is due (history, snapshot, checkpoint, status) and never changes the simulation."""

import contextlib
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_slm.analysis.melt_pool import MeltPool, measure
from taichi_slm.config.material import Material
from taichi_slm.output.atomic import make_folder, storage_error, write_json
from taichi_slm.output.history import COLUMNS, History, keep_until
from taichi_slm.output.snapshots import Snapshot, read_series, write_series, write_snapshot
from taichi_slm.run.checkpoint import Checkpoint, Slots
from taichi_slm.run.run_folder import RunFolder, package_version, source_hash
from taichi_slm.run.schedule import TOLERANCE, Every, earliest

if TYPE_CHECKING:
    from taichi_slm.run.simulation import Simulation

STATUS_SECONDS = 1.0
PAUSE = 100
"""Flow steps between the moments at which a run may be stopped and saved: an unbroken run pauses there, too, so that a
resumed one has its bits."""
LONGEST = 6_000_000
"""Particles times steps between two pauses: some seconds of two cores, so that a large run, too, leaves in time."""


class Recorder:
    """The files of one run while it goes on."""

    def __init__(
        self, sim: "Simulation", folder: RunFolder, began: float, resumed: Checkpoint | None = None
    ) -> None:
        """Start the files of ``folder``, or cut them back to the moment of ``resumed``.

        ``began`` is the wall time by `time.perf_counter` at which this process started on the run; the
        simulation is compiled, and restored if the run is a resumed one.
        """
        self.sim, self.folder = sim, folder
        self.began = began  # of this process, by time.perf_counter
        self.melting = melting_points(sim.scene.materials)
        self.entries: list[tuple[float, str]] = []
        self._last_row = self._last_snapshot = self._last_save = self._status_at = -1.0
        self._carried = _costs_before(resumed.meta, sim) if resumed else {}
        self._resumed_at = sim.time
        self._saved_step, self._saved_at = sim.steps, time.perf_counter()
        self.checkpoint_path = resumed.path if resumed else None
        after = None
        if resumed:
            after = float(resumed.meta["time_s"])
            self._cut_back(resumed)
        else:
            self._clear()
        self.history = History(folder.history)
        self.slots = Slots(folder.checkpoints)
        end, output = sim.config.time.end, sim.config.output
        self.rows = Every(output.history_interval or end / 400, after)
        self.pictures = Every(output.snapshot_interval or end / 40, after)
        self.saves = Every(output.checkpoint_interval or end / 10, after)

    def _clear(self) -> None:
        """Remove what a run left that ended before its first checkpoint and begins again."""
        for path in (self.folder.history, self.folder.series, *self.folder.snapshots.glob("*.vtu")):
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                raise storage_error("remove", path, error) from error

    def _cut_back(self, resumed: Checkpoint) -> None:
        now = float(resumed.meta["time_s"])
        if keep_until(self.folder.history, resumed.step):
            self._last_row = now
        limit = now + TOLERANCE * self.sim.config.time.end
        self.entries = [
            (moment, f"{path.parent.name}/{path.name}")
            for moment, path in read_series(self.folder.series)
            if moment <= limit and path.is_file()
        ]
        for path in sorted(self.folder.snapshots.glob("*.vtu")):
            if int(path.stem) >= len(self.entries):
                with contextlib.suppress(OSError):
                    path.unlink()
        if self.entries and self.entries[-1][0] > now - TOLERANCE * self.sim.config.time.end:
            self._last_snapshot = now
        write_series(self.folder.series, self.entries)

    def next_moment(self) -> float:
        """The next simulated time [s] at which something is due."""
        return earliest([self.rows, self.pictures, self.saves], self.sim.config.time.end)

    def next_pause(self) -> int:
        """The step at which the run pauses next, should nothing be due before.

        It follows from the state and the config alone, never from the clock: a resumed run finds the same one.
        """
        sim, every = self.sim, self.sim.config.output.checkpoint_steps
        at_work = sim.moving or sim.scene.count  # where nobody moves a step is one of heat
        pause = min(PAUSE, max(1, LONGEST // at_work))
        return min(_next_multiple(sim.steps, pause), _next_multiple(sim.steps, every or pause))

    def record(self, paused: bool) -> dict[str, Any] | None:
        """Write all that is due now; the row of history if there was one.

        ``paused``: the run has come to a step at which it may be saved, whatever the clock on the wall says.
        """
        now = self.sim.time
        row = self.write_row() if self.rows.due(now) else None
        if self.pictures.due(now):
            self.write_snapshot()
        if paused:
            self.sim.pause()
        if self.saves.due(now) or (paused and self._save_is_late()):
            self.write_checkpoint()
        elif time.perf_counter() - self._status_at > STATUS_SECONDS:
            self.write_status("running")
        return row

    def _save_is_late(self) -> bool:
        """Whether so many steps or so much wall time have passed since the last checkpoint."""
        output, every = self.sim.config.output, self.sim.config.output.checkpoint_steps
        steps_are_due = every is not None and self.sim.steps >= _next_multiple(self._saved_step, every)
        return steps_are_due or time.perf_counter() - self._saved_at > output.checkpoint_wall

    def record_last(self) -> dict[str, Any] | None:
        """Close a finished run: a last row and a last snapshot, if the last ones are older."""
        row = None if self._last_row == self.sim.time else self.write_row()
        if self._last_snapshot != self.sim.time:
            self.write_snapshot()
        return row

    def write_row(self) -> dict[str, Any]:
        """Append the present to history.csv; returns the row."""
        pool = self.melt_pool()
        row = {
            **self.sim.diagnostics(),
            "melt_length_m": pool.length,
            "melt_width_m": pool.width,
            "melt_depth_m": pool.depth,
        }
        row = {**{name: row.get(name) for name in COLUMNS}, **row}
        self.history.append(row)
        self._last_row = self.sim.time
        return row

    def melt_pool(self) -> MeltPool:
        """The pool as it is now."""
        arrays = self.sim.arrays(("position", "temperature", "liquid_fraction", "material", "wall"))
        melting = self.melting[arrays["material"]]
        melting[arrays["wall"].astype(bool)] = np.inf
        return measure(
            arrays["position"],
            arrays["temperature"],
            arrays["liquid_fraction"],
            melting,
            self.sim.config.spacing,
        )

    def write_snapshot(self) -> None:
        """Write the next VTU and the time series."""
        path = self.folder.snapshot(len(self.entries))
        write_snapshot(path, self._snapshot())
        self.entries.append((self.sim.time, f"{path.parent.name}/{path.name}"))
        write_series(self.folder.series, self.entries)
        self._last_snapshot = self.sim.time

    def write_crash(self) -> None:
        """Write the particles as they are at a blow-up."""
        make_folder(self.folder.crash, parents=False)
        write_snapshot(self.folder.crash / f"step_{self.sim.steps}.vtu", self._snapshot())

    def _snapshot(self) -> Snapshot:
        sim = self.sim
        return Snapshot(
            arrays=sim.arrays(),
            time=sim.time,
            step=sim.steps,
            dimension=sim.config.dimension,
            spacing=sim.config.spacing,
            git=source_hash(),
            version=package_version(),
        )

    def costs(self) -> dict[str, float]:
        """Wall, solver and compile time [s] and particle steps, those before a resume included."""
        sim = self.sim
        now = {
            "wall_time_s": time.perf_counter() - self.began,
            "solver_time_s": sim.solver_time_s,
            "compile_time_s": sim.compile_time_s,
            "particle_steps": sim.particle_steps,
        }
        return {name: value + self._carried.get(name, 0) for name, value in now.items()}

    def write_checkpoint(self) -> None:
        """Save the state into the free slot, unless the last checkpoint is of this very moment."""
        if self._last_save == self.sim.time:
            return
        meta = {"step": self.sim.steps, "time_s": self.sim.time, **self.costs()}
        self.checkpoint_path = self.slots.write(self.sim.checkpoint(), meta)
        self._last_save = self.sim.time
        self._saved_step, self._saved_at = self.sim.steps, time.perf_counter()
        self.write_status("running")

    def write_status(self, state: str, message: str = "") -> None:
        """Say in status.json where the run stands."""
        self._status_at = time.perf_counter()
        end = self.sim.config.time.end
        done = self.sim.time - self._resumed_at
        wall = self._status_at - self.began
        eta = wall * (end - self.sim.time) / done if state == "running" and done > 0.0 else None
        slot = self.checkpoint_path
        status = {
            "state": state,
            "step": self.sim.steps,
            "time_s": self.sim.time,
            "end_s": end,
            "progress": self.sim.time / end,
            "eta_s": eta,
            "last_good_checkpoint": f"{slot.parent.name}/{slot.name}" if slot else None,
            "message": message,
        }
        write_json(self.folder.status, status)

    def close(self) -> None:
        """Close the open file."""
        self.history.close()


def _next_multiple(step: int, of: int) -> int:
    return (step // of + 1) * of


def _costs_before(meta: dict[str, Any], sim: "Simulation") -> dict[str, float]:
    """Costs of the processes before this one; a counter that the simulation has restored counts once."""
    restored = {"solver_time_s": sim.solver_time_s, "particle_steps": sim.particle_steps}
    names = ("wall_time_s", "solver_time_s", "compile_time_s", "particle_steps")
    return {name: meta[name] - restored.get(name, 0) for name in names}


def melting_points(materials: Sequence[Material]) -> np.ndarray:
    """Where half of each material is liquid [K], shape [materials]; infinite for one that has no solid."""
    return np.array(
        [
            0.5 * (m.solidus + m.liquidus) if m.solidus is not None and m.liquidus is not None else np.inf
            for m in materials
        ]
    )
