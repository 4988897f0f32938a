"""Accounts: energy, mass and momentum, in f64, and the count of every clamp.

    energy    absorbed + viscous = stored + radiated + evaporated + conducted out + removed
    mass      initial = present + removed
    momentum  present = initial + gravity + walls + surface - frozen - removed

Sums run in one fixed order on a CPU, so that the accounts, too, are the same bits in every run.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_slm.backend import direct, ti

ENERGY = ("absorbed", "radiated", "evaporated", "conducted_out", "viscous", "removed")
MOMENTUM = ("gravity", "walls", "surface", "frozen", "removed")
CLAMPS = ("curvature_clips", "singular_gradients", "packing_brackets", "wall_suction")
CURVATURE_CLIPS, SINGULAR_GRADIENTS, PACKING_BRACKETS, WALL_SUCTION = range(len(CLAMPS))


class Ledger:
    """Accounts on the device: ``energy`` [J] (2-D: J/m), ``momentum`` [N s], ``clamps``, removed particles and mass."""

    def __init__(self, dimension: int):
        d = dimension
        self.energy = ti.field(ti.f64, shape=len(ENERGY))
        self.momentum = ti.Vector.field(d, ti.f64, shape=len(MOMENTUM))
        self.clamps = ti.field(ti.i64, shape=len(CLAMPS))
        self.removed = ti.field(ti.i32, shape=())
        self.removed_mass = ti.field(ti.f64, shape=())
        gravity, walls, surface = (MOMENTUM.index(name) for name in ("gravity", "walls", "surface"))
        momentum = self.momentum

        @ti.func
        def add_impulses(dt, weight, wall, surface_force):
            """Add the impulses [N s] of forces [N] over dt; gravity acts along minus the last axis."""
            for axis in ti.static(range(d)):
                ti.atomic_add(momentum[walls][axis], dt * wall[axis])
                ti.atomic_add(momentum[surface][axis], dt * surface_force[axis])
            ti.atomic_add(momentum[gravity][d - 1], -dt * weight)

        energy = self.energy

        @direct
        @ti.kernel
        def add_energies(amounts: ti.types.ndarray(dtype=ti.f64, ndim=1)):
            for account in ti.static(range(len(ENERGY))):
                energy[account] += amounts[account]

        self.add_impulses: Any = add_impulses
        self._add_energies: Any = add_energies

    def book(self, names: Sequence[str], amounts: np.ndarray) -> None:
        """Add ``amounts`` [J] to the energy accounts ``names``."""
        every = np.zeros(len(ENERGY))
        every[[ENERGY.index(name) for name in names]] = amounts
        self._add_energies(every)

    def energies(self) -> dict[str, float]:
        """Energy accounts by name [J]; in 2-D [J/m]."""
        return dict(zip(ENERGY, (float(x) for x in self.energy.to_numpy()), strict=True))

    def impulses(self) -> dict[str, np.ndarray]:
        """Momentum accounts by name [N s], shape [d] each; in 2-D per metre."""
        return dict(zip(MOMENTUM, self.momentum.to_numpy(), strict=True))

    def clamp_counts(self) -> dict[str, int]:
        """How often each clamp has acted."""
        return dict(zip(CLAMPS, (int(x) for x in self.clamps.to_numpy()), strict=True))
