"""The paper's validation: one pulse of 1967 W and 3 ms melts a pool into a plate of 304 steel.

Scene    plate 1.6 x 1.6 x 0.9 mm, 3-D, full flow; beam radius w = 0.428 mm, I = f A P/(pi w^2) exp(-f r^2/w^2);
         viscosity as in the paper's Table 1; the scene of configs/spot_weld_3ms.yaml
Answer   measured by He, Fuerschbach, DebRoy 2003: radius 0.48 mm, depth 0.26 mm. The paper: 0.46, 0.25 mm at dx = 50
         um
Measured the isotherm (T_s + T_l)/2 of the connected pool, every 25 us: radius is a quarter of its extents in x and y,
         depth its lowest point; the mean from 2.9 ms, when it is as large as it gets, to 3.2 ms, since equal runs
         scatter at one instant
Inputs   A = 0.33, f = 3: one set for all spacings. Neither is known (the literature has A of 0.27 to 0.33, f of 2 or
         3), so they are chosen on this case, and the sensitivity is shown: the case says how far the model can meet a
         pool, not that it predicts one

`spot_weld` is 50 um, where agreement is partly luck (the pool is five particles deep); `spot_weld_fine` is where it
is judged.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_slm.config.schema import Config
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.measured import table
from taichi_slm.verification.pools import watch_pool
from taichi_slm.verification.scenes import configure, merged

UM, MM, MS = 1e-6, 1e-3, 1e-3
END, WINDOW = 3.2e-3, 2.9e-3  # [s]
LIMIT = 0.05
WELD_STEEL = {"extends": "steel_304", "viscosity": {"solid": {"constant": 1.0}, "liquid": {"constant": 0.01}}}


def scene(spacing: float = 50e-6, **laser: Any) -> Config:
    """The weld at ``spacing`` [m], its laser changed by ``laser``."""
    beam = {
        "power": 1967, "beam_radius": "0.428 mm", "exponent": 3, "absorptivity": 0.33,
        "path": [{"kind": "dwell", "at": ["6.5 um", "4 um"], "duration": "3 ms"}],
    }  # fmt: skip
    return configure(
        dimension=3,
        spacing=spacing,
        materials={"weld_steel": WELD_STEEL},
        bodies=[
            {
                "shape": "plate",
                "material": "weld_steel",
                "start": "-0.8 mm",
                "length": "1.6 mm",
                "width": "1.6 mm",
                "depth": "0.9 mm",
                "cold_layers": 3,
            }
        ],
        laser=merged(beam, laser),
        numerics={"sound_speed": 20},
        time={"end": "16 ms"},
    )


@dataclass(frozen=True)
class Pool:
    """Radius and depth over time [mm], and their means."""

    time: np.ndarray  # [ms]
    radii: np.ndarray
    depths: np.ndarray
    radius: float
    depth: float
    hottest: float  # [K]
    removed: float  # [kg]


def weld(config: Config) -> Pool:
    """Run it to just after the pulse."""
    found, _ = watch_pool(config, np.arange(1, 129) * 25e-6)
    radii = 0.25 * (found.length + found.width)
    late = (found.time > WINDOW) & (found.time <= END + 1e-9)
    means = (float(radii[late].mean()), float(found.depth[late].mean())) if late.any() else (np.nan, np.nan)
    return Pool(found.time / MS, radii / MM, found.depth / MM, means[0] / MM, means[1] / MM,
                found.largest("hottest"), found.removed_kg)  # fmt: skip


def measured() -> tuple[float, float]:
    """Radius and depth of the pool [mm]."""
    row = table("he2003_304_spot")[0]
    return row["pool_radius_mm"], row["pool_depth_mm"]


def _show(outcome: Outcome, name: str, pool: Pool, note: str = "") -> None:
    radius, depth = measured()
    outcome.show(f"pool radius, {name}", pool.radius, radius, unit="mm", note=note)
    outcome.show(f"pool depth, {name}", pool.depth, depth, unit="mm", note=note)
    outcome.show(f"largest temperature, {name}", pool.hottest, unit="K")


def _plot(outcome: Outcome, name: str, pools: dict[str, Pool]) -> None:
    curves = [Curve(f"radius, {label}", pool.time, pool.radii) for label, pool in pools.items()]
    curves += [Curve(f"depth, {label}", pool.time, pool.depths, "dashed") for label, pool in pools.items()]
    curves += [Curve("measured", [3.0, 3.0], list(measured()), "points")]
    outcome.plot(name, "Spot weld, 1967 W, 3 ms", "time / ms", "pool / mm", curves)


def coarse(outcome: Outcome) -> None:
    """The shipped scene at 50 um."""
    pool = weld(scene())
    radius, depth = measured()
    for name, value, exact in (("radius", pool.radius, radius), ("depth", pool.depth, depth)):
        outcome.judge(f"pool {name}, dx 50 um", value, exact, limit=0.1, unit="mm",
                      why="half a spacing is a tenth of the depth; 5 % is judged where it is finer")  # fmt: skip
    outcome.show("largest temperature", pool.hottest, unit="K")
    outcome.show("metal removed", pool.removed, unit="kg")
    _plot(outcome, "spot_weld", {"dx 50 um": pool})


def fine(outcome: Outcome) -> None:
    """50, 33 and 25 um with one set of inputs; then what A and f do, at 50 um."""
    pools = {f"dx {round(dx / UM)} um": weld(scene(dx)) for dx in (50e-6, 1e-3 / 30, 25e-6)}
    for name, pool in pools.items():
        _show(outcome, name, pool)
    finest, (radius, depth) = pools["dx 25 um"], measured()
    for name, value, exact in (("radius", finest.radius, radius), ("depth", finest.depth, depth)):
        outcome.judge(f"pool {name}, finest", value, exact, limit=LIMIT, unit="mm",
                      why="equal runs scatter by 5 % in depth; the paper claims 4 % at 50 um")  # fmt: skip
    _plot(outcome, "spot_weld_fine", pools)
    for exponent in (2, 3):
        for absorptivity in (0.27, 0.30, 0.33):
            pool = weld(scene(absorptivity=absorptivity, exponent=exponent))
            _show(
                outcome,
                f"A {absorptivity:.2f}, f {exponent}, dx 50 um",
                pool,
                "sensitivity: neither is known",
            )


CASES = [
    Case("spot_weld", "Spot weld of 304 steel, 50 um", "paper", "full", coarse),
    Case(
        "spot_weld_fine", "Spot weld of 304 steel, down to 25 um, and what A and f do", "paper", "long", fine
    ),
]
