"""Where the metal of single grains goes (figure 10), and what a grain that conducts better does (figure 13).

Scene    the 2-D tracks of `tracks`: 150 W with every fourth grain marked, 100 W with every third of twice the
         conductivity; the scenes of configs/track_tracers.yaml and configs/track_doped.yaml
Answer   the paper's words: strong mixing of neighbouring grains is not achieved, part of a grain's metal goes into
         the plate, most stays in the layer; at a conducting grain the pool deepens and shortens
Measured `tracers`: the share of marked particles most of whose neighbours are not marked, when all is solid, over
         what it would be had they been dealt out at random among the metal that was molten; the share below the
         plate's surface. `doped_bed`: pool depth and length while the beam is over a conducting grain (within half a
         radius of its middle), against the same instants of the same track without doping, mean over the grains of
         the steady part (0.4 to 1.0 mm)
"""

import numpy as np

from taichi_slm.analysis.mixing import dispersed, stirred
from taichi_slm.verification.case import Case, Curve, Outcome
from taichi_slm.verification.cases.tracks import DOPED, DX, MARKED, MM, RADIUS, SPEED, START, UM, scene
from taichi_slm.verification.pools import PoolHistory, watch_pool

EVERY = 2e-6  # between measurements of the doped track [s]


def tracers(outcome: Outcome) -> None:
    """The marked track to its end."""
    config = scene(150, MARKED)
    _, sim = watch_pool(config, np.arange(1, 126) * 20e-6)
    names = ("position", "tracer", "ever_liquid", "id")
    position, tracer, ever, number = (sim.arrays(names)[name] for name in names)
    start = sim.scene.position[number]
    molten = ever.astype(bool)
    found = dispersed(position[molten], tracer[molten], DX)
    random = stirred(position[molten], tracer[molten], DX)
    outcome.judge(
        "marked metal dispersed, over that of a random deal",
        found / random,
        error=found / random,
        limit=0.5,
        why="strong mixing is not achieved: layers at least two particles thick are left, not single ones",
    )
    outcome.show("marked metal dispersed", found, note="most of its neighbours are of other grains")
    outcome.show("the same before melting", dispersed(start[molten], tracer[molten], DX))
    marked = (tracer > 0) & molten
    below = float((position[marked, 1] < 0).mean())
    outcome.judge("marked metal below the plate's surface", below, error=below, limit=0.5,
                  why="part of it penetrates, the majority stays in the layer: section 5.1")  # fmt: skip
    moved = position[marked] - start[marked]
    outcome.show("its mean displacement along the track", moved[:, 0].mean() / UM, unit="um")
    outcome.show("standard deviation of that", moved[:, 0].std() / UM, unit="um",
                 note="grains are sheared along the track, over grain distances of 50 um")  # fmt: skip
    outcome.show("its mean displacement upwards", moved[:, 1].mean() / UM, unit="um")
    outcome.plot("tracers", "Marked grains, before and after", "x / um", "y / um",
                 [Curve("after", position[marked, 0] / UM, position[marked, 1] / UM, "points"),
                  Curve("before", start[marked, 0] / UM, start[marked, 1] / UM, "points")])  # fmt: skip


def doped_bed(outcome: Outcome) -> None:
    """The track at 100 W with and without conducting grains, to the end of the beam's path."""
    times = np.arange(1, round(1 * MM / SPEED / EVERY) + 1) * EVERY
    plain, _ = watch_pool(scene(100), times)
    doped, _ = watch_pool(scene(100, DOPED), times)
    depth, length, counted = (_at_grains(plain, doped, name) for name in ("depth", "length", "time"))
    outcome.show("instants compared", len(counted[0]))
    for name, (before, after) in (("depth", depth), ("length", length)):
        outcome.show(f"pool {name} over those grains, not doped", before.mean() / UM, unit="um")
        outcome.show(f"pool {name} over conducting grains", after.mean() / UM, unit="um")
        outcome.show(
            f"pool {name}, standard error of the difference",
            _standard_error(before, after) / UM,
            unit="um",
            note="one grain is one sample",
        )
    outcome.at_least(
        "gain of the pool's depth by doping",
        (depth[1].mean() - depth[0].mean()) / UM,
        limit=0.0,
        unit="um",
        why="a conducting grain deepens the pool: section 5.3",
    )
    outcome.at_least(
        "loss of the pool's length by doping",
        (length[0].mean() - length[1].mean()) / UM,
        limit=0.0,
        unit="um",
        why="and shortens it: section 5.3",
    )
    for name in ("depth", "length"):
        curves = [Curve(label, (START + SPEED * run.time) / MM, getattr(run, name) / UM)
                  for label, run in (("plain", plain), ("every third grain doped", doped))]  # fmt: skip
        outcome.plot(
            f"doped_bed_{name}", f"Doped bed: {name} of the pool", "beam / mm", f"{name} / um", curves
        )


def _at_grains(plain: PoolHistory, doped: PoolHistory, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Values of either run, mean over the instants of each conducting grain in the steady part; shape [grains]."""
    count = min(len(plain.time), len(doped.time))
    beam = START + SPEED * plain.time[:count]
    grain = np.floor((beam - START) / (2 * RADIUS)).astype(int)
    middle = START + RADIUS * (2 * grain + 1)
    chosen = (grain % 3 == 2) & (np.abs(beam - middle) < 0.5 * RADIUS) & (beam > 0.4 * MM) & (beam < 1.0 * MM)
    numbers = np.unique(grain[chosen])
    values = [
        np.array([getattr(run, name)[:count][chosen & (grain == k)].mean() for k in numbers])
        for run in (plain, doped)
    ]
    return values[0], values[1]


def _standard_error(before: np.ndarray, after: np.ndarray) -> float:
    return float(np.std(after - before, ddof=1) / np.sqrt(len(before)))


CASES = [
    Case("tracers", "Where the metal of single grains goes", "paper", "long", tracers),
    Case("doped_bed", "Grains that conduct better", "paper", "long", doped_bed),
]
