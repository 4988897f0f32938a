"""Particles that leave: out of the domain, or alone. They are removed as in the paper, and accounted for.

A lone particle under the beam has nobody to conduct to and heats without limit; the paper removes "particles
ejected from the melt-pool". A removed particle keeps its place but has no mass and no volume, so that it drops out
of every sum.
"""

from typing import Any

import numpy as np

from taichi_slm.backend import direct, ti
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import ENERGY, MOMENTUM, Ledger
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import MOBILE, REMOVED, State


class Ejection:
    """The pass that removes; ``minimum`` is the number of neighbours within 2 h below which a particle is alone."""

    def __init__(self, state: State, rows: Neighbours, disc: Discretisation, ledger: Ledger,
                 lower: np.ndarray, upper: np.ndarray, minimum: int):  # fmt: skip
        d, ordered = disc.dimension, disc.schedule.ordered
        low, high = ti.Vector([float(x) for x in lower]), ti.Vector([float(x) for x in upper])
        support2 = disc.flow_kernel.support**2
        removed_heat, removed_momentum = ENERGY.index("removed"), MOMENTUM.index("removed")
        self._rows = rows
        self.count = ti.field(ti.i32, shape=())
        found = self.count

        @ti.func
        def leaves(a):
            x = state.position[a]
            out = 0
            for axis in ti.static(range(d)):
                if x[axis] < low[axis] or x[axis] > high[axis]:
                    out = 1
            if ti.static(minimum > 0):
                near = 0
                for j in range(rows.near_count[a]):
                    if (x - state.position[rows.near[a, j]]).norm_sqr() < support2:
                        near += 1
                if near < minimum:
                    out = 1
            return out

        @direct
        @ti.kernel
        def remove(mobile: ti.i32):
            found[None] = 0
            ti.loop_config(serialize=ordered)
            for k in range(mobile):
                a = rows.rows[k]
                if state.mobility[a] == MOBILE and leaves(a):
                    mass = ti.cast(state.mass[a], ti.f64)
                    ti.atomic_add(found[None], 1)
                    ti.atomic_add(ledger.removed[None], 1)
                    ti.atomic_add(ledger.removed_mass[None], mass)
                    for axis in ti.static(range(d)):
                        ti.atomic_add(ledger.momentum[removed_momentum][axis], mass * state.velocity[a][axis])
                    if ti.static(state.needs.heat):
                        heat = mass * (state.enthalpy[a] - state.enthalpy_initial[a])
                        ti.atomic_add(ledger.energy[removed_heat], heat)
                    if ti.static(state.needs.viscous_heating):
                        state.viscous_work[a] = 0.0
                    state.mobility[a] = REMOVED
                    state.mass[a] = 0.0
                    state.volume[a] = 0.0
                    state.velocity[a] = state.velocity[a] * 0.0

        self._remove: Any = remove

    def step(self) -> int:
        """Remove who has left; returns how many."""
        self._remove(self._rows.mobile)
        return int(self.count[None])
