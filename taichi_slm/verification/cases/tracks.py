"""The paper's power study (figures 11 and 12), 2-D: a row of powder on a plate, 50 to 200 W.

Scene    grains of radius 25 um on a plate of 304 steel 1.2 x 0.33 mm, dx = 4 um, a beam of w = 54 um at 2 m/s over 1
         mm; the scenes of configs/track_*W.yaml. What the paper leaves open is chosen once for all powers:
         docs/tracks.md
Answer   the paper's words: at 50 W the powder does not melt through, at 100 W it does, at 150 W the melt penetrates
         the plate, at 200 W more so, and the surface is rougher and more metal is thrown out. An order, not numbers:
         in 2-D the beam is a line source, so no experiment has these sizes
Measured what is solid again in the end: powder that never melted, over all powder; the deepest metal of the track
         below the plate's surface; standard deviation of its upper edge; mass of removed particles. Each is judged by
         the smallest step from one power to the next
"""

from typing import Any

import numpy as np

from taichi_slm.config.schema import Config
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.pools import PoolHistory, watch_pool
from taichi_slm.verification.scenes import configure

UM, MM = 1e-6, 1e-3
POWERS = (50, 100, 150, 200)  # [W]
DX, RADIUS, START, SPEED = 4e-6, 25e-6, 1e-4, 2.0  # [m], [m/s]
ENDS = {200: 5e-3}  # [s]; it holds twice the heat
MARKED: dict[str, Any] = {"tracers": [0, 0, 0, 1]}
DOPED: dict[str, Any] = {"materials": ["steel_304", "steel_304", "conducting_304"]}
CONDUCTING = {"conducting_304": {"extends": "steel_304", "scale": {"conductivity": 2}}}


def scene(power: float, grains: dict[str, Any] | None = None) -> Config:
    """The track at ``power`` [W]; ``grains`` (MARKED, DOPED) is laid over the row of powder."""
    grains = grains or {}
    return configure(
        spacing=DX,
        materials=CONDUCTING if "materials" in grains else {},
        bodies=[
            {"shape": "plate", "length": "1.2 mm", "depth": "0.33 mm"},
            {"shape": "powder_row", "start": START, "length": "1 mm", "radius": RADIUS, **grains},
        ],
        laser={
            "power": power,
            "beam_radius": "54 um",
            "absorptivity": 0.75,
            "absorption_depth": "6 um",
            "bin_size": "4.8 um",
            "path": [{"kind": "line", "start": [START], "end": ["1.1 mm"], "speed": SPEED}],
        },
        numerics={"sound_speed": 20},
        time={"end": ENDS.get(int(power), 2.5e-3)},
    )


def compute(outcome: Outcome) -> None:
    """The four powers, each until all is solid."""
    runs, powder = {}, 1
    for power in POWERS:
        config = scene(power)
        runs[power], sim = watch_pool(config, np.arange(1, round(config.time.end / 10e-6) + 1) * 10e-6)
        powder = int((sim.scene.position[:, 1] > 0).sum())
        _show(outcome, power, runs[power], powder)
    tracks = [runs[power].track for power in POWERS]
    unmelted = np.array([track.unmelted_powder for track in tracks]) / powder
    removed = np.array([runs[power].removed_kg for power in POWERS])
    outcome.at_least(
        "powder never melted, 50 W", unmelted[0], limit=0.05, why="it does not melt through: figure 12"
    )
    outcome.judge("powder never melted, 100 W", unmelted[1], error=unmelted[1], limit=0.05,
                  why="it melts through: figure 12; the ends of the row lie outside the beam's path")  # fmt: skip
    outcome.at_least("smallest gain of melted powder with power", -np.diff(unmelted).max(), limit=0.0,
                     why="more power melts no less; all is melted from 150 W on")  # fmt: skip
    for name, values, limit, unit, why in (
        (
            "depth",
            [t.depth_m / UM for t in tracks],
            0.5 * DX / UM,
            "um",
            "half a spacing: less is no difference",
        ),
        ("roughness", [t.roughness_m / UM for t in tracks], 0.0, "um", "rougher with power: section 5.2"),
    ):
        outcome.at_least(f"smallest gain of {name} from one power to the next", float(np.diff(values).min()),
                         limit=limit, unit=unit, why=why)  # fmt: skip
        outcome.plot(f"tracks_{name.replace(' ', '_')}", f"Tracks: {name}", "power / W", f"{name} / {unit}",
                     [Curve("", POWERS, values, "points")])  # fmt: skip
    gain = float(np.diff(removed[1:] / 1e-9).min())
    outcome.at_least("smallest gain of removed mass from 100 W on", gain, limit=0.0, unit="ug/m",
                     why="calm at 100 W, ejection at 150 W, more at 200 W; below, single particles leave")  # fmt: skip
    curves = [Curve(f"{power} W", run.time / 1e-3, run.depth / UM) for power, run in runs.items()]
    outcome.plot("tracks_pool_depth", "Tracks: depth of the pool", "time / ms", "depth / um", curves)


def _show(outcome: Outcome, power: int, run: PoolHistory, powder: int) -> None:
    track = run.track
    note = f"ended: {run.failure}" if run.failure else ""
    outcome.show(f"powder never melted, {power} W", track.unmelted_powder / powder, note=note)
    outcome.show(f"depth of the track in the plate, {power} W", track.depth_m / UM, unit="um")
    outcome.show(f"roughness, {power} W", track.roughness_m / UM, unit="um")
    outcome.show(f"pieces of powder and plate, {power} W", track.pieces, note="1: bonded")
    outcome.show(f"removed, {power} W", run.removed_kg / 1e-9, unit="ug/m")
    outcome.show(f"longest pool, {power} W", run.largest("length") / UM, unit="um")
    outcome.show(f"largest temperature, {power} W", run.largest("hottest"), unit="K")


CASES = [Case("tracks", "Power study: tracks of 50 to 200 W", "paper", "long", compute)]
