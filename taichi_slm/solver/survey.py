"""One look over particles and accounts: the sums that a row of the history and the guards need."""

import numpy as np

from taichi_slm.backend import direct, ti
from taichi_slm.solver.activity import Activity
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import ENERGY, Ledger
from taichi_slm.state import MOBILE, REMOVED, State

PRESENT_MASS, STORED, MOBILE_COUNT, FASTEST, MOMENTUM_SCALE, MOMENTUM = range(6)
"""Places in what a survey returns; behind the momentum's d parts stand the removed mass and the energy accounts."""
HOT, COLD, EVERYBODY = range(3)
COLD_FOR = 8  # builds of lists for which the sums of cold metal are kept; a resumed run counts them on
_OF_COLD = 2  # of them are not zero for a particle that is cold: mass and heat


class Survey:
    """Call it for an array of [present mass, stored heat, mobile, fastest^2, sum m |u|, momentum ...].

    It is taken every ten steps. No pass writes to cold metal, so its mass and heat are summed when the hot rows were
    chosen anew, and kept; and now and then, lest something else wrote. There is no branch in the first loop, and in
    the second one that is hardly ever taken: a hot particle costs 0.7 ns.
    """

    def __init__(self, state: State, disc: Discretisation, ledger: Ledger, activity: Activity):
        d, heat, ordered = disc.dimension, state.needs.heat, disc.schedule.ordered
        self._size = MOMENTUM + d
        self._activity, self._everybody = activity, state.count
        self._cold = np.zeros(_OF_COLD)  # sums of cold metal,
        self._cold_at = (-1, -1)  # and what they belong to: `cold_since`, and which so many builds of lists
        energy, removed_mass = ledger.energy, ledger.removed_mass
        hot_rows, chosen = activity.rows.hot_rows, activity.rows.chosen
        chunks = 1 if ordered else 1024

        @direct
        @ti.kernel
        def survey(
            count: ti.i32, choice: ti.i32, whom: ti.template(), result: ti.types.ndarray(dtype=ti.f64, ndim=1)
        ):
            result[MOMENTUM + d] = removed_mass[None]
            for i in ti.static(range(len(ENERGY))):
                result[MOMENTUM + d + 1 + i] = energy[i]
            ti.loop_config(serialize=ordered)
            for chunk in range(chunks):
                sums = ti.Vector.zero(ti.f64, MOMENTUM + d)
                for k in range(chunk * count // chunks, (chunk + 1) * count // chunks):
                    a = hot_rows[k] if ti.static(whom == HOT) else k
                    there, mass = state.mobility[a] != REMOVED, ti.cast(state.mass[a], ti.f64)
                    if ti.static(whom == COLD):
                        there = there and chosen[a] != choice
                    sums[PRESENT_MASS] += ti.select(there, mass, 0.0)
                    if ti.static(heat):
                        gained = mass * (state.enthalpy[a] - state.enthalpy_initial[a])
                        sums[STORED] += ti.select(there, gained, 0.0)
                for k in range(chunk * count // chunks, (chunk + 1) * count // chunks):
                    a = hot_rows[k] if ti.static(whom == HOT) else k
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
        if self._activity.outgrown:  # none are chosen yet, or a run goes on from here, which chooses anew
            return self._look(EVERYBODY)
        found = self._look(HOT)
        now = (self._activity.cold_since, self._activity.builds // COLD_FOR)
        if self._cold_at != now:
            self._cold, self._cold_at = self._look(COLD)[:_OF_COLD], now
        found[:_OF_COLD] += self._cold
        return found

    def _look(self, whom: int) -> np.ndarray:
        rows = self._activity.rows
        values = np.zeros(self._size + 1 + len(ENERGY))  # an argument: copying a field takes 200 us
        self._survey(rows.hot if whom == HOT else self._everybody, rows.choices, whom, values)
        return values
