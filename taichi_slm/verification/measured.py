"""The measured melt pools that ship with the package, from verification/data/*.csv; sources in its README."""

import csv
from importlib import resources


def table(name: str) -> list[dict[str, float]]:
    """The rows of a table by column name, in the units that the names say."""
    text = (
        resources.files("taichi_slm.verification").joinpath("data", f"{name}.csv").read_text(encoding="utf-8")
    )
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(text.splitlines())]
