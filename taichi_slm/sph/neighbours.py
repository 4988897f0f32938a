"""Verlet lists over the particles that have work to do.

The rows of the lists are the active particles, in three groups, each in the order of ids:

    [0, mobile)      particles that move: flow, surface and heat
    [mobile, flow)   still particles beside them: walls, and carriers of the surface's colour
    [flow, rows)     particles that only exchange heat

Every row has a list of the particles within the `near` radius (flow and heat); rows below `flow` have a second
one for the shell between `near` and `far` (surface terms). Both radii include the skin: the lists stay good until
a particle has moved by half of it.
"""

from typing import Any

from taichi_slm.backend import ti
from taichi_slm.sph.cells import CELL_MOBILE, CELL_WARM, Cells
from taichi_slm.state import MOBILE, REMOVED, State


class Neighbours:
    """Rows and lists; ``mobile``, ``flow`` and ``total`` are the host's copies of the group ends."""

    def __init__(self, state: State, cells: Cells, near: float, far: float | None, dx: float, serial: bool):
        d = state.dimension
        ball = (lambda r: 3.1416 * r**2) if d == 2 else (lambda r: 4.1888 * r**3)
        self.near_capacity = int(1.5 * ball(near / dx)) + 12
        self.far_capacity = int(1.5 * (ball(far / dx) - ball(near / dx))) + 12 if far else 0
        self.rows = ti.field(ti.i32, shape=state.count)
        self.core = ti.field(ti.i32, shape=state.count)  # 1: amid the warm, 0: at the rim of the hot set
        self.near_count = ti.field(ti.i32, shape=state.count)
        self.near = ti.field(ti.i32, shape=(state.count, self.near_capacity))
        if far:
            self.far_count = ti.field(ti.i32, shape=state.count)
            self.far = ti.field(ti.i32, shape=(state.count, self.far_capacity))
        self.ends = ti.field(ti.i32, shape=3)
        self.overflow = ti.field(ti.i32, shape=())  # id of a particle with a full list, or -1
        self.mobile = self.flow = self.total = 0
        self._kernels = self._compile(state, cells, near, far, serial)

    def _compile(self, state: State, cells: Cells, near: float, far: float | None, serial: bool) -> tuple[Any, Any]:
        d = state.dimension
        radius = far or near
        reach = int(-(-radius // cells.size))
        reach = reach if reach * cells.size >= radius else reach + 1
        near2, far2, wide_lists = near**2, radius**2, far is not None
        rows, core, ends, overflow = self.rows, self.core, self.ends, self.overflow
        window = (2 * reach + 1,) * d
        Beam = ti.types.vector(d, ti.f64)
        chosen = ti.field(ti.i32, shape=state.count)

        @ti.func
        def marked(c, bit, ring):
            found = 0
            for offset in ti.grouped(ti.ndrange(*((-ring, ring + 1),) * d)):
                if found == 0 and cells.exists(c + offset) and (cells.mark[c + offset] & bit) != 0:
                    found = 1
            return found

        @ti.func
        def touches_mobile(a):
            found = 0
            c = cells.cell_of(state.position[a])
            for offset in ti.grouped(ti.ndrange(*((-reach, reach + 1),) * d)):
                e = c + offset
                if found == 0 and cells.exists(e) and (cells.mark[e] & CELL_MOBILE) != 0:
                    for slot in range(cells.count[e]):
                        b = cells.items[e, slot]
                        if state.mobility[b] == MOBILE:
                            if (state.position[a] - state.position[b]).norm_sqr() < far2:
                                found = 1
            return found

        @ti.kernel
        def collect(all_flow: ti.i32, all_hot: ti.i32, beam_low: Beam, beam_high: Beam):
            ends[0] = 0
            ends[1] = 0
            ends[2] = 0
            ti.loop_config(serialize=serial)
            for a in range(state.count):
                if state.mobility[a] == MOBILE:
                    k = ti.atomic_add(ends[0], 1)
                    rows[k] = a
                    core[k] = 1
            ends[1] = ends[0]
            ti.loop_config(serialize=serial)
            for a in range(state.count):
                if state.mobility[a] != MOBILE and state.mobility[a] != REMOVED and all_flow >= 0:
                    c = cells.cell_of(state.position[a])
                    member = all_flow
                    if member == 0 and marked(c, CELL_MOBILE, reach):
                        member = touches_mobile(a)
                    if member != 0:
                        k = ti.atomic_add(ends[1], 1)
                        rows[k] = a
                        core[k] = ti.max(all_hot, marked(c, CELL_WARM, 1))
                        chosen[a] = 1
            ends[2] = ends[1]
            ti.loop_config(serialize=serial)
            for a in range(state.count):
                taken = chosen[a]
                chosen[a] = 0
                if state.mobility[a] != MOBILE and state.mobility[a] != REMOVED and taken == 0 and all_hot >= 0:
                    x = state.position[a]
                    c = cells.cell_of(x)
                    lit = 1
                    for axis in ti.static(range(d)):
                        if x[axis] < beam_low[axis] or x[axis] > beam_high[axis]:
                            lit = 0
                    if all_hot == 1 or lit == 1 or marked(c, CELL_WARM, reach):
                        k = ti.atomic_add(ends[2], 1)
                        rows[k] = a
                        core[k] = ti.max(all_hot, marked(c, CELL_WARM, 1))

        @ti.kernel
        def search():
            overflow[None] = -1
            for k in range(ends[2]):
                a = rows[k]
                x = state.position[a]
                c = cells.cell_of(x)
                wide = k < ends[1]
                n = 0
                m = 0
                for offset in ti.grouped(ti.ndrange(*window)):
                    e = c + offset - reach
                    if cells.exists(e):
                        for slot in range(ti.min(cells.count[e], cells.capacity)):
                            b = cells.items[e, slot]
                            r2 = (x - state.position[b]).norm_sqr()
                            if r2 < near2:
                                if b != a:
                                    if n < self.near_capacity:
                                        self.near[k, n] = b
                                    n += 1
                            elif ti.static(wide_lists):
                                if wide and r2 < far2:
                                    if m < self.far_capacity:
                                        self.far[k, m] = b
                                    m += 1
                if n > self.near_capacity or m > self.far_capacity:
                    overflow[None] = a
                self.near_count[k] = ti.min(n, self.near_capacity)
                if ti.static(wide_lists):
                    self.far_count[k] = ti.min(m, self.far_capacity)
                if ti.static(state.needs.flow):
                    if state.mobility[a] == MOBILE:
                        state.reference_position[a] = x

        return collect, search

    def build(self, all_flow: int, all_hot: int, beam: tuple[Any, Any]) -> None:
        """Choose the rows and search their lists.

        ``all_flow``, ``all_hot``: 1 takes every particle, 0 only those with work, -1 none.
        ``beam``: lowest and highest corner [m] of the box in which particles are lit.
        """
        collect, search = self._kernels
        collect(all_flow, all_hot, *beam)
        self.mobile, self.flow, self.total = (int(n) for n in self.ends.to_numpy())
        search()
