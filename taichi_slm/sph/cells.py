"""The cell grid: every particle in a box, so that a search looks at a few boxes instead of at all particles.

Cells hold at most ``capacity`` particles, in the order of their ids: sums over neighbours are then the same bits
in every run. A fuller cell is an error that the host reads, never a truncation. A particle is where its reference
position is: where it stood when it was last put into a cell, or, of one that moves, a little ahead on its way, so that
it stays within half a skin of there for almost twice as long. After a build only those who left it far enough change
it, the cells that see them are ``touched``, and which cells are active is asked of those who may be warm.
"""

import math
from itertools import product
from typing import Any

import numpy as np

from taichi_slm.backend import Schedule, direct, ti
from taichi_slm.state import MOBILE, REMOVED, State

# of a cell over the lattice; welds and tracks at 200 W came to 12 particles of 8 in 3-D, 7 of 4 in 2-D
CELL_ROOM, CELL_SPARE = 1.5, 6
CELL_FIELDS = 6  # numbers of a cell besides its particles, `zone` of the lists among them


def cell_size(radius: float, dx: float) -> float:
    """Edge of the cells [m] for lists of ``radius`` [m], particles ``dx`` [m] apart."""
    return max(0.5 * radius, 1.4 * dx)


def cell_room(size: float, dimension: int) -> int:
    """Particles that a cell of edge ``size`` [dx] can hold."""
    return int(CELL_ROOM * size**dimension) + CELL_SPARE


def cell_bytes(size: float, dimension: int) -> float:
    """Memory of cells of edge ``size`` [dx] for each particle that the domain would hold."""
    return 4.0 * (CELL_FIELDS + cell_room(size, dimension)) / size**dimension


