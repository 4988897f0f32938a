#!/usr/bin/env python3
"""How the inputs that the paper leaves open change its power study: ``python scripts/track_inputs.py RUNS``.

Runs track_150W at the paper's powers for several sets of those inputs, two runs at a time, into RUNS (runs that
are there already are kept), and writes the table docs/track_inputs.md.
"""

import argparse
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from taichi_slm.output.atomic import write_text
from taichi_slm.run.run_folder import read_json

ROOT = Path(__file__).resolve().parent.parent
ALL = (50, 100, 150, 200)
SETS: dict[str, tuple[tuple[int, ...], tuple[str, ...]]] = {
    "shipped: w 54 um, A 0.75, 1/alpha 6 um": (ALL, ()),
    "A 0.50": (ALL, ("laser.absorptivity=0.5",)),
    "w 27 um, A 0.35": (ALL, ("laser.beam_radius=27e-6", "laser.absorptivity=0.35")),
    "1/alpha 10 um": ((150,), ("laser.absorption_depth=10e-6",)),
    "plate 0.15 mm deep": ((150,), ("bodies.0.depth=0.15e-3",)),
    "A 0.70": (ALL, ("laser.absorptivity=0.7",)),
}
COLUMNS = (
    "inputs", "power [W]", "largest T [K]", "pool length [um]", "depth in the plate [um]", "roughness [um]",
    "powder not melted", "removed",
)  # fmt: skip
HEAD = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"


def run(folder: Path, power: int, changes: tuple[str, ...]) -> None:
    """One track without pictures, if it is not there yet."""
    if (folder / "summary.json").is_file():
        return
    sets = [f"laser.power={power}", "output.images=[]", "output.snapshot_interval=1e-3", *changes]
    command = [
        str(Path(sys.executable).with_name("taichi-slm")),
        "run",
        str(ROOT / "configs" / "track_150W.yaml"),
    ]
    options = [word for key in sets for word in ("--set", key)]
    done = subprocess.run(
        [*command, "--out", str(folder), "--threads", "1", *options], capture_output=True, text=True
    )
    print(folder.name, "ended with", done.returncode, done.stderr.strip(), flush=True)


def row(folder: Path, name: str, power: int) -> str:
    """One row of the table."""
    if not (folder / "summary.json").is_file():
        return f"| {name} | {power} | no result | | | | | |\n"
    summary = read_json(folder / "summary.json")
    track, pool = summary["melt_pool"]["track"], summary["melt_pool"]
    um = [1e6 * (x or 0.0) for x in (pool["length_m"], track["depth_m"], track["roughness_m"])]
    state = "" if summary["status"] == "done" else f" ({summary['status']})"
    return (
        f"| {name} | {power} | {summary['max_temperature_K']:.0f}{state} | {um[0]:.0f} | {um[1]:.1f} | {um[2]:.1f} "
        f"| {track['unmelted_powder']} | {summary['mass']['removed']} |\n"
    )


def main() -> None:
    """Run what is missing, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path)
    runs: Path = parser.parse_args().runs
    jobs = [(runs / f"{number}_{power}W", power, changes, name)
            for number, (name, (powers, changes)) in enumerate(SETS.items()) for power in powers]  # fmt: skip
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda job: run(*job[:3]), jobs))
    table = "".join(row(folder, name, power) for folder, power, _, name in jobs)
    write_text(ROOT / "docs" / "track_inputs.md", HEAD + table)


if __name__ == "__main__":
    main()
