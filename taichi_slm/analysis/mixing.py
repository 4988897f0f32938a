"""How far marked particles have mixed with the others, and how far they have gone."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from taichi_slm.analysis.recording import Moment

REACH = 1.6
"""Particles closer than this [dx] are neighbours: the 8 (2-D) or 18 (3-D) nearest of a lattice."""


def foreign_share(position: np.ndarray, group: np.ndarray, spacing: float) -> np.ndarray:
    """Share of each particle's neighbours that belong to another ``group``, shape [n]; 0 where there is none.

    Particles are at ``position`` [m], shape [n, dimension]. Deep within its own group a particle has 0, at a flat
    interface of two groups 3/8 (2-D lattice), alone among others 1.
    """
    pairs = cKDTree(position).query_pairs(REACH * spacing, output_type="ndarray")
    differ = group[pairs[:, 0]] != group[pairs[:, 1]]
    count = len(position)
    neighbours = np.bincount(pairs.ravel(), minlength=count)
    foreign = np.bincount(pairs[differ].ravel(), minlength=count)
    return np.asarray(foreign / np.maximum(neighbours, 1))


def dispersed(position: np.ndarray, group: np.ndarray, spacing: float) -> float:
    """Share of the marked particles (``group`` > 0) most of whose neighbours are of another group; NaN if none is.

    0 for lumps and for layers at least two particles thick, however sheared; the marked share of all particles, less
    than that from one, when they are stirred at random: see :func:`stirred`.
    """
    marked = group > 0
    return (
        float((foreign_share(position, group, spacing)[marked] > 0.5).mean())
        if marked.any()
        else float("nan")
    )


def stirred(position: np.ndarray, group: np.ndarray, spacing: float, seed: int = 0) -> float:
    """What :func:`dispersed` would be, had the groups been dealt out among the particles at random."""
    return dispersed(position, np.random.default_rng(seed).permutation(group), spacing)


class MixingBook:
    """Collects a row per moment and group: tracer groups, and materials where there is more than one."""

    def __init__(self, materials: Sequence[str]) -> None:
        """``materials`` are their names, in the order of their indices."""
        self._materials = materials
        self.rows: list[dict[str, Any]] = []

    def see(self, moment: Moment) -> None:
        """Add the metal of ``moment`` that has been liquid."""
        chosen = moment.ever_liquid
        if not chosen.any():
            return
        kinds = {"tracer": moment.tracer, "material": moment.material}
        for kind, every in kinds.items():
            if kind == "tracer" and not every.any():
                continue
            if kind == "material" and len(self._materials) < 2:
                continue
            group = every[chosen]
            share = foreign_share(moment.position[chosen], group, moment.spacing)
            for number in np.unique(group):
                self.rows.append(self._row(moment, kind, int(number), moment.position[chosen], group, share))

    def _row(
        self,
        moment: Moment,
        kind: str,
        number: int,
        position: np.ndarray,
        group: np.ndarray,
        share: np.ndarray,
    ) -> dict[str, Any]:
        marked = group == number
        others = len(group) - int(marked.sum())
        random = others / max(len(group) - 1, 1)
        foreign = float(share[marked].mean())
        centre, spread = position[marked].mean(axis=0), position[marked].std(axis=0)
        axes = ("x", "z") if moment.dimension == 2 else ("x", "y", "z")
        return {
            "time_s": moment.time,
            "kind": kind,
            "group": self._materials[number] if kind == "material" else number,
            "particles": int(marked.sum()),
            "foreign_share": foreign,
            "foreign_share_if_random": random,
            "mixing_index": foreign / random if random > 0.0 else float("nan"),
            **{f"centre_{axis}_m": float(value) for axis, value in zip(axes, centre, strict=True)},
            **{f"spread_{axis}_m": float(value) for axis, value in zip(axes, spread, strict=True)},
        }

    def table(self) -> dict[str, list[Any]]:
        """The columns of mixing.csv; empty where there is one group only."""
        return {name: [row[name] for row in self.rows] for name in self.rows[0]} if self.rows else {}

    def chief(self) -> list[dict[str, Any]]:
        """The last row of each group."""
        last = {(row["kind"], row["group"]): row for row in self.rows}
        return list(last.values())