class Cells:
    """A grid of cells of edge ``size`` [m] over the domain [lower, upper] [m].

    Cells are numbered; ``window(radius)`` has the differences of number to the cells around. A border of empty
    cells, as wide as the widest window, saves every search the question whether a cell exists.
    ``active`` is 1 for a cell that had a mobile or a warm particle when that was last asked; ``home`` is the cell of
    each particle.
    """

    def __init__(self, state: State, lower: np.ndarray, upper: np.ndarray, size: float, dx: float, widest: float,
                 ahead: tuple[float, int], schedule: Schedule):  # fmt: skip
        """``widest`` [m]: the longest radius of a search; ``ahead``: a new reference is at most so far [m] and so many
        flow steps ahead on the way of its particle.
        """
        self.size = size
        self.border = self.reach(widest)
        self.shape = tuple(
            int(math.ceil((u - o) / size)) + 1 + 2 * self.border for o, u in zip(lower, upper, strict=True)
        )
        self.total = int(np.prod(self.shape))
        self.capacity = cell_room(size / dx, state.dimension)
        self.count = ti.field(ti.i32, shape=self.total)
        self.items = ti.field(ti.i32, shape=(self.total, self.capacity))
        self.active = ti.field(ti.i32, shape=self.total)
        self.overflow = ti.field(ti.i32, shape=())  # id of a particle that found no room, or -1
        # id of a particle without a finite place or temperature, or -1
        self.invalid = ti.field(ti.i32, shape=())
        self.inner = ti.field(
            ti.i32, shape=self.total
        )  # 1 but in the border, from which no window is looked through
        inner = np.zeros(self.shape, np.int32)
        inner[(slice(self.border, -self.border),) * len(self.shape)] = 1
        self.inner.from_numpy(inner.ravel())
        self._windows: dict[int, Any] = {}
        self.home = ti.field(ti.i32, shape=state.count)
        self.touched = ti.field(
            ti.i32, shape=self.total
        )  # number of the last following that changed what it sees
        self.followings = 0
        # [m], by which particles are in cells and lists; where nobody moves, the position is it for good
        self.reference = state.reference_position if state.needs.flow else state.position
        self._schedule = schedule
        self.cell_of, self._finite = self._compile_place(lower)
        self._way, self._refer = self._compile_refer(state, *ahead)
        self._clear, self._fill, self._sort, self._rouse = self._compile_build(state, schedule.ordered)
        self._follow = self._compile_follow(state)

    def _compile_place(self, lower: np.ndarray) -> tuple[Any, Any]:
        origin = ti.Vector([float(x) for x in lower])
        inverse, border = 1.0 / self.size, self.border
        top = ti.Vector([n - 1 - 2 * border for n in self.shape])
        stride = ti.Vector([int(x) for x in self._strides()])

        @ti.func
        def cell_of(x):
            place = ti.max(0, ti.min(top, ti.cast((x - origin) * inverse, ti.i32))) + border
            return (place * stride).sum()

        @ti.func
        def finite(x):
            result = 1
            for axis in ti.static(range(len(self.shape))):
                if ti.math.isnan(x[axis]) or ti.math.isinf(x[axis]):
                    result = 0
            return result

        return cell_of, finite

    def _compile_refer(self, state: State, farthest: float, longest: int) -> tuple[Any, Any]:
        reference, finite, invalid = self.reference, self._finite, self.invalid
        flow, shifts = state.needs.flow, state.needs.shifting

        @ti.func
        def way(a, dt):
            """Of ``a`` in a flow step like the last one, of ``dt`` [s]: [m]."""
            result = state.position[a] * 0.0
            if ti.static(flow):
                if state.mobility[a] == MOBILE:
                    result = dt * state.velocity[a]
                    if ti.static(shifts):
                        result += state.shift[a]
            return result

        @ti.func
        def refer(a, dt):
            """Give ``a`` a new reference, ahead on its way, which is to be finite; returns the cell of that."""
            x = state.position[a]
            if ti.static(flow):
                step = way(a, dt)
                x += ti.min(ti.cast(longest, state.real), farthest / (step.norm() + 1e-30)) * step
                reference[a] = x
                if finite(x) == 0:
                    invalid[None] = a
            return self.cell_of(x)

        return way, refer

    def _compile_build(self, state: State, ordered: bool) -> tuple[Any, ...]:
        count, items, active, home = self.count, self.items, self.active, self.home
        overflow, invalid, capacity = self.overflow, self.invalid, self.capacity
        cell_of, finite, refer = self.cell_of, self._finite, self._refer

        @ti.func
        def stirs(a, warm_from, rest):
            return state.mobility[a] == MOBILE or abs(state.temperature[a] - rest) > warm_from

        @direct
        @ti.kernel
        def clear(alone: ti.template()):
            overflow[None] = -1
            invalid[None] = -1
            ti.loop_config(serialize=alone)
            for c in range(self.total):
                count[c] = 0
                active[c] = 0

        @direct
        @ti.kernel
        def fill(warm_from: ti.f64, rest: ti.f64, taken_up: ti.i32, dt: state.real):
            ti.loop_config(serialize=ordered)
            for a in range(state.count):
                if state.mobility[a] != REMOVED:
                    x = state.position[a]
                    if finite(x) == 0 or ti.math.isnan(state.temperature[a]):
                        invalid[None] = a
                    else:
                        c = cell_of(x)
                        if taken_up != 0:
                            c = refer(a, dt)
                        home[a] = c
                        slot = ti.atomic_add(count[c], 1)
                        if slot < capacity:
                            items[c, slot] = a
                        else:
                            overflow[None] = a
                        if stirs(a, warm_from, rest):
                            active[c] = 1

        @direct
        @ti.kernel
        def sort():
            for c in count:
                n = ti.min(count[c], capacity)
                for j in range(1, n):
                    value = items[c, j]
                    place = j
                    while place > 0 and items[c, place - 1] > value:
                        items[c, place] = items[c, place - 1]
                        place -= 1
                    items[c, place] = value

        @direct
        @ti.kernel
        def rouse(rows: ti.template(), number: ti.i32, warm_from: ti.f64, rest: ti.f64, alone: ti.template()):
            ti.loop_config(serialize=alone)
            for c in range(self.total):
                active[c] = 0
            ti.loop_config(serialize=alone)
            for k in range(number):
                a = rows[k]
                if state.mobility[a] != REMOVED and stirs(a, warm_from, rest):
                    active[home[a]] = 1

        return clear, fill, sort, rouse

    def _compile_follow(self, state: State) -> Any:
        count, items, home = self.count, self.items, self.home
        overflow, invalid, capacity = self.overflow, self.invalid, self.capacity
        finite, reference, way, refer = self._finite, self.reference, self._way, self._refer
        window, touched = self.window(self.border), self.touched
        stirred = ti.field(
            ti.i32, shape=self.total
        )  # number of the last following that changed the cell itself

        @ti.func
        def touch(c, now):
            if stirred[c] != now:
                stirred[c] = now
                for w in range(window.shape[0]):
                    touched[c + window[w]] = now

        @ti.func
        def take_out(a, c):
            kept = 0
            for slot in range(count[c]):
                b = items[c, slot]
                if b != a:
                    items[c, kept] = b
                    kept += 1
            count[c] = kept

        @ti.func
        def put_in(a, c):
            n = count[c]
            if n < capacity:
                place = n
                while place > 0 and items[c, place - 1] > a:
                    items[c, place] = items[c, place - 1]
                    place -= 1
                items[c, place] = a
                count[c] = n + 1
                home[a] = c
            else:
                overflow[None] = a

        @ti.func
        def leaves(a, within2, steps, dt):
            """Whether ``a`` is too far from its reference, or will be after so many steps like the last one."""
            off = state.position[a] - reference[a]
            return off.norm_sqr() > within2 or (off + steps * way(a, dt)).norm_sqr() > within2

        @direct
        @ti.kernel
        def follow(
            moved: ti.template(),
            number: ti.i32,
            within2: state.real,
            steps: state.real,
            dt: state.real,
            now: ti.i32,
        ):
            ti.loop_config(serialize=True)  # two may leave one cell
            for k in range(number):
                a = moved[k]
                if finite(state.position[a]) == 0:
                    invalid[None] = a
                elif state.mobility[a] == REMOVED:
                    take_out(a, home[a])
                    touch(home[a], now)
                elif state.mobility[a] != MOBILE or leaves(a, within2, steps, dt):
                    c = refer(a, dt)
                    touch(home[a], now)
                    if c != home[a]:
                        take_out(a, home[a])
                        put_in(a, c)
                        touch(c, now)

        return follow

    def _strides(self) -> np.ndarray:
        return np.append(np.cumprod(self.shape[:0:-1])[::-1], 1)

    def window(self, cells: int) -> Any:
        """Differences of number to the cells up to ``cells`` away on each axis, i32, shape [(2 cells + 1)^d]."""
        if cells not in self._windows:
            around = np.array(list(product(range(-cells, cells + 1), repeat=len(self.shape))))
            self._windows[cells] = ti.field(ti.i32, shape=len(around))
            self._windows[cells].from_numpy((around @ self._strides()).astype(np.int32))
        return self._windows[cells]

    def reach(self, radius: float) -> int:
        """Cells to look at on each side for everything within ``radius`` [m]."""
        return int(math.ceil(radius / self.size - 1e-9))

    def build(self, warm_from: float, rest: float, taken_up: bool, dt: float) -> None:
        """Put every particle that is not removed into its cell and tell which cells are active.

        Warm is a temperature that differs from ``rest`` [K] by more than ``warm_from`` [K]. ``taken_up``: the particles
        get new references, after a flow step of ``dt`` [s], by which all lists are to be searched next.
        """
        self._clear(self._schedule.plain(self.total))
        self._fill(warm_from, rest, int(taken_up), dt)
        if not self._schedule.ordered:  # a serial fill is in order already
            self._sort()

    @property
    def can_follow(self) -> bool:
        """Whether a few particles can change their cells without a build: on a CPU, one after another."""
        return self._schedule.ordered

    def follow(self, moved: Any, number: int, within: float, steps: float, dt: float) -> None:
        """Take up where the first ``number`` particles of the field ``moved`` are now; the removed ones leave.

        Those keep their reference that are ``within`` [m] of it (0: only who has not moved), and will be after so many
        flow ``steps`` like their last one, of ``dt`` [s]; but for the frozen ones.
        """
        self.followings += 1
        self._follow(moved, number, within**2, steps, dt, self.followings)

    def rouse(self, rows: Any, number: int, warm_from: float, rest: float) -> None:
        """Tell anew which cells are active: warm and mobile are some of the first ``number`` in the field ``rows``."""
        self._rouse(rows, number, warm_from, rest, self._schedule.plain(self.total))
