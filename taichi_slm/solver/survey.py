"""One look over particles and accounts: the sums that a row of the history and the guards need."""

import numpy as np

from taichi_slm.backend import direct, ti
from taichi_slm.solver.activity import Activity
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import ENERGY, Ledger
from taichi_slm.state import MOBILE, REMOVED, State

PRESENT_MASS, STORED, MOBILE_COUNT, FASTEST, MOMENTUM_SCALE, MOMENTUM = range(6)
"""Places in what a survey returns; behind the momentum's d parts stand the removed mass and the energy accounts."""
_OF_COLD = 2  # of them are not zero for a particle that is cold: mass and heat


class Survey:
    """Call it for an array of [present mass, stored heat, mobile, fastest^2, sum m |u|, momentum ...].

    It is taken every ten steps. No pass writes to cold metal, so its mass and heat are summed when the hot rows were
    chosen anew, and kept. There is no branch in the first loop, and in the second one that is hardly ever taken: a
    hot particle costs 0.7 ns.
    """

    def __init__(self, state: State, disc: Discretisation, ledger: Ledger, activity: Activity):
        d, heat, ordered = disc.dimension, state.needs.heat, disc.schedule.ordered
        self._size = MOMENTUM + d
        self._activity, self._everybody = activity, state.count
        self._cold = np.zeros(_OF_COLD)  # sums of cold metal,
        self._cold_at = -1  # and the value of `cold_since` that they belong to
        energy, removed_mass, hot_rows = ledger.energy, ledger.removed_mass, activity.rows.hot_rows
        chunks = 1 if ordered else 1024

        @direct
        @ti.kernel
        def survey(count: ti.i32, everybody: ti.template(), result: ti.types.ndarray(dtype=ti.f64, ndim=1)):
            for _ in range(1):
                result[MOMENTUM + d] = removed_mass[None]
                for i in ti.static(range(len(ENERGY))):
                    result[MOMENTUM + d + 1 + i] = energy[i]
            ti.loop_config(serialize=ordered)
            for chunk in range(chunks):
                sums = ti.Vector.zero(ti.f64, MOMENTUM + d)
                for k in range(chunk * count // chunks, (chunk + 1) * count // chunks):
                    a = k if ti.static(everybody) else hot_rows[k]
                    there, mass = state.mobility[a] != REMOVED, ti.cast(state.mass[a], ti.f64)
                    sums[PRESENT_MASS] += ti.select(there, mass, 0.0)
                    if ti.static(heat):
                        gained = mass * (state.enthalpy[a] - state.enthalpy_initial[a])
                        sums[STORED] += ti.select(there, gained, 0.0)
                for k in range(chunk * count // chunks, (chunk + 1) * count // chunks):
                    a = k if ti.static(everybody) else hot_rows[k]
                    if state.mobility[a] == MOBILE:
                        mass, u = ti.cast(state.mass[a], ti.f64), ti.cast(state.velocity[a], ti.f64)
                        sums[MOBILE_COUNT] += 1.0
                        sums[FASTEST] = ti.max(sums[FASTEST], u.norm_sqr())
                        sums[MOMENTUM_SCALE] += mass * u.norm()
                        for axis in ti.static(range(d)):
                            sums[MOMENTUM + axis] += mass * u[axis]
                for i in ti.static(range(MOMENTUM + d)):
                    if ti.static(i == FASTEST):
                        ti.atomic_max(result[i], sums[i])
                    else:
                        ti.atomic_add(result[i], sums[i])

        self._survey = survey

    def __call__(self) -> np.ndarray:
        """Look, and return the numbers, shape [6 + d + accounts of energy]."""
        hot = self._activity.rows.hot
        if self._activity.outgrown:  # none are chosen yet, or a run goes on from here, which chooses anew
            return self._look(self._everybody, True)
        found = self._look(hot, False)
        if self._cold_at != self._activity.cold_since:
            self._cold = self._look(self._everybody, True)[:_OF_COLD] - found[:_OF_COLD]
            self._cold_at = self._activity.cold_since
        found[:_OF_COLD] += self._cold
        return found

    def _look(self, count: int, everybody: bool) -> np.ndarray:
        values = np.zeros(self._size + 1 + len(ENERGY))  # an argument: copying a field takes 200 us
        self._survey(count, everybody, values)
        return values
