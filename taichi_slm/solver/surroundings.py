"""What its neighbours say of a particle, for the heat passes: found once where nobody moves, as the lists are.

slopes             V_b F of every neighbour, in 2-D: a heat step has some five stages, which all read them
conduction_factor  what the neighbours that are missing at a surface would have carried
surface_area       surface per volume that radiates and evaporates
"""

from typing import Any

from taichi_slm.backend import Blocks, handed_out, ti
from taichi_slm.physics.conduction import own_factor, side_asymmetry
from taichi_slm.physics.continuity import flat_table
from taichi_slm.physics.radiation import area_density
from taichi_slm.solver.discretisation import Discretisation
from taichi_slm.sph.neighbours import FOUND, SETTLED, Neighbours
from taichi_slm.sph.symmetric import symmetric
from taichi_slm.state import State


def keeps_slopes(dimension: int) -> bool:
    """Whether lists have a slope beside each entry: in 3-D there are a hundred, and no memory to spare for them."""
    return dimension == 2


class Surroundings:
    """The pass over the hot rows whose neighbours may have moved, or whose lists are new.

    ``slope``: the Taichi function (particle a, j, its neighbour b = near[a, j], place of a) -> V_b F [1/m^2].
    """

    def __init__(self, state: State, rows: Neighbours, disc: Discretisation):
        self._rows, self._schedule = rows, disc.schedule
        own = disc.numerics.conduction_correction and disc.numerics.conduction_moment == "own"
        losses, keeps = state.needs.losses, keeps_slopes(disc.dimension)
        self.slopes: Any = Blocks(state.count).field(disc.real, rows.near_capacity) if keeps else None
        slopes: Any = self.slopes
        slope_at = _slope_at(state, disc)
        self.slope = slope = _slope(slopes, slope_at)
        factor_of = _conduction_factor(state, rows, disc, slope) if own else None
        area_of = _radiating_area(state, rows, disc) if losses else None
        state.conduction_factor.fill(1.0 / disc.conduction_moment)
        expands = disc.numerics.solid_density == "true"  # the volumes of still particles change, too
        self._has_work = own or losses or keeps

        @handed_out
        @ti.kernel
        def look(hot: ti.i32, alone: ti.template()):
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = rows.hot_rows[k]
                if expands or rows.listed[a] != SETTLED:
                    if ti.static(keeps):
                        for j in range(rows.near_count[a]):
                            slopes[a, j] = slope_at(rows.near[a, j], state.position[a])
                    if ti.static(own):
                        state.conduction_factor[a] = factor_of(a)
                    if ti.static(losses):
                        state.surface_area[a] = area_of(a)
                    if rows.listed[a] == FOUND:
                        rows.listed[a] = SETTLED

        self._look: Any = look

    def look(self) -> None:
        """Write factors and areas; mark lists that were new as settled."""
        if self._has_work:  # a quarter of the rows is about what moves
            self._look(self._rows.hot, self._schedule.alone(self._rows.hot // 4))


def _slope_at(state: State, disc: Discretisation) -> Any:
    """The Taichi function (particle b, place x) -> V_b F."""
    _, F = disc.flow_kernel.functions()

    @ti.func
    def at(b, x):
        return state.volume[b] * F((x - state.position[b]).norm_sqr())

    return at


def _slope(slopes: Any, slope_at: Any) -> Any:
    """The Taichi function that `Surroundings` tells of; ``slopes``: the kept ones, or None."""
    kept = slopes is not None

    @ti.func
    def of(a, j, b, x):
        result = x[0] * 0.0
        if ti.static(kept):  # noqa: SIM108 - Taichi compiles both sides of the other form
            result = slopes[a, j]
        else:
            result = slope_at(b, x)
        return result

    return of


def _conduction_factor(state: State, rows: Neighbours, disc: Discretisation, slope: Any) -> Any:
    """The Taichi function a -> factor of its conduction from the moments of its own neighbours."""
    factor = own_factor(disc.dimension, disc.conduction_moment, side_asymmetry(disc.flow_kernel, disc.dx))
    products, matrix = symmetric(disc.dimension)

    @ti.func
    def of(a):
        x = state.position[a]
        first = x * 0.0
        length = x[0] * 0.0
        moment = products(first)
        for j in range(rows.near_count[a]):
            b = rows.near[a, j]
            r = x - state.position[b]
            weight = -slope(a, j, b, x)
            first += weight * r
            length += weight * r.norm()
            moment += weight * products(r)
        return factor(matrix(moment), first, length)

    return of


def _radiating_area(state: State, rows: Neighbours, disc: Discretisation) -> Any:
    """The Taichi function a -> surface per volume [1/m] that radiates and evaporates."""
    d = disc.dimension
    corrected = disc.numerics.surface_area == "corrected"
    density = area_density(d, flat_table(disc.flat.depth, disc.flat, disc.h_surface, disc.real))
    W, F = disc.flow_kernel.functions()
    at_zero = float(disc.flow_kernel.value(0.0))

    @ti.func
    def of(a):
        result = state.colour_strength[a]
        normal = state.normal[a]
        if ti.static(corrected):
            if normal.norm_sqr() > 0.5:
                x = state.position[a]
                divergence = x[0] * 0.0
                weight = state.volume[a] * at_zero
                for j in range(rows.near_count[a]):
                    b = rows.near[a, j]
                    r = x - state.position[b]
                    r2 = r.norm_sqr()
                    V_b = state.volume[b] * ti.cast(state.normal[b].norm_sqr() > 0.5, disc.real)
                    divergence += V_b * F(r2) * (state.normal[b] - normal).dot(r)
                    weight += V_b * W(r2)
                result = density(result, -divergence / weight)
        return result

    return of
