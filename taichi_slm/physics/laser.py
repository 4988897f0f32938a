"""Laser: Beer-Lambert absorption through a binning grid (Appendix A).

Equation   I(r) = A P f/(pi w^2) exp(-f r^2/w^2), f = 2: w is the 1/e^2 radius                    (33), corrected
           weights w = Prod_axis (1 - |x - X|/D) to the 2^d nodes X around a particle, D the bin size
           V_f = Sum w V / D^d;  I_below = I_above exp(-alpha D min(V_f, 1))                       (31), App. A
           a bin absorbs I_above - I_below times its area and hands it to its particles in proportion to w V
           in 2-D the source I(x, 0) acts per unit depth
Source     Russell, Souto-Iglesias, Zohdi 2018, Appendix A (there without the bin size, and with alpha I for the
           difference of intensities, which does not conserve the power)
Reads      position, volume      Writes  laser [W]
Skipped    columns of bins that the beam does not reach, bins above the highest particle; while the beam is off
Checked    absorbed + passed through = A P to round-off; slab: A I0 (1 - exp(-alpha L))

w V is rounded to a 64-bit integer before it is summed, so the sum does not depend on the order of the particles,
and the shares of a bin add up to one exactly.
"""

import math
from itertools import product

import numpy as np

from taichi_slm.backend import Schedule, direct, ti
from taichi_slm.config.schema import Laser
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import State

UNIT = 2.0**40  # integer weight of a bin that is exactly full
DARK = 1e-6  # light of a bin over that of the brightest column, below which it is dark; what is cut off passes through
RESERVE = 2.0  # bins below the lowest lit one that still count, for a surface that sinks between two looks
REACH = 3.8  # a Gaussian with f = 2 has 3e-13 of its power outside this many w


def stable_dt(laser: Laser, absorptivity: float, dx: float, rho_c: float, rise: float) -> float:
    """Step [s] in which the brightest particle, left alone, warms by ``rise`` [K]; ``rho_c`` in J/(m^3 K).

    It absorbs the peak intensity over the absorption depth, or over its own size where that is larger.
    """
    peak = laser.exponent if laser.profile == "gaussian" else 1.0
    intensity = absorptivity * peak * laser.power / (math.pi * laser.beam_radius**2)
    size = laser.bin_size or dx
    return rise * rho_c * max(laser.absorption_depth or size / 3.0, size) / max(intensity, 1e-300)


def line_power(laser: Laser, dimension: int) -> float:
    """Power that reaches the scene per unit of laser power: 1 in 3-D, the integral of I(x, 0) [1/m] in 2-D."""
    if dimension == 3:
        return 1.0
    if laser.profile == "top_hat":
        return 2.0 / (math.pi * laser.beam_radius)
    return math.sqrt(laser.exponent / math.pi) / laser.beam_radius


def beam_reach(laser: Laser) -> float:
    """Distance from the beam's axis beyond which it is dark [m]."""
    if laser.profile == "top_hat":
        return laser.beam_radius
    return REACH * laser.beam_radius * math.sqrt(2.0 / laser.exponent)


def shares(laser: Laser, edges: list[np.ndarray]) -> np.ndarray:
    """Fraction of the beam in each column of bins; exact integrals, so that they add up to one.

    ``edges``: for each horizontal axis the bin edges [m] relative to the beam's axis, shape [n + 1].
    Returns shape [n_x] in 2-D, [n_x, n_y] in 3-D.
    """
    from scipy.special import erf  # slow to import, and `validate` does not need it

    w = laser.beam_radius
    if laser.profile == "gaussian":
        parts = [np.diff(0.5 * erf(math.sqrt(laser.exponent) * e / w)) for e in edges]
        return parts[0] if len(parts) == 1 else np.outer(parts[0], parts[1])
    if len(edges) == 1:
        return np.diff(0.5 * np.clip(edges[0] / w, -1.0, 1.0))
    corner = _disc_quadrant(edges[0][:, None] / w, edges[1][None, :] / w) / math.pi
    return np.diff(np.diff(corner, axis=0), axis=1)


