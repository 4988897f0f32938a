"""Roughness of a height profile; formulas in docs/analysis.md."""

import numpy as np

ENDS = 0.1
"""Share of the track at either end that is left out: the hump at the start and the crater at the end are form."""
SAMPLES = 5
"""Sampling lengths of Rz, as in ISO 4287."""


def roughness(height: np.ndarray) -> dict[str, float]:
    """Ra, Rq, Rz and Rt [m] of ``height`` [m], shape [n], at equal steps, NaN left out; all NaN for less than five."""
    z = height[np.isfinite(height)]
    if len(z) < SAMPLES:
        return {"Ra_m": float("nan"), "Rq_m": float("nan"), "Rz_m": float("nan"), "Rt_m": float("nan")}
    off = z - z.mean()
    parts = np.array_split(off, SAMPLES)
    return {
        "Ra_m": float(np.abs(off).mean()),
        "Rq_m": float(np.sqrt((off**2).mean())),
        "Rz_m": float(np.mean([part.max() - part.min() for part in parts])),
        "Rt_m": float(off.max() - off.min()),
    }


def middle(along: np.ndarray, low: float, high: float) -> np.ndarray:
    """Which of the places ``along`` [m] lie between ``low`` and ``high`` [m], without the ends; bool."""
    margin = ENDS * (high - low)
    inside: np.ndarray = (along >= low + margin) & (along <= high - margin)
    return inside
