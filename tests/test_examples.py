"""The examples run as they stand, and say and draw what is there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_step_and_plot(tmp_path):
    """At twice its spacing, so that it takes seconds."""
    done = subprocess.run(
        [sys.executable, EXAMPLES / "step_and_plot.py", "spacing=10e-6"],
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert re.search(
        r"^\d+ steps, 1\d{3} particles, to 400 us$", done.stdout, re.MULTILINE
    )  # 60 x 15 and 8 grains
    depth, hottest = re.search(r"pool was (\d+) um deep and (\d+) K hot", done.stdout).groups()
    assert 0 < int(depth) < 100  # it reached the plate, and is not a keyhole
    assert 1773 < int(hottest) < 12_000  # above the liquidus, within the tables
    energy, mass = map(float, re.search(r"energy (\S+), mass (\S+)$", done.stdout, re.MULTILINE).groups())
    assert energy < 1e-3  # what every summary promises
    assert mass < 1e-12
    assert [path.name for path in tmp_path.iterdir()] == ["step_and_plot.png"]
    with Image.open(tmp_path / "step_and_plot.png") as image:
        pixels = np.asarray(image.convert("RGB"), dtype=int)
    line = np.abs(pixels - (0, 191, 255)).sum(axis=2) < 60  # deepskyblue
    assert line.sum() > 500  # the melting point in three panels
