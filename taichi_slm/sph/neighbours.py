"""Verlet lists over the particles that have work to do.

The rows are the active particles, in three groups:

    [0, mobile)      particles that move: flow, surface and heat
    [mobile, flow)   still particles beside them: walls, and carriers of the surface's colour
    [flow, total)    particles that only exchange heat

A row has a list of the particles within the `near` radius (flow and heat); rows below `flow` have a second one for
the shell between `near` and `far` (surface terms). Both radii include the skin: the lists stay good until a
particle has moved by half of it. A list among still particles is good for ever, so it is searched once.
"""

from typing import Any

from taichi_slm.backend import ti
from taichi_slm.sph.cells import CELL_MOBILE, CELL_WARM, Cells
from taichi_slm.state import MOBILE, State

RING = 1  # cells between the warm and the rim of the hot set


class Neighbours:
    """Rows and lists; ``mobile``, ``flow`` and ``total`` are the host's copies of the group ends.

    ``near``, ``far`` [m]: radii of the lists, with the skin; ``rim`` [m]: how far beyond the warm cells particles
    count as hot, which is as far as heat can come in one heat step.
    Lists are indexed by particle: ``near[a, j]``, j < ``near_count[a]``.
    """

    def __init__(self, state: State, cells: Cells, near: float, far: float | None, rim: float, dx: float,
                 serial: bool):  # fmt: skip
        d = state.dimension
        self._growth = max(0, cells.reach(rim) - cells.reach(far or near))
        ball = (lambda r: 3.1416 * r**2) if d == 2 else (lambda r: 4.1888 * r**3)
        self.near_capacity = int(1.5 * ball(near / dx)) + 12
        self.far_capacity = int(1.5 * (ball(far / dx) - ball(near / dx))) + 12 if far else 0
        self.rows = ti.field(ti.i32, shape=state.count)
        self.core = ti.field(ti.i32, shape=state.count)  # 1: amid the warm, 0: at the rim of the hot set
        # 1: nobody nearby moves, the near list is good for ever
        self.listed = ti.field(ti.i32, shape=state.count)
        self.near_count = ti.field(ti.i32, shape=state.count)
        self.near = ti.field(ti.i32, shape=(state.count, self.near_capacity))
        if far:
            self.far_count = ti.field(ti.i32, shape=state.count)
            self.far = ti.field(ti.i32, shape=(state.count, self.far_capacity))
        self.ends = ti.field(ti.i32, shape=3)
        self.overflow = ti.field(ti.i32, shape=())  # id of a particle with a full list, or -1
        self.mobile = self.flow = self.total = 0
        # bits: within reach of a mobile cell, of a warm cell ...
        self._zone = ti.field(ti.i32, shape=cells.total)
        self._dilate, self._grow, self._collect = self._compile_rows(state, cells, far or near, serial)
        self._search = self._compile_search(state, cells, near, far)

    def _compile_rows(self, state: State, cells: Cells, radius: float, serial: bool) -> tuple[Any, ...]:
        d = state.dimension
        window, ring = cells.window(cells.reach(radius)), cells.window(RING)
        far2 = radius**2
        rows, core, ends, zone = self.rows, self.core, self.ends, self._zone
        near_mobile, near_warm, beside_warm = 1, 2, 4
        Corner = ti.types.vector(d, ti.f64)

        @ti.kernel
        def dilate():
            for c in zone:
                bits = 0
                if cells.count[c] > 0:
                    for w in range(window.shape[0]):
                        mark = cells.mark[c + window[w]]
                        if mark & CELL_MOBILE:
                            bits |= near_mobile
                        if mark & CELL_WARM:
                            bits |= near_warm
                    if bits & near_warm:
                        for w in range(ring.shape[0]):
                            if cells.mark[c + ring[w]] & CELL_WARM:
                                bits |= beside_warm
                zone[c] = bits

        @ti.kernel
        def grow():
            """One more ring of cells around the hot ones."""
            for c in zone:
                grown[c] = zone[c]
                if cells.count[c] > 0 and (zone[c] & near_warm) == 0:
                    for w in range(ring.shape[0]):
                        if zone[c + ring[w]] & near_warm:
                            grown[c] = zone[c] | near_warm
            for c in zone:
                zone[c] = grown[c]

        @ti.func
        def touches_mobile(a, c):
            found = 0
            for w in range(window.shape[0]):
                e = c + window[w]
                if found == 0 and (cells.mark[e] & CELL_MOBILE) != 0:
                    for slot in range(cells.count[e]):
                        b = cells.items[e, slot]
                        if state.mobility[b] == MOBILE:
                            if (state.position[a] - state.position[b]).norm_sqr() < far2:
                                found = 1
            return found

        @ti.func
        def lit(a, low, high):
            x = ti.cast(state.position[a], ti.f64)
            inside = 1
            for axis in ti.static(range(d)):
                if x[axis] < low[axis] or x[axis] > high[axis]:
                    inside = 0
            return inside

        @ti.func
        def append(group, a, amid):
            k = ti.atomic_add(ends[group], 1)
            rows[k] = a
            core[k] = amid

        @ti.kernel
        def collect(all_flow: ti.i32, all_hot: ti.i32, low: Corner, high: Corner):
            ends[0] = 0
            ti.loop_config(serialize=serial)
            for c in zone:
                if (cells.mark[c] & CELL_MOBILE) != 0:
                    for slot in range(cells.count[c]):
                        a = cells.items[c, slot]
                        if state.mobility[a] == MOBILE:
                            append(0, a, 1)
            ends[1] = ends[0]
            ti.loop_config(serialize=serial)
            for c in zone:
                if all_flow == 1 or (all_flow == 0 and (zone[c] & near_mobile) != 0):
                    for slot in range(cells.count[c]):
                        a = cells.items[c, slot]
                        chosen[a] = 0
                        if state.mobility[a] != MOBILE:
                            if all_flow == 1 or touches_mobile(a, c):
                                chosen[a] = 1
                                append(1, a, ti.cast(all_hot == 1 or (zone[c] & beside_warm) != 0, ti.i32))
            ends[2] = ends[1]
            ti.loop_config(serialize=serial)
            for c in zone:
                if all_hot >= 0:
                    warm = all_hot == 1 or (zone[c] & near_warm) != 0
                    for slot in range(cells.count[c]):
                        a = cells.items[c, slot]
                        if state.mobility[a] != MOBILE and (warm or lit(a, low, high)):
                            if (
                                all_flow < 0
                                or (all_flow == 0 and (zone[c] & near_mobile) == 0)
                                or chosen[a] == 0
                            ):
                                append(2, a, ti.cast(all_hot == 1 or (zone[c] & beside_warm) != 0, ti.i32))

        chosen = ti.field(ti.i32, shape=state.count)
        grown = ti.field(ti.i32, shape=cells.total)
        return dilate, grow, collect

    def _compile_search(self, state: State, cells: Cells, near: float, far: float | None) -> Any:
        needs_flow, wide_lists = state.needs.flow, far is not None
        window, near_window = cells.window(cells.reach(far or near)), cells.window(cells.reach(near))
        near2, far2 = near**2, (far or near) ** 2
        rows, ends, listed, overflow = self.rows, self.ends, self.listed, self.overflow
        near_capacity, far_capacity = self.near_capacity, self.far_capacity

        @ti.func
        def search_near(a, x, c):
            n = 0
            for w in range(near_window.shape[0]):
                e = c + near_window[w]
                for slot in range(cells.count[e]):
                    b = cells.items[e, slot]
                    if (x - state.position[b]).norm_sqr() < near2 and b != a:
                        if n < near_capacity:
                            self.near[a, n] = b
                        n += 1
            if n > near_capacity:
                overflow[None] = a
            self.near_count[a] = ti.min(n, near_capacity)

        @ti.func
        def search_both(a, x, c):
            n = 0
            m = 0
            for w in range(window.shape[0]):
                e = c + window[w]
                for slot in range(cells.count[e]):
                    b = cells.items[e, slot]
                    r2 = (x - state.position[b]).norm_sqr()
                    if r2 < near2:
                        if b != a:
                            if n < near_capacity:
                                self.near[a, n] = b
                            n += 1
                    elif r2 < far2:
                        if m < far_capacity:
                            self.far[a, m] = b
                        m += 1
            if n > near_capacity or m > far_capacity:
                overflow[None] = a
            self.near_count[a] = ti.min(n, near_capacity)
            self.far_count[a] = ti.min(m, far_capacity)

        @ti.kernel
        def search():
            overflow[None] = -1
            for k in range(ends[2]):
                a = rows[k]
                x = state.position[a]
                c = cells.cell_of(x)
                if ti.static(needs_flow):
                    if state.mobility[a] == MOBILE:
                        state.reference_position[a] = x
                settled = k >= ends[1]  # nobody who moves is within reach
                if ti.static(wide_lists):
                    if not settled:
                        search_both(a, x, c)
                elif ti.static(needs_flow):
                    if not settled:
                        search_near(a, x, c)
                if settled and listed[a] == 0:
                    search_near(a, x, c)
                listed[a] = ti.cast(settled, ti.i32)

        return search

    def build(self, all_flow: int, all_hot: int, beam: tuple[Any, Any]) -> None:
        """Choose the rows and search their lists.

        ``all_flow``, ``all_hot``: 1 takes every particle, 0 only those with work, -1 none.
        ``beam``: lowest and highest corner [m] of the box in which particles are lit.
        """
        self._dilate()
        for _ in range(self._growth):
            self._grow()
        self._collect(all_flow, all_hot, *beam)
        self.mobile, self.flow, self.total = (int(n) for n in self.ends.to_numpy())
        self._search()

    def forget(self) -> None:
        """Search every list anew at the next build."""
        self.listed.fill(0)
