"""Properties of the materials on the device: linear interpolation in the tables that `materials.tables` makes.

Equation   rho0(T), k(T), mu(T), sigma(T) ... of the alloy files; liquid fraction s = (T - T_S)/(T_L - T_S) (eq. 40)
Reads      temperature [K] or enthalpy [J/kg]
Checked    tests/test_physics.py: tables against the laws they were made from
"""

from typing import Any

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.materials.tables import PropertyTables


class MaterialTables:
    """The tables as fields, of shape [property, material, knot] and such, and the functions that read them.

    A table has three segments (solid, mushy, liquid) with equally spaced knots, so a look-up is a comparison and a
    division, and the solidus and liquidus are knots: kinks stay sharp.
    """

    def __init__(self, tables: PropertyTables, real: Any, names: tuple[str, ...]):
        count = tables.segment_start.shape[0]
        bases = np.asarray(tables.segment_base, np.int32)  # first knot of each segment, and the last knot
        self._names = names
        # one field: each is filled by a kernel of its own, which takes 20 ms to start
        self.values = self._field(np.stack([getattr(tables, name) for name in names]), real)
        start = self._field(tables.segment_start, real)
        heat_start = self._field(tables.enthalpy_start, ti.f64)
        inverse_heat = self._field(tables.temperature_of_enthalpy, ti.f64)
        base = [int(b) for b in bases]

        @ti.func
        def place_in(limits: ti.template(), m, value):
            """Knot and fraction of ``value``; beyond the table the end segment is extended."""
            segment = 0
            first = base[0]
            last = base[1]
            if value > limits[m, 2]:
                segment = 2
                first = base[2]
                last = base[3]
            elif value > limits[m, 1]:
                segment = 1
                first = base[1]
                last = base[2]
            low = limits[m, segment]
            place = (value - low) / ti.max(limits[m, segment + 1] - low, 1e-30) * (last - first)
            knot = ti.max(first, ti.min(last - 1, first + ti.cast(ti.floor(place), ti.i32)))
            return knot, place - (knot - first)

        @ti.func
        def locate(m, T):
            """Knot and fraction of temperature T [K]."""
            knot, fraction = place_in(start, m, T)
            return knot, fraction

        @ti.func
        def temperature_of(m, H):
            """T(H) [K]: the inverse of the enthalpy table; its knots are equally spaced in H [J/kg]."""
            knot, fraction = place_in(heat_start, m, H)
            return (1.0 - fraction) * inverse_heat[m, knot] + fraction * inverse_heat[m, knot + 1]

        @ti.func
        def liquid_fraction(m, T):
            return ti.max(0.0, ti.min(1.0, (T - start[m, 1]) / ti.max(start[m, 2] - start[m, 1], 1e-30)))

        self.count = count
        self.locate, self.temperature_of, self.liquid_fraction = locate, temperature_of, liquid_fraction

    @staticmethod
    def _field(values: np.ndarray, kind: Any) -> Any:
        target = ti.field(kind, shape=values.shape)
        target.from_numpy(np.ascontiguousarray(values, np.float32 if str(kind) == "f32" else np.float64))
        return target

    def reader(self, name: str) -> Any:
        """The Taichi function (m, knot, fraction) -> property ``name``."""
        values, number = self.values, self._names.index(name)

        @ti.func
        def read(m, knot, fraction):
            return (1.0 - fraction) * values[number, m, knot] + fraction * values[number, m, knot + 1]

        return read
