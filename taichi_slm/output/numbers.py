"""A number as a person reads it."""

import math

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
