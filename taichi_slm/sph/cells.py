"""The cell grid: every particle in a box, so that a search looks at a few boxes instead of at all particles.

Cells hold at most ``capacity`` particles, in the order of their ids: sums over neighbours are then the same bits
in every run. A fuller cell is an error that the host reads, never a truncation.
"""

import math
from itertools import product
from typing import Any

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.state import MOBILE, REMOVED, State

CELL_MOBILE, CELL_WARM = 1, 2  # bits of `mark`


class Cells:
    """A grid of cells of edge ``size`` [m] over the domain [lower, upper] [m].

    Cells are numbered; ``window(radius)`` has the differences of number to the cells around. A border of empty
    cells, as wide as the widest window, saves every search the question whether a cell exists.
    """

    def __init__(self, state: State, lower: np.ndarray, upper: np.ndarray, size: float, dx: float, widest: float,
                 serial: bool):  # fmt: skip
        d = state.dimension
        self.size = size
        self.border = self.reach(widest)
        self.shape = tuple(
            int(math.ceil((u - o) / size)) + 1 + 2 * self.border for o, u in zip(lower, upper, strict=True)
        )
        self.total = int(np.prod(self.shape))
        self.capacity = int(3.0 * (size / dx) ** d) + 8
        self.count = ti.field(ti.i32, shape=self.total)
        self.items = ti.field(ti.i32, shape=(self.total, self.capacity))
        self.mark = ti.field(ti.i32, shape=self.total)
        self.overflow = ti.field(ti.i32, shape=())  # id of a particle that found no room, or -1
        self.invalid = ti.field(
            ti.i32, shape=()
        )  # id of a particle without a finite place or temperature, or -1

        origin = ti.Vector([float(x) for x in lower])
        inverse, border = 1.0 / size, self.border
        top = ti.Vector([n - 1 - 2 * border for n in self.shape])
        stride = ti.Vector([int(x) for x in self._strides()])
        count, items, mark, overflow, invalid = self.count, self.items, self.mark, self.overflow, self.invalid
        capacity = self.capacity

        @ti.func
        def cell_of(x):
            place = ti.max(0, ti.min(top, ti.cast((x - origin) * inverse, ti.i32))) + border
            return (place * stride).sum()

        @ti.kernel
        def clear():
            for c in count:
                count[c] = 0
                mark[c] = 0
            overflow[None] = -1
            invalid[None] = -1

        @ti.kernel
        def fill(warm_from: ti.f64, rest: ti.f64):
            ti.loop_config(serialize=serial)
            for i in range(state.count):
                if state.mobility[i] != REMOVED:
                    x = state.position[i]
                    finite = 1
                    for axis in ti.static(range(d)):
                        if ti.math.isnan(x[axis]) or ti.math.isinf(x[axis]):
                            finite = 0
                    if ti.math.isnan(state.temperature[i]):
                        finite = 0
                    if finite == 0:
                        invalid[None] = i
                    else:
                        c = cell_of(x)
                        slot = ti.atomic_add(count[c], 1)
                        if slot < capacity:
                            items[c, slot] = i
                        else:
                            overflow[None] = i
                        bits = 0
                        if state.mobility[i] == MOBILE:
                            bits = CELL_MOBILE
                        if abs(state.temperature[i] - rest) > warm_from:
                            bits += CELL_WARM
                        if bits != 0:
                            ti.atomic_or(mark[c], bits)

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

        self.cell_of: Any = cell_of
        self._clear, self._fill, self._sort, self._serial = clear, fill, sort, serial

    def _strides(self) -> np.ndarray:
        return np.append(np.cumprod(self.shape[:0:-1])[::-1], 1)

    def window(self, cells: int) -> Any:
        """Differences of number to the cells up to ``cells`` away on each axis, i32, shape [(2 cells + 1)^d]."""
        around = np.array(list(product(range(-cells, cells + 1), repeat=len(self.shape))))
        values = (around @ self._strides()).astype(np.int32)
        field = ti.field(ti.i32, shape=len(values))
        field.from_numpy(values)
        return field

    def reach(self, radius: float) -> int:
        """Cells to look at on each side for everything within ``radius`` [m]."""
        return int(math.ceil(radius / self.size - 1e-9))

    def build(self, warm_from: float, rest: float) -> None:
        """Put every particle that is not removed into its cell and mark the mobile and the warm cells.

        A cell is warm where a temperature differs from ``rest`` [K] by more than ``warm_from`` [K].
        """
        self._clear()
        self._fill(warm_from, rest)
        if not self._serial:  # a serial fill is in order already
            self._sort()
