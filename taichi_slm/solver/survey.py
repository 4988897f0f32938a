"""One look over all particles: the sums and extremes that a row of the history needs, without copying fields."""

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.state import MOBILE, REMOVED, State

PRESENT_MASS, STORED, MOBILE_COUNT, HOTTEST, FASTEST, MOMENTUM_SCALE, MOMENTUM = range(7)


class Survey:
    """Call it for an array of [present mass, stored heat, mobile, hottest, fastest^2, sum m |u|, momentum ...]."""

    def __init__(self, state: State, disc: Discretisation):
        d, heat, ordered = disc.dimension, state.needs.heat, disc.schedule.ordered
        self.result = ti.field(ti.f64, shape=MOMENTUM + d)
        result = self.result
        chunks = 1 if ordered else 1024
        count = state.count

        @ti.kernel
        def survey():
            for i in range(MOMENTUM + d):
                result[i] = 0.0
            ti.loop_config(serialize=ordered)
            for chunk in range(chunks):
                sums = ti.Vector.zero(ti.f64, MOMENTUM + d)
                for a in range(chunk * count // chunks, (chunk + 1) * count // chunks):
                    if state.mobility[a] != REMOVED:
                        mass = ti.cast(state.mass[a], ti.f64)
                        sums[PRESENT_MASS] += mass
                        if ti.static(heat):
                            sums[STORED] += mass * (state.enthalpy[a] - state.enthalpy_initial[a])
                        sums[HOTTEST] = ti.max(sums[HOTTEST], ti.cast(state.temperature[a], ti.f64))
                        if state.mobility[a] == MOBILE:
                            u = ti.cast(state.velocity[a], ti.f64)
                            sums[MOBILE_COUNT] += 1.0
                            sums[FASTEST] = ti.max(sums[FASTEST], u.norm_sqr())
                            sums[MOMENTUM_SCALE] += mass * u.norm()
                            for axis in ti.static(range(d)):
                                sums[MOMENTUM + axis] += mass * u[axis]
                for i in ti.static(range(MOMENTUM + d)):
                    if ti.static(i in (HOTTEST, FASTEST)):
                        ti.atomic_max(result[i], sums[i])
                    else:
                        ti.atomic_add(result[i], sums[i])

        self._survey = survey

    def __call__(self) -> np.ndarray:
        """Look, and return the numbers, shape [6 + d]."""
        self._survey()
        values: np.ndarray = self.result.to_numpy()
        return values
