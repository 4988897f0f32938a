"""What the scripts of the shipped studies share: one study from Python, and its table on the terminal."""

import argparse
import csv
import sys
from pathlib import Path

from taichi_slm.errors import SlmError
from taichi_slm.study.conduct import conduct
from taichi_slm.study.plan import load_plan

STUDIES = Path(__file__).resolve().parent.parent / "configs" / "studies"
SHOWN = ("state", "max_temperature_K", "melt_pool.length_m", "melt_pool.track.depth_m")


def main(name: str, about: str | None) -> None:
    """Do what is missing of the study ``name`` and print the chief columns of its table (SI)."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--out", type=Path, help="folder of the study; by default studies/NAME")
    parser.add_argument("--jobs", type=int, help="runs at a time; by default one per core")
    parser.add_argument("--check", action="store_true", help="only check the runs and count them")
    given = parser.parse_args()
    code = 0
    try:
        plan = load_plan(STUDIES / f"{name}.yaml")
        if given.check:
            print(f"{plan.title}: {len(plan.runs)} runs, all valid")
            return
        out = given.out or Path("studies") / name
        try:
            conduct(plan, out, given.jobs)
        finally:
            show(out / "table.csv", [*plan.keys, *SHOWN])
    except SlmError as error:
        print(error, file=sys.stderr)
        code = error.exit_code
    sys.exit(code)


def show(table: Path, columns: list[str]) -> None:
    """Print ``columns`` of a study's table."""
    if not table.is_file():
        return
    print("  ".join(columns))
    with open(table, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            print("  ".join(f"{row.get(name) or '-':>{len(name)}.{len(name)}}" for name in columns))


if __name__ == "__main__":
    sys.exit(
        "call one of the studies: power_sweep.py, process_map.py, conductivity_study.py, resolution_study.py"
    )
