"""Roughness of a height profile; formulas in docs/analysis.md."""

import math

import numpy as np

ENDS = 0.1
"""Share of the track at either end that is left out: the hump at the start and the crater at the end are form."""
SAMPLES = 5
"""Sampling lengths in the evaluation length, as in ISO 4287; one of them is the cut-off of the filter."""
GAUSS = math.sqrt(math.log(2.0) / math.pi) / math.sqrt(2.0 * math.pi)
"""Standard deviation of the profile filter over its cut-off: half of a wave that long passes (ISO 16610-21)."""
NAMES = ("Ra_m", "Rq_m", "Rz_m", "Pa_m", "Pq_m", "Pt_m")


def roughness(height: np.ndarray, inside: np.ndarray) -> dict[str, float]:
    """The values NAMES [m] of ``height`` [m], shape [n], at equal steps, over the places ``inside`` (bool, [n]).

    What lies outside serves the filter as run-in and run-out; NaN is left out; all NaN for less than five heights.
    """
    known = inside & np.isfinite(height)
    if known.sum() < SAMPLES:
        return dict.fromkeys(NAMES, float("nan"))
    primary = height[known] - height[known].mean()
    rough = (height - waviness(height, inside.sum() / SAMPLES))[known]
    parts = np.array_split(rough, SAMPLES)
    return {
        "Ra_m": float(np.abs(rough).mean()),
        "Rq_m": float(np.sqrt((rough**2).mean())),
        "Rz_m": float(np.mean([part.max() - part.min() for part in parts])),
        "Pa_m": float(np.abs(primary).mean()),
        "Pq_m": float(np.sqrt((primary**2).mean())),
        "Pt_m": float(primary.max() - primary.min()),
    }


def waviness(height: np.ndarray, cutoff: float) -> np.ndarray:
    """``height`` [m] at equal steps through the Gaussian low pass of ISO 16610-21, whose cut-off counts in steps.

    NaN, and what lies beyond the ends, has no weight.
    """
    from scipy.ndimage import gaussian_filter1d

    known = np.isfinite(height)
    width = GAUSS * cutoff
    weight = gaussian_filter1d(known.astype(float), width, mode="constant")
    summed = gaussian_filter1d(np.where(known, height, 0.0), width, mode="constant")
    mean: np.ndarray = np.divide(summed, weight, out=np.full_like(summed, np.nan), where=known)
    return mean


def middle(along: np.ndarray, low: float, high: float) -> np.ndarray:
    """Which of the places ``along`` [m] lie between ``low`` and ``high`` [m], without the ends; bool."""
    margin = ENDS * (high - low)
    inside: np.ndarray = (along >= low + margin) & (along <= high - margin)
    return inside
