"""A number as a person reads it, and the unit that a column's name ends in."""

import math
import re

UNITS = {
    "kg_m": "kg/m", "m_s": "m/s", "K_s": "K/s", "K_m": "K/m", "m2": "m²", "m3": "m³", "kg": "kg",
    "m": "m", "s": "s", "K": "K", "J": "J", "bytes": "bytes",
}  # fmt: skip
"""How the last word of a column's name, after the last underscore but for these pairs, says its unit."""
_NAME = re.compile(rf"(.+)_({'|'.join(UNITS)})((?:\.(?:median|p10|p90))?)")
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))


def quantity(value: float | None, unit: str) -> str:
    """``value`` with three digits and a prefix: 1.23e-5 m is "12.3 um"."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0.0:
        return f"0 {unit}"
    size = abs(value)
    factor, prefix = next(((f, p) for f, p in PREFIXES if size >= 0.9995 * f), PREFIXES[-1])
    return f"{value / factor:.3g} {prefix}{unit}" if size < 1e3 else f"{value:,.0f} {unit}"


def name_and_unit(column: str) -> tuple[str, str]:
    """A column's name and its unit, "" without one: ("melt_pool.depth", "m") of melt_pool.depth_m."""
    found = _NAME.fullmatch(column)
    return (found[1] + found[3], UNITS[found[2]]) if found else (column, "")


def handy(largest: float, unit: str) -> tuple[float, str]:
    """A factor, and the unit it makes of the SI unit ``unit``, in which numbers up to ``largest`` are read easily.

    Lengths are in µm up to 1 cm, so that the plots of a melt pool agree; (1e-6, "µm") of one of 54e-6 m.
    """
    size = abs(largest)
    if unit in ("m", "m²", "m³"):
        power = 1 + ("", "²", "³").index(unit[1:])
        factor, name = (1e-6, "µm") if size < (1e-2, 2e-7, 2e-13)[power - 1] else (1e-3, "mm")
        return factor**power, name + unit[1:]
    if unit not in ("s", "J", "J/m") or size == 0.0:
        return 1.0, unit
    factor, prefix = next(((f, p) for f, p in PREFIXES if size >= 0.995 * f), PREFIXES[-1])
    return factor, prefix.replace("u", "µ") + unit
