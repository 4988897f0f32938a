"""Verlet lists over the particles that have work to do.

Two sets of rows:

    hot_rows [0, hot)   particles that exchange heat, and those that move; chosen by whole cells, for many steps
    rows [0, mobile)    particles that move: flow and surface
    rows [mobile, flow) still particles beside them: walls, and carriers of the surface's colour

A row has a list of the particles within the `near` radius (flow and heat); flow rows have a second one for the shell
between `near` and `far` (surface terms). Both radii include the skin: the lists stay good until a particle is half of
it away from its reference position. A list among still particles is good for ever, so it is searched once, and without
a skin.
"""

from typing import Any

import numpy as np

from taichi_slm.backend import Blocks, Schedule, direct, handed_out, ti
from taichi_slm.sph.cells import Cells
from taichi_slm.state import MOBILE, REMOVED, STILL, State

RING = 1  # cells between the active ones and the rim of the hot set
ANEW, FOUND, SETTLED = 0, 1, 2  # values of `listed`: search when next needed; found just now; good for ever
HOT, CORE, GROWN = 1, 2, 4  # bits of a cell's zone; the last while a ring is added
# Room in a list over the neighbours on a lattice, and on top of that, by dimension: metal is not packed 1.1 times as
# densely. The fewer there are the more their number scatters, and the rings that a scene in 2-D may begin with have
# some more in their centre. Of the shipped scenes the fullest lists hold 28 and 34 (2-D, of room for 43 and 44), and
# 99 and 187 (3-D, of 109 and 206).
LIST_ROOM, LIST_SPARE = 1.15, {2: 15, 3: 4}


def list_room(inner: float, outer: float, dimension: int) -> int:
    """Entries of a list of the particles between the radii ``inner`` and ``outer`` [dx]."""
    ball = 3.1416 if dimension == 2 else 4.1888
    return int(LIST_ROOM * ball * (outer**dimension - inner**dimension)) + LIST_SPARE[dimension]


