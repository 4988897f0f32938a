"""Tracks on a bare plate of 316L, measured: nothing is fitted.

Scene    a plate of 316L, 3-D, a Gaussian beam of 60 um diameter (1/e^2, so w = 30 um) at 0.5 m/s over 0.2 mm; 32 W
         at dx = 4 um, 65 W at 5 um; flow, Marangoni, evaporation and recoil on
Answer   Trapp et al. 2017: 32 W 52 um wide, 17 um deep; 65 W 75 um, 28 um; the absorptivities 0.287 and 0.307 were
         measured in the same experiment (calorimetry) and are the inputs. Digitised to +-3 um
Measured the isotherm (T_s + T_l)/2 of the connected pool, mean over the last fifth of the path, in which it is
         steady: shown by its mean over the fifth before; nothing is judged
Shown    what explains the gap: the same with conduction alone, without Marangoni flow, with the slope of sigma turned
         to -4e-4 N/(m K) as of a steel without sulphur, and without evaporation
"""

from typing import Any

import numpy as np

from taichi_slm.config.schema import Config
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.measured import table
from taichi_slm.verification.pools import VARIANTS, watch_pool
from taichi_slm.verification.scenes import configure, merged

UM = 1e-6
START, END = 60e-6, 260e-6  # of the path [m]: steady after half of it
SPACINGS = {32: 4e-6, 65: 5e-6}  # power [W]: [m]
SOUND = {32: 30, 65: 50}  # some ten times the fastest flow [m/s]
SIZES = {
    32: ("0.32 mm", 0.16e-3, 0.08e-3),
    65: ("0.34 mm", 0.2e-3, 0.1e-3),
}  # length, width, depth of the plate


def scene(power: int, **changes: Any) -> Config:
    """The track at ``power`` [W], with ``changes`` laid over it."""
    (row,) = (row for row in table("trapp2017_316L_tracks") if row["power_W"] == power)
    length, width, depth = SIZES[power]
    speed = row["speed_mm_s"] * 1e-3
    base = {
        "dimension": 3,
        "spacing": SPACINGS[power],
        "bodies": [{"shape": "plate", "material": "316L", "length": length, "width": width, "depth": depth}],
        "laser": {
            "power": power,
            "beam_radius": 0.5 * row["spot_1e2_diameter_um"] * UM,
            "absorptivity": row["absorptivity"],
            "path": [{"kind": "line", "start": [START, 0.6 * UM], "end": [END, 0.6 * UM], "speed": speed}],
        },
        "physics": {"evaporation": True, "recoil": True},
        "numerics": {"sound_speed": SOUND[power]},
        "time": {"end": (END - START) / speed},
    }
    return configure(**merged(base, changes))


def compute(outcome: Outcome) -> None:
    """Either power with the full model, then with each variant."""
    for row in table("trapp2017_316L_tracks"):
        power, curves = int(row["power_W"]), []
        for name, changes in {"full": {}, **VARIANTS}.items():
            config = scene(power, **changes)
            end = config.time.end
            found, _ = watch_pool(config, np.arange(1, 61) / 60 * end)
            label = f"{power} W, {name}"
            note = f"ended: {found.failure}" if found.failure else ""
            width, depth = (found.mean(size, 0.8 * end) / UM for size in ("width", "depth"))
            outcome.show(f"width, {label}", width, row["pool_width_um"], unit="um", note=note)
            outcome.show(f"depth, {label}", depth, row["pool_depth_um"], unit="um")
            if name == "full":
                for size in ("length", "width", "depth"):
                    before, after = found.mean(size, 0.6 * end, 0.8 * end), found.mean(size, 0.8 * end)
                    outcome.show(
                        f"{size} of the last fifth over that before, {label}", after / before, note="steady"
                    )
            outcome.show(f"largest temperature, {label}", found.largest("hottest"), unit="K")
            outcome.show(f"largest speed, {label}", found.largest("fastest"), unit="m/s")
            curves += [Curve(f"width, {name}", found.time / 1e-3, found.width / UM),
                       Curve(f"depth, {name}", found.time / 1e-3, found.depth / UM, "dashed")]  # fmt: skip
        last = [found.time[-1] / 1e-3] * 2
        curves.append(Curve("measured", last, [row["pool_width_um"], row["pool_depth_um"]], "points"))
        outcome.plot(f"trapp_{power}W", f"316L, bare plate, {power} W", "time / ms", "pool / um", curves)


CASES = [Case("trapp_tracks", "Tracks on a bare plate of 316L (Trapp 2017)", "measured", "long", compute)]
