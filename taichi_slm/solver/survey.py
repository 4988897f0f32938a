"""One look over all particles and accounts: the sums that a row of the history and the guards need."""

import numpy as np

from taichi_slm.backend import direct, ti
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.solver.ledger import ENERGY, Ledger
from taichi_slm.state import MOBILE, REMOVED, State

PRESENT_MASS, STORED, MOBILE_COUNT, FASTEST, MOMENTUM_SCALE, MOMENTUM = range(6)
"""Places in what a survey returns; behind the momentum's d parts stand the removed mass and the energy accounts."""


class Survey:
    """Call it for an array of [present mass, stored heat, mobile, fastest^2, sum m |u|, momentum ...].

    It is taken every ten steps, of all metal: no branch in the first loop, and in the second one that is hardly ever
    taken, so that a cold particle costs 0.7 ns.
    """

    def __init__(self, state: State, disc: Discretisation, ledger: Ledger):
        d, heat, ordered = disc.dimension, state.needs.heat, disc.schedule.ordered
        self._size = MOMENTUM + d
        energy, removed_mass = ledger.energy, ledger.removed_mass
        chunks = 1 if ordered else 1024
        count = state.count

        @direct
        @ti.kernel
        def survey(result: ti.types.ndarray(dtype=ti.f64, ndim=1)):
            for _ in range(1):
                result[MOMENTUM + d] = removed_mass[None]
                for i in ti.static(range(len(ENERGY))):
                    result[MOMENTUM + d + 1 + i] = energy[i]
            ti.loop_config(serialize=ordered)
            for chunk in range(chunks):
                sums = ti.Vector.zero(ti.f64, MOMENTUM + d)
                for a in range(chunk * count // chunks, (chunk + 1) * count // chunks):
                    there, mass = state.mobility[a] != REMOVED, ti.cast(state.mass[a], ti.f64)
                    sums[PRESENT_MASS] += ti.select(there, mass, 0.0)
                    if ti.static(heat):
                        gained = mass * (state.enthalpy[a] - state.enthalpy_initial[a])
                        sums[STORED] += ti.select(there, gained, 0.0)
                for a in range(chunk * count // chunks, (chunk + 1) * count // chunks):
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
        values = np.zeros(self._size + 1 + len(ENERGY))  # an argument: copying a field takes 200 us
        self._survey(values)
        return values