class Neighbours:
    """Rows and lists; ``mobile``, ``flow`` and ``hot`` are the host's copies of the group ends.

    ``near``, ``far`` [m]: radii of the lists, with the skin; ``still`` [m]: of those among still particles.
    Lists are indexed by particle: ``near[a, j]``, j < ``near_count[a]``; who never has one takes no memory (`Blocks`).
    """

    def __init__(
        self, state: State, cells: Cells, still: float, near: float, far: float | None, dx: float,
        schedule: Schedule,
    ):  # fmt: skip
        d, n = state.dimension, state.count
        reach = cells.reach(far or near)
        self._reach, self._cells = reach, cells
        self.near_capacity = list_room(0.0, near / dx, d)
        self.far_capacity = list_room(near / dx, far / dx, d) if far else 0
        self.rows = ti.field(ti.i32, shape=n)
        self.hot_rows = ti.field(ti.i32, shape=n)
        self.chosen = ti.field(ti.i32, shape=n)  # number of the choice in which a particle was hot last
        self.choices = 0
        self.core = ti.field(
            ti.i32, shape=n
        )  # of a hot row: 1 amid the active cells, 0 at the rim of the hot set
        known = Blocks(n)  # of who has lists, or had
        self.listed = known.field(ti.i32)
        self._kept = known.field(ti.i32)  # the last gathering for which the lists of a flow row were good
        self._todo = ti.field(ti.i32, shape=n)  # flow rows whose lists are to be searched
        self.searched = 0  # of them at the last gathering
        self.near_count = known.field(ti.i32)
        self.near = Blocks(n).field(ti.i32, self.near_capacity + 1)  # and one to spare, see search_near
        if far:
            self.far_count = known.field(ti.i32)
            self.far = Blocks(n).field(ti.i32, self.far_capacity + 1)
        self.overflow = ti.field(ti.i32, shape=())  # id of a particle with a full list, or -1
        self.mobile = self.flow = self.hot = 0
        self._flow_row = known.field(ti.i32)  # the gathering at which a particle was a flow row last
        self._gathering = 0
        # mobile, flow, hot; whether a mover has left the core; flow rows to be searched
        self._ends = ti.field(ti.i32, shape=5)
        self._zone = ti.field(ti.i32, shape=cells.total)
        self._schedule, self._needs = schedule, state.needs
        self._spread, self._grow, self._choose = self._compile_hot(state, cells, reach)
        self._gather = self._compile_gather(state, cells, far or near, reach)
        self._search, self._settle, self._renew = self._compile_search(state, cells, still, near, far)

    def _compile_hot(self, state: State, cells: Cells, reach: int) -> tuple[Any, Any, Any]:
        d, window, ring = state.dimension, cells.window(reach), cells.window(RING)
        hot_rows, chosen, core, ends = self.hot_rows, self.chosen, self.core, self._ends
        zone, ordered = self._zone, self._schedule.ordered
        Corner = ti.types.vector(d, ti.f64)

        @direct
        @ti.kernel
        def spread(alone: ti.template()):
            """Hot is what the active cells reach, the core what they are next to."""
            ti.loop_config(serialize=alone)
            for c in range(cells.total):
                bits = 0
                if cells.inner[c] == 1:  # empty ones, too: somebody may move there
                    for w in range(window.shape[0]):
                        if cells.active[c + window[w]] == 1:
                            bits = HOT
                    if bits == HOT:
                        for w in range(ring.shape[0]):
                            if cells.active[c + ring[w]] == 1:
                                bits = HOT | CORE
                zone[c] = bits

        @direct
        @ti.kernel
        def grow(alone: ti.template()):
            """One more ring of cells around the hot ones."""
            ti.loop_config(serialize=alone)
            for c in range(cells.total):
                if cells.inner[c] == 1 and zone[c] == 0:
                    for w in range(ring.shape[0]):
                        if (zone[c + ring[w]] & HOT) != 0:
                            zone[c] = GROWN
            ti.loop_config(serialize=alone)
            for c in range(cells.total):
                if zone[c] == GROWN:
                    zone[c] = HOT

        @ti.func
        def lit(a, low, high):
            x = ti.cast(state.position[a], ti.f64)
            inside = 1
            for axis in ti.static(range(d)):
                if x[axis] < low[axis] or x[axis] > high[axis]:
                    inside = 0
            return inside

        @direct
        @ti.kernel
        def choose(everything: ti.i32, number: ti.i32, low: Corner, high: Corner):
            ends[2] = 0
            for c in range(everything * cells.total):
                zone[c] = HOT | CORE
            ti.loop_config(serialize=ordered)
            for a in range(state.count):  # in the order of the scene, in which what is near has near numbers
                if state.mobility[a] != REMOVED:
                    bits = zone[cells.home[a]]
                    if bits != 0 or lit(a, low, high):
                        k = ti.atomic_add(ends[2], 1)
                        hot_rows[k] = a
                        chosen[a] = number
                        core[k] = ti.cast((bits & CORE) != 0, ti.i32)

        return spread, grow, choose

    def _compile_gather(self, state: State, cells: Cells, radius: float, reach: int) -> Any:
        rows, hot_rows, ends, flow_row, ordered = (
            self.rows, self.hot_rows, self._ends, self._flow_row, self._schedule.ordered,
        )  # fmt: skip
        window, radius2, zone = cells.window(reach), radius**2, self._zone
        place, kept, todo = cells.reference, self._kept, self._todo
        movers_at = ti.field(
            ti.i32, shape=cells.total
        )  # the gathering at which a cell had a mobile particle last
        reached_at = ti.field(ti.i32, shape=cells.total)  # the same for the cells within reach of one
        reached = ti.field(ti.i32, shape=cells.total)  # their numbers
        found = ti.field(ti.i32, shape=())

        @ti.func
        def append(group, a, now):
            rows[ti.atomic_add(ends[group], 1)] = a
            flow_row[a] = now

        @ti.func
        def touches_mobile(a, c, now):
            touched = 0
            for w in range(window.shape[0]):
                e = c + window[w]
                if touched == 0 and movers_at[e] == now:
                    for slot in range(cells.count[e]):
                        b = cells.items[e, slot]
                        if state.mobility[b] == MOBILE:
                            if (place[a] - place[b]).norm_sqr() < radius2:
                                touched = 1
            return touched

        @direct
        @ti.kernel
        def gather(
            hot: ti.i32,
            everything: ti.i32,
            now: ti.i32,
            following: ti.i32,
            report: ti.types.ndarray(dtype=ti.i32, ndim=1),
        ):
            ends[0] = 0
            ends[3] = 0
            ends[4] = 0
            found[None] = 0
            ti.loop_config(serialize=ordered)
            for k in range(hot):
                if state.mobility[hot_rows[k]] == MOBILE:
                    append(0, hot_rows[k], now)
            ends[1] = ends[0]
            ti.loop_config(serialize=ordered)
            for k in range(ends[0]):
                c = cells.home[rows[k]]
                if (zone[c] & CORE) == 0:
                    ends[3] = 1
                if everything == 0 and ti.atomic_max(movers_at[c], now) < now:
                    for w in range(window.shape[0]):
                        e = c + window[w]
                        if cells.count[e] > 0 and ti.atomic_max(reached_at[e], now) < now:
                            reached[ti.atomic_add(found[None], 1)] = e
            ti.loop_config(serialize=ordered)
            for i in range(found[None]):
                c = reached[i]
                for slot in range(cells.count[c]):
                    a = cells.items[c, slot]
                    if state.mobility[a] == STILL and touches_mobile(a, c, now):
                        append(1, a, now)
            ti.loop_config(serialize=ordered)
            for a in range(everything * state.count):
                if state.mobility[a] == STILL:
                    append(1, a, now)
            ti.loop_config(serialize=ordered)
            for k in range(ends[1]):
                a = rows[k]
                if following == 0 or kept[a] != now - 1 or cells.touched[cells.home[a]] == following:
                    todo[ti.atomic_add(ends[4], 1)] = a
                else:
                    kept[a] = now
            for i in ti.static(range(5)):
                report[i] = ends[i]

        return gather

    def _compile_search(
        self, state: State, cells: Cells, still: float, near: float, far: float | None
    ) -> tuple[Any, ...]:
        window, near_window = cells.window(cells.reach(far or near)), cells.window(cells.reach(near))
        still2, near2, far2 = still**2, near**2, (far or near) ** 2
        hot_rows, listed, overflow, place = self.hot_rows, self.listed, self.overflow, cells.reference
        todo, kept = self._todo, self._kept
        near_capacity, far_capacity, flow_row = self.near_capacity, self.far_capacity, self._flow_row
        wide = far is not None

        @ti.func
        def search_near(a, radius2):
            x = place[a]
            c = cells.home[a]
            n = 0
            for w in range(near_window.shape[0]):
                e = c + near_window[w]
                for slot in range(cells.count[e]):
                    b = cells.items[e, slot]
                    # written before it is known to be near, and kept by counting it: no branch to guess wrongly
                    self.near[a, ti.min(n, near_capacity)] = b
                    n += ti.cast((x - place[b]).norm_sqr() < radius2, ti.i32) * ti.cast(b != a, ti.i32)
            if n > near_capacity:
                overflow[None] = a
            self.near_count[a] = ti.min(n, near_capacity)

        @ti.func
        def search_both(a):
            x = place[a]
            c = cells.home[a]
            n = 0
            m = 0
            for w in range(window.shape[0]):
                e = c + window[w]
                for slot in range(cells.count[e]):
                    b = cells.items[e, slot]
                    r2 = (x - place[b]).norm_sqr()
                    self.near[a, ti.min(n, near_capacity)] = b
                    self.far[a, ti.min(m, far_capacity)] = b
                    is_near = ti.cast(r2 < near2, ti.i32)
                    n += is_near * ti.cast(b != a, ti.i32)
                    m += ti.cast(r2 < far2, ti.i32) - is_near
            if n > near_capacity or m > far_capacity:
                overflow[None] = a
            self.near_count[a] = ti.min(n, near_capacity)
            self.far_count[a] = ti.min(m, far_capacity)

        @handed_out
        @ti.kernel
        def search(count: ti.i32, now: ti.i32, alone: ti.template()):
            overflow[None] = -1
            ti.loop_config(serialize=alone)
            for k in range(count):
                a = todo[k]
                if ti.static(wide):
                    search_both(a)
                else:
                    search_near(a, near2)
                listed[a] = ANEW
                kept[a] = now

        @direct
        @ti.kernel
        def settle(hot: ti.i32, now: ti.i32, alone: ti.template()):
            """Nobody who moves is within reach of a hot row that is not a flow row."""
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = hot_rows[k]
                if listed[a] == ANEW and flow_row[a] != now:
                    search_near(a, still2)
                    listed[a] = FOUND

        @direct
        @ti.kernel
        def renew(alone: ti.template()):
            ti.loop_config(serialize=alone)
            for a in range(state.count):
                if listed[a] == SETTLED:
                    listed[a] = FOUND

        return search, settle, renew

    def rings(self, rim: float) -> int:
        """Cells beyond those that a search reaches, for a rim of ``rim`` [m]."""
        return max(0, self._cells.reach(rim) - self._reach)

    def choose_hot(self, everything: bool, beam: tuple[Any, Any], rings: int) -> None:
        """Choose the hot rows from cells just built: those within reach of the active cells, and ``rings`` more cells.

        ``beam``: corners [m] of the box in which particles are lit.
        """
        alone = self._schedule.plain(self._zone.shape[0])
        self._spread(alone)
        for _ in range(rings):
            self._grow(alone)
        self.choices += 1
        self._choose(int(everything), self.choices, *beam)
        self.hot = int(self._ends[2])

    def gather(self, everything: bool, followed: bool) -> bool:
        """Choose the flow rows, or take ``everything``; False if a mobile particle has left the core of the hot set.

        ``followed``: only the cells that the last following touched see anything new; otherwise all do.
        """
        self._gathering += 1
        if not self._needs.flow:
            return True
        ends = np.zeros(5, np.int32)
        self._gather(self.hot, int(everything), self._gathering, self._cells.followings * followed, ends)
        self.mobile, self.flow, _, left, self.searched = ends.tolist()
        return not left

    def search(self) -> None:
        """Search the lists of the flow rows that see something new, and those of the hot ones that have none."""
        self._search(self.searched, self._gathering, self._schedule.alone(self.searched))
        self.settle()

    def settle(self) -> None:
        """Search the lists of the hot rows that have none."""
        if self._needs.heat:
            self._settle(self.hot, self._gathering, self._schedule.plain(self.hot // 4))  # few have none

    def everyone_is_hot(self) -> None:
        """Until the next choice: nobody knows who is, as when particles were loaded from elsewhere."""
        self.hot = self.hot_rows.shape[0]
        self.hot_rows.from_numpy(np.arange(self.hot, dtype=np.int32))

    def renew(self) -> None:
        """Keep the lists among still particles, but have found anew what else is found once for them."""
        self._renew(self._schedule.plain(self.rows.shape[0]))

    def forget(self) -> None:
        """Search every list anew at the next build."""
        self.listed.fill(ANEW)