def _disc_quadrant(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Area of the part of the unit disc with X <= x and Y <= y."""
    x, y = np.broadcast_arrays(np.clip(x, -1.0, 1.0), np.clip(y, -1.0, 1.0))

    def segment(t: np.ndarray) -> np.ndarray:  # integral of sqrt(1 - t^2)
        return 0.5 * (t * np.sqrt(1.0 - t**2) + np.arcsin(t))

    b = np.sqrt(1.0 - y**2)  # |t| < b: the chord at t is cut by y
    below = segment(x) + np.pi / 4.0
    outer = segment(np.minimum(x, -b)) + np.pi / 4.0 + segment(np.maximum(x, b)) - segment(b)
    return below + np.sign(y) * outer + y * (np.clip(x, -b, b) + b)


class LaserBins:
    """The binning grid over the domain and its passes."""

    def __init__(self, laser: Laser, state: State, rows: Neighbours, lower: np.ndarray, upper: np.ndarray,
                 dx: float, whole: bool, schedule: Schedule):  # fmt: skip
        d = state.dimension
        size = laser.bin_size or dx
        self.laser = laser
        self.size = size
        # bins end at multiples of their size, as the cells of the lattice and the top of a plate do
        lower = size * (np.floor(lower / size - 0.5) + 0.5)
        self.lower = lower
        self.nodes = tuple(int(math.ceil((u - o) / size)) + 2 for o, u in zip(lower, upper, strict=True))
        depth = laser.absorption_depth or size / 3.0
        half = int(math.ceil(beam_reach(laser) / size)) + 1
        self.whole = whole
        self.columns = tuple(n if whole else min(n, 2 * half + 1) for n in self.nodes[: d - 1])
        self.half = half
        self.floor = ti.field(ti.f64, shape=())  # lowest lit node [m]
        highest = ti.field(ti.i32, shape=())  # level; the bins above it are empty
        # by level, then column of the window: however deep the plate, what is lit lies together
        bins = (self.nodes[-1], *self.columns)
        weight = ti.field(ti.i64, shape=bins)
        power = ti.field(ti.f64, shape=bins)  # [W] per unit of integer weight
        origin = ti.Vector([float(x) for x in lower], dt=ti.f64)
        inverse = 1.0 / size
        full = UNIT / size**d
        attenuation = size / depth
        floor = self.floor
        corners = [ti.Vector(c) for c in product((0, 1), repeat=d)]

        @ti.func
        def share_of(a, node, place):
            """Integer weight of particle a at one of its nodes."""
            w = ti.cast(state.volume[a], ti.f64) * full
            for axis in ti.static(range(d)):
                w *= 1.0 - abs(place[axis] - node[axis])
            return ti.cast(w + 0.5, ti.i64)

        @ti.func
        def in_window(base, first):
            inside = 1
            for axis in ti.static(range(d - 1)):
                if base[axis] < first[axis] or base[axis] + 1 >= first[axis] + self.columns[axis]:
                    inside = 0
            return inside

        @ti.func
        def first_of(x, y):
            """The lowest node of the window's first column."""
            node = ti.Vector.zero(ti.i32, d)
            node[0] = x
            if ti.static(d == 3):
                node[1] = y
            return node

        @ti.func
        def bin_at(level, column):
            place = ti.Vector.zero(ti.i32, d)
            place[0] = level
            for axis in ti.static(range(d - 1)):
                place[axis + 1] = column[axis]
            return place

        @ti.func
        def bin_of(node, first):
            return bin_at(node[d - 1], node - first)

        @ti.func
        def place_of(a):
            return (ti.cast(state.position[a], ti.f64) - origin) * inverse

        @direct
        @ti.kernel
        def deposit(
            hot: ti.i32,
            first_x: ti.i32,
            first_y: ti.i32,
            lowest: ti.i32,
            bottom: ti.f64,
            alone: ti.template(),
        ):
            first = first_of(first_x, first_y)
            floor[None] = 1e30
            ti.loop_config(serialize=alone)
            for column in ti.grouped(ti.ndrange(*self.columns)):
                for level in range(lowest, highest[None] + 1):
                    weight[bin_at(level, column)] = 0
                    power[bin_at(level, column)] = 0.0
            highest[None] = ti.min(highest[None], lowest - 1)
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = rows.hot_rows[k]
                if state.position[a][d - 1] > bottom:
                    place = place_of(a)
                    base = ti.cast(ti.floor(place), ti.i32)
                    if in_window(base, first):
                        if base[d - 1] + 1 > highest[None]:
                            ti.atomic_max(highest[None], base[d - 1] + 1)
                        for corner in ti.static(corners):
                            node = base + corner
                            ti.atomic_add(weight[bin_of(node, first)], share_of(a, node, place))

        @direct
        @ti.kernel
        def march(
            lowest: ti.i32,
            incident: ti.f64,
            faintest: ti.f64,
            fraction: ti.types.ndarray(dtype=ti.f64, ndim=d - 1),
            alone: ti.template(),
        ):
            ti.loop_config(serialize=alone)
            for column in ti.grouped(ti.ndrange(*self.columns)):
                arriving = incident * fraction[column]
                left = ti.cast(1.0, ti.f64)
                for down in range(highest[None] - lowest + 1):
                    level = highest[None] - down
                    filled = weight[bin_at(level, column)]
                    if filled > 0 and left > 1e-14:
                        filling = ti.min(ti.cast(1.0, ti.f64), ti.cast(filled, ti.f64) / UNIT)
                        below = left * ti.exp(-attenuation * filling)
                        power[bin_at(level, column)] = arriving * (left - below) / ti.cast(filled, ti.f64)
                        left = below
                        if left * fraction[column] > faintest:
                            ti.atomic_min(floor[None], origin[d - 1] + level * size)

        @direct
        @ti.kernel
        def hand_back(hot: ti.i32, first_x: ti.i32, first_y: ti.i32, bottom: ti.f64, alone: ti.template()):
            first = first_of(first_x, first_y)
            ti.loop_config(serialize=alone)
            for k in range(hot):
                a = rows.hot_rows[k]
                received = ti.cast(0.0, ti.f64)
                if state.position[a][d - 1] > bottom:
                    place = place_of(a)
                    base = ti.cast(ti.floor(place), ti.i32)
                    if in_window(base, first):
                        for corner in ti.static(corners):
                            node = base + corner
                            received += power[bin_of(node, first)] * ti.cast(share_of(a, node, place), ti.f64)
                state.laser[a] = received

        self._rows, self._schedule = rows, schedule
        self._deposit, self._march, self._hand_back = deposit, march, hand_back

    def window(self, centre: tuple[float, ...]) -> tuple[int, ...]:
        """First node of the lit columns for a beam at ``centre`` [m], one index per horizontal axis."""
        if self.whole:
            return (0,) * len(self.columns)
        return tuple(
            min(max(round((x - o) / self.size) - self.half, 0), n - m)
            for x, o, n, m in zip(centre, self.lower, self.nodes, self.columns, strict=False)
        )

    def absorb(self, centre: tuple[float, ...], incident: float) -> bool:
        """Write the absorbed power of every active particle for ``incident`` power [W] (2-D: W/m) at ``centre``.

        Returns whether there was any light; if not, the field ``laser`` is stale and must not be read.
        """
        if incident == 0.0 and not self.whole:
            return False
        hot = self._rows.hot
        first = self.window(centre)
        edges = [
            o + self.size * (f + np.arange(m + 1) - 0.5) - x
            for o, f, m, x in zip(self.lower, first, self.columns, centre, strict=False)
        ]
        bottom = -np.inf if self.whole else self.bottom()
        alone = self._schedule.plain(hot // 4)  # a quarter of them are in the light
        first_x, first_y = (*first, 0)[:2]
        # below it nothing is deposited, and nothing handed back
        lowest = math.floor((max(bottom, self.lower[-1]) - self.lower[-1]) / self.size)
        self._deposit(hot, first_x, first_y, lowest, bottom, alone)
        fraction = np.ascontiguousarray(shares(self.laser, edges))
        self._march(lowest, incident, DARK * float(fraction.max(initial=0.0)), fraction, alone)
        self._hand_back(hot, first_x, first_y, bottom, alone)
        return True

    def forget(self) -> None:
        """The beam is elsewhere: nothing is known to be dark."""
        self.floor[None] = 1e30

    def bottom(self) -> float:
        """Height below which it was dark, and a reserve for the next step [m]; -inf before the first light."""
        floor = float(self.floor[None])
        return floor - RESERVE * self.size if floor < 1e29 else -math.inf
