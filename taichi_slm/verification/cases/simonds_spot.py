"""A spot of 10 ms on 316L, measured: nothing is fitted.

Scene    a block of 316L (alloy file 316L, the SRM 1155a of the experiment) 0.8 x 0.8 x 0.4 mm, 3-D, under a top hat
         of 303 um diameter, 1.2 J in 10 ms; flow, Marangoni, evaporation and recoil on. Heat that reaches the sides
         comes back, which at the pool is 4 K of images by 10 ms
Answer   Simonds et al. 2018, Table III: pool 304 um wide, 156 um deep, 0.31 of the light absorbed: that share is the
         input
Measured the isotherm (T_s + T_l)/2 of the connected pool: width, the mean of its extents in x and y, and depth, mean
         over the last millisecond of the pulse, in which it is as large as it gets; nothing is judged
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

UM, PULSE = 1e-6, 10e-3  # [m], [s]
COARSE, FINE = 25e-6, 50e-6 / 3  # spacings [m]


def scene(spacing: float = COARSE, **changes: Any) -> Config:
    """The spot at ``spacing`` [m], with ``changes`` laid over it."""
    row = table("simonds2018_316L_spot")[0]
    base = {
        "dimension": 3,
        "spacing": spacing,
        "bodies": [
            {
                "shape": "plate",
                "material": "316L",
                "start": "-0.4 mm",
                "length": "0.8 mm",
                "width": "0.8 mm",
                "depth": "0.4 mm",
                "cold_layers": 0,
            }
        ],
        "laser": {
            "power": row["energy_J"] / PULSE,
            "beam_radius": 151.5 * UM,
            "profile": "top_hat",
            "absorptivity": row["coupling"],
            "path": [{"kind": "dwell", "at": [3.2 * UM, 2 * UM], "duration": PULSE}],
        },
        "physics": {"evaporation": True, "recoil": True},
        "numerics": {"sound_speed": 20},
        "time": {"end": PULSE},
    }
    return configure(**merged(base, changes))


def compute(outcome: Outcome) -> None:
    """The full model at two spacings, then each variant at the coarser."""
    row = table("simonds2018_316L_spot")[0]
    runs = {
        "full": scene(),
        "full, finer": scene(FINE),
        **{name: scene(**changes) for name, changes in VARIANTS.items()},
    }
    curves = []
    for name, config in runs.items():
        found, _ = watch_pool(config, np.arange(1, 101) * 1e-4)
        size = 0.5 * (found.length + found.width)
        late = found.time > 0.9 * PULSE
        label = f"{name}, dx {config.spacing / UM:.0f} um"
        note = f"ended: {found.failure}" if found.failure else ""
        width, depth = (float(each[late].mean()) if late.any() else np.nan for each in (size, found.depth))
        outcome.show(f"pool width, {label}", width / UM, row["pool_width_um"], unit="um", note=note)
        outcome.show(f"pool depth, {label}", depth / UM, row["pool_depth_um_probable"], unit="um")
        if name == "full":
            begun = found.time[found.depth > 0]
            first = begun[0] / 1e-3 if len(begun) else np.nan
            outcome.show(
                f"first melt, {label}", first, row["time_to_melt_ms"], unit="ms", note="every 0.1 ms"
            )
        outcome.show(f"largest temperature, {label}", found.largest("hottest"), unit="K")
        outcome.show(f"largest speed, {label}", found.largest("fastest"), unit="m/s")
        curves += [Curve(f"width, {label}", found.time / 1e-3, size / UM),
                   Curve(f"depth, {label}", found.time / 1e-3, found.depth / UM, "dashed")]  # fmt: skip
    measured = [row["pool_width_um"], row["pool_depth_um_probable"]]
    curves.append(Curve("measured", [10.0, 10.0], measured, "points"))
    outcome.plot("simonds_spot", "316L spot, 1.2 J in 10 ms", "time / ms", "pool / um", curves)


CASES = [Case("simonds_spot", "Spot of 10 ms on 316L (Simonds 2018)", "measured", "long", compute)]
