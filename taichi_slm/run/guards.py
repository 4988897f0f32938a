"""Guards: what may not happen in a run, looked for within ten steps, and told in full.

| rule | looked for | by |
|---|---|---|
| every particle has a finite place | in every flow step | the kick's largest move |
| no list and no cell is full | whenever lists are made | ``solver/activity.py`` |
| nobody is so much faster than sound that steps collapse to a tenth | in every heat step | here |
| temperatures stay within the property tables | in every heat step | ``Simulation._heat`` |
| mass, heat and momentum are finite and accounted for | every ten flow steps, of cold metal now and then | here |
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from taichi_slm.errors import BlowUpError
from taichi_slm.output.numbers import quantity
from taichi_slm.state import REMOVED

if TYPE_CHECKING:
    from taichi_slm.run.simulation import Simulation

EVERY = 10  # flow steps between looks at the accounts
FASTEST = 10.0  # times the speed of sound: steps are a tenth of what was promised, and density means nothing
MASS = 1e-9  # share of the mass; round-off of a million sums is 1e-10
ENERGY = 1e-2  # share of the turnover; with enthalpy a track keeps 1e-8, in single precision 1e-4
TRIFLE = 0.1  # of energy [J/kg], over all of the mass: 1e-4 K, the round-off of single precision
_WATCHED = ("position", "velocity", "acceleration", "density", "density_rate", "pressure", "surface_force",
            "temperature", "enthalpy")  # fmt: skip


class Guards:
    """Looks at a simulation, and never changes it."""

    def __init__(self, simulation: "Simulation"):
        self._sim = simulation
        self.restart()
        # the apparent heat capacity loses heat where a step jumps over the melting range: a doubt, not an end
        self._conservative = simulation.config.numerics.latent_heat == "enthalpy"

    def restart(self) -> None:
        """Look next where a run that has come this far without a stop would."""
        self._due = dict.fromkeys((False, True), _next(self._sim.steps))

    def speed(self, fastest: float) -> None:
        """Raise BlowUpError if ``fastest`` [m/s] is far beyond sound and cuts steps to a tenth of those at rest."""
        sim = self._sim
        if fastest <= FASTEST * sim.config.numerics.sound_speed:
            return
        at_rest, now = (min(sim.limits.flow(sim.hottest, speed).values()) for speed in (0.0, fastest))
        if now * FASTEST >= at_rest:
            return
        speeds = np.linalg.norm(self._sim.velocity, axis=1)
        raise BlowUpError(
            f"kick: {quantity(fastest, 'm/s')} is more than {FASTEST:.0f} times numerics.sound_speed, and time steps "
            f"collapse ({self._particle(int(np.argmax(speeds)))}); "
            "a larger numerics.sound_speed or a smaller numerics.courant may help"
        )

    def accounts(self, steps: int, heat: bool) -> None:
        """Every ten of ``steps``: raise BlowUpError on a broken account; of energy only where ``heat`` is settled."""
        if steps < self._due[heat]:
            return
        self._due[False] = _next(steps)
        if heat:
            self._due[True] = _next(steps)
        books = self._sim.accounts.books()
        if not all(math.isfinite(value) for value in books):
            raise BlowUpError(f"accounts: a sum over all particles is not finite ({self.not_finite()})")
        if books.mass_error > MASS:
            raise BlowUpError(f"accounts: {books.mass_error:.1e} of the mass is not accounted for")
        trifle = TRIFLE * self._sim.initial_mass
        if heat and self._conservative and books.energy_error > ENERGY and books.unexplained > trifle:
            raise BlowUpError(
                f"accounts: {books.energy_error:.1%} of the energy is not accounted for; "
                "a smaller numerics.heat_factor or numerics.temperature_step may help"
            )

    @contextmanager
    def told(self) -> Iterator[None]:
        """Add to a BlowUpError from within when it was, which step, and what ruled the step."""
        try:
            yield
        except BlowUpError as error:
            sim = self._sim
            what = str(error)
            if "no finite" in what:
                what += f" ({self.not_finite()})"
            raise BlowUpError(
                f"{what}; at {quantity(sim.time, 's')}, step {sim.steps:,} of {quantity(sim.dt, 's')}, "
                f"limited by {sim.dt_limiter}"
            ) from None

    def not_finite(self) -> str:
        """How many particles have which quantities that are not finite, and the one in their middle."""
        state = self._sim.state
        there = state.array("mobility") != REMOVED
        bad = {}
        for name in _WATCHED:
            if name in state.names:
                values = state.array(name).reshape(state.count, -1)
                bad[name] = there & ~np.isfinite(values).all(axis=1)
        everyone = np.logical_or.reduce(list(bad.values()))
        if not everyone.any():
            return "all fields are finite"
        names = ", ".join(name for name, which in bad.items() if which.any())
        ids = np.flatnonzero(everyone)
        places = self._places()[ids]
        middle = ids[np.argmin(np.linalg.norm(places - np.nanmean(places, axis=0), axis=1))]
        return f"{len(ids)} with a {names} that is not finite, in their middle {self._particle(int(middle))}"

    def _particle(self, number: int) -> str:
        sim = self._sim
        where = ", ".join(quantity(x, "m") for x in self._places()[number])
        return f"particle {number}, {sim.scene.materials[sim.scene.material[number]].name}, last at {where}"

    def _places(self) -> np.ndarray:
        """Where the particles are, or were when the lists were made [m], shape [n, dimension]."""
        state = self._sim.state
        now = state.array("position")
        then = state.array("reference_position") if "reference_position" in state.names else now
        return np.where(np.isfinite(now).all(axis=1, keepdims=True), now, then)


def _next(steps: int) -> int:
    return (steps // EVERY + 1) * EVERY
