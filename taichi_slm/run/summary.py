"""What a run came to: summary.json and the last lines on the terminal."""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from taichi_slm.analysis.melt_pool import Track, solid_track
from taichi_slm.errors import StorageError
from taichi_slm.output.history import read_history
from taichi_slm.output.numbers import quantity
from taichi_slm.run.progress import clock
from taichi_slm.run.recorder import Recorder

# Lost is net of viscous heating, so that absorbed = stored + lost.
LOSSES = ("radiated_J", "conducted_out_J", "evaporated_J", "removed_J")


def summarise(recorder: Recorder, status: str) -> dict[str, Any]:
    """The content of summary.json; maxima are taken over the rows of the history."""
    sim = recorder.sim
    row: dict[str, Any] = sim.diagnostics()
    try:
        history = read_history(recorder.folder.history)
    except StorageError:  # stopped before its first row
        history = {}
    return {
        "status": status,
        "particles": sim.scene.count,
        "dimension": sim.config.dimension,
        "steps": sim.steps,
        "simulated_time_s": sim.time,
        **recorder.costs(),
        "peak_memory_bytes": peak_memory(),
        "max_temperature_K": _largest(history, "max_temperature_K"),
        "max_speed_m_s": _largest(history, "max_speed_m_s"),
        "melt_pool": {
            "length_m": _largest(history, "melt_length_m"),
            "width_m": _largest(history, "melt_width_m"),
            "depth_m": _largest(history, "melt_depth_m"),
            "track": _track(recorder).as_dict(),
        },
        "energy": {
            "absorbed_J": row["absorbed_J"],
            "stored_J": row["stored_J"],
            "lost_J": sum(row.get(name) or 0.0 for name in LOSSES) - (row.get("viscous_J") or 0.0),
            "relative_error": row["energy_error"],
        },
        "mass": {
            "relative_error": row["mass_error"],
            "removed_kg": row.get("removed_kg"),
            "removed": row["removed"],
        },
        "momentum": {"relative_error": row.get("momentum_error")},
        "doubts": doubts(row, sim.particle_steps, int(recorder.sim.arrays()["ever_liquid"].sum())),
    }


# share that is still harmless: of what, and what is said beyond it
CLIPPED = 0.05  # curvatures; a track with splashes clips 0.4 %
SINGULAR = 0.01  # temperature gradients
BRACKETED = 0.05  # packing corrections; a track with splashes brackets 0.5 %
REMOVED = 0.05  # of the particles that melted; a track at 150 W loses 1.5 %
UNACCOUNTED = 1e-3  # energy


def doubts(row: Mapping[str, Any], particle_steps: int, molten: int) -> list[str]:
    """Sentences on what a run clipped, removed or lost beyond a harmless share, from its last row of the history.

    ``particle_steps`` and ``molten`` (particles that melted and are still there) are what the shares are of.
    """
    surface = row.get("surface_evaluations")
    shares = [
        ("curvature_clips", surface, CLIPPED, "curvatures were clipped: a finer spacing may help"),
        ("singular_gradients", surface, SINGULAR, "temperature gradients had too few neighbours"),
        (
            "packing_brackets",
            particle_steps,
            BRACKETED,
            "packing corrections were bracketed: a larger sound speed",
        ),
        (
            "removed",
            row["removed"] + molten,
            REMOVED,
            "molten particles left or were alone, and were removed",
        ),
    ]
    found = []
    for name, whole, harmless, sentence in shares:
        share = (row.get(name) or 0) / whole if whole else 0.0
        if share > harmless:
            found.append(f"{share:.0%} of the {sentence} (harmless: {harmless:.0%})")
    if row["energy_error"] > UNACCOUNTED:
        found.append(
            f"{row['energy_error']:.1%} of the energy is not accounted for (harmless: {UNACCOUNTED:.1%})"
        )
    return found


def _track(recorder: Recorder) -> Track:
    arrays = recorder.sim.arrays()
    sound = np.isfinite(arrays["position"]).all(axis=1)  # not so at a blow-up
    names = ("position", "liquid_fraction", "ever_liquid", "wall")
    position, fraction, ever_liquid, wall = (arrays[name][sound] for name in names)
    return solid_track(position, fraction, ever_liquid, recorder.sim.config.spacing, wall)


def _largest(history: dict[str, np.ndarray], name: str) -> float | None:
    values = history.get(name, np.zeros(0))
    values = values[np.isfinite(values)]
    return float(values.max()) if len(values) else None


def peak_memory() -> int | None:
    """The most memory this process ever held [bytes]; None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def closing_lines(recorder: Recorder, summary: dict[str, Any]) -> list[str]:
    """The last lines of a run: folder, melt pool, accounts, cost, next command."""
    folder = recorder.folder.path
    pool, energy, mass = summary["melt_pool"], summary["energy"], summary["mass"]
    track = pool["track"]
    sizes = [("length", "length_m"), ("width", "width_m"), ("depth", "depth_m")]
    largest = ", ".join(f"{name} {quantity(pool[key], 'm')}" for name, key in sizes if pool[key] is not None)
    lines = [
        f"folder     {folder}",
        f"melt pool  largest {largest}; max T {summary['max_temperature_K'] or 0:,.0f} K, "
        f"max speed {quantity(summary['max_speed_m_s'], 'm/s')}",
    ]
    if track["particles"]:
        joined = "one piece" if track["pieces"] == 1 else f"{track['pieces']} pieces"
        lines.append(
            f"track      length {quantity(track['length_m'], 'm')}, depth {quantity(track['depth_m'], 'm')} "
            f"below the plate, height {quantity(track['mean_height_m'], 'm')} "
            f"+- {quantity(track['roughness_m'], 'm')}; {joined}, "
            f"{track['unmelted_powder']:,} powder particles never melted"
        )
    unit = "J/m" if summary["dimension"] == 2 else "J"
    absorbed, stored, lost = (quantity(energy[k], unit) for k in ("absorbed_J", "stored_J", "lost_J"))
    memory = (summary["peak_memory_bytes"] or 0) / 1e6
    costs = f"solver {summary['solver_time_s']:.1f} s, compiling {summary['compile_time_s']:.1f} s"
    return [
        *lines,
        f"energy     absorbed {absorbed} = stored {stored} + lost {lost}, "
        f"relative error {energy['relative_error']:.1e}",
        f"mass       relative error {mass['relative_error']:.1e}, {mass['removed']:,} particles removed",
        f"cost       {summary['steps']:,} steps of {summary['particles']:,} particles in "
        f"{clock(summary['wall_time_s'])} ({costs}), memory {memory:,.0f} MB",
        *(f"doubt      {sentence}" for sentence in summary["doubts"]),
    ]
