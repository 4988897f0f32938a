"""Who has work to do: mobile, beside the mobile, hot or lit. The rows of the lists, and when to choose them anew.

When somebody left its reference position by half a skin, or melted, the lists are stale: those who move get new
references and change their cells, the flow rows are gathered and their lists searched, at a cost that follows the flow
rows. When the warmth, the beam or a mobile particle reached the rim of the hot set, that is outgrown: it is chosen anew
from all cells, which costs a look at every particle, and no list of who moves.
"""

import math
from typing import Any

import numpy as np

from taichi_slm.backend import ti
from taichi_slm.config.schema import Config
from taichi_slm.errors import BlowUpError
from taichi_slm.physics.laser import LaserBins, beam_reach
from taichi_slm.solver.ejection import Ejection
from taichi_slm.solver.flow import FlowPasses
from taichi_slm.solver.heat import HeatPasses
from taichi_slm.solver.surface import SurfacePasses
from taichi_slm.sph.cells import Cells
from taichi_slm.sph.neighbours import Neighbours
from taichi_slm.state import State

# A particle that moves has its reference ahead on its way, so that it is near for long: by this share of half a skin,
# at most by the way of so many flow steps like the last one. Shares of 0.7 to 0.9 and 20 to 60 steps do as well.
AHEAD, AHEAD_STEPS = 0.8, 40
WARM_FROM = 1e-3  # a particle this far from the rest [K] is warm: 1e-6 of a melt pool's rise


class Activity:
    """Keeps cells, rows and lists up to date."""

    def __init__(self, state: State, cells: Cells, rows: Neighbours, config: Config, rest: float, all_hot: bool,
                 bins: LaserBins | None):  # fmt: skip
        performance, dx = config.performance, config.spacing
        self.state, self.cells, self.rows, self.bins = state, cells, rows, bins
        self.flow: FlowPasses | None = None
        self.surface: SurfacePasses | None = None
        self.ejection: Ejection | None = None
        self.heat: HeatPasses | None = None
        self.rest = rest
        self.builds = 0  # of lists
        self.cold_since = 0  # changes when others are cold than before, or the cold ones were changed
        self.stale = self.outgrown = True
        self._placed = False  # whether the cells know where everybody is, but for who moved since
        self._keep = performance.keep_neighbours
        self._half_skin = 0.5 * performance.skin * dx
        self._anew = True  # whether every list is to be searched at the next build
        self._all_flow = not performance.skip_solid
        self._all_hot = all_hot or not performance.skip_cold or not state.needs.heat
        self._laser = config.laser
        self._lit_centre: tuple[float, ...] | None = None
        self._next_centre: tuple[float, ...] | None = None
        self._last_centre: tuple[float, ...] | None = None  # of the beam when it was last on
        self._rim = 0.0  # how far heat comes in the next heat step [m]
        self._rings = 0  # cells that the hot set was grown by for that
        self._margin = 2.0 * cells.size  # how far the beam may move before the lit set is chosen anew
        self._box: Any = ti.types.vector(state.dimension, ti.f64)

    def compile(self) -> None:
        """Launch over nobody what the first build does not need, and put all into cells."""
        if self.cells.can_follow:
            self.cells.follow(self.rows.rows, 0, 0.0, 0.0, 0.0)
            self.cells.rouse(self.rows.hot_rows, 0, WARM_FROM, self.rest)
        self.cells.build(WARM_FROM, self.rest, taken_up=True, dt=0.0)

    def neighbours(self) -> None:
        """Build the lists anew if they are stale or somebody is half a skin away from its reference."""
        moved = self.flow is not None and self.builds > 0 and self.flow.moved > self._half_skin**2
        if not self._keep:
            self.forget()
        if self.stale or moved:
            self.build()
        elif self.outgrown:
            self._widen()

    def beam_at(self, centre: tuple[float, ...] | None) -> None:
        """Tell where the beam is [m] (None: off); far from where it was last, the lit set is stale."""
        if centre is None:
            self._next_centre = None
            return
        self._next_centre = centre
        if self.bins is not None and self._last_centre is not None:
            # a jump, over ground that was not looked at
            if math.dist(centre, self._last_centre) > self.bins.size:
                self.bins.forget()
                self.outgrown = True
        self._last_centre = centre
        if self._lit_centre is None or math.dist(centre, self._lit_centre) > self._margin:
            self.outgrown = True

    def heat_reaches(self, rim: float) -> None:
        """Tell how far heat comes in the next heat step [m]; if that is farther than the hot set, it is outgrown."""
        self._rim = rim
        if self._wanted() > self._rings:
            self.outgrown = True

    def _wanted(self) -> int:
        """Cells around the warm ones: as far as heat comes, and one for what is less than warm."""
        return self.rows.rings(self._rim) + 1

    def build(self) -> None:
        """Cells, rows, lists, ejection, the surface's rows. Raises BlowUpError on a lost particle or a full list."""
        if self.heat is not None and self.flow is not None:
            self.heat.release()
        if self.outgrown or not self.cells.can_follow or not self._follow():
            self._choose()
        self.rows.search()
        self._check_lists()
        if self.ejection is not None:
            self.ejection.step()
        if self.surface is not None:
            self.surface.refresh()
        if self.flow is not None:
            self.flow.moved = 0.0
        self.stale = self.outgrown = self._anew = False
        self.builds += 1

    def _widen(self) -> None:
        """Choose the hot rows anew. Who moves keeps its lists: no skip of cold metal decides when melt is let go."""
        self._choose_hot(taken_up=False)
        self.rows.settle()
        self._check_lists()
        self.outgrown = False

    def _follow(self) -> bool:
        """Gather the flow rows from the cells that the mobile particles are in now; False: the hot set is outgrown."""
        self._take_up()
        self._check_cells()
        return self.rows.gather(self._all_flow, not self._anew)

    def _take_up(self) -> None:
        """Let cells and lists know where those are that have used up what the skin allows, or are about to."""
        within = 0.0 if self._anew else AHEAD * self._half_skin
        # who is taken up now is near for as long as the fastest can be, that is through the whole of the skin
        through = 2.0 * AHEAD * self._half_skin
        dt, fastest = self._last_step()
        steps = min(AHEAD_STEPS, through / (fastest * dt + 1e-30))
        self.cells.follow(self.rows.rows, self.rows.mobile, within, steps, dt)

    def _last_step(self) -> tuple[float, float]:
        """(Length of the last flow step [s], largest speed in it [m/s])."""
        return (0.0, 0.0) if self.flow is None else (self.flow.dt, math.sqrt(self.flow.fastest))

    def _choose(self) -> None:
        """Choose both sets of rows from all particles."""
        self._choose_hot(taken_up=True)
        self.rows.gather(self._all_flow, not self._anew)

    def _choose_hot(self, taken_up: bool) -> None:
        """Choose the hot rows; ``taken_up``: lists are searched next, so that cells may know where everybody is now."""
        if self._placed:
            if taken_up:
                self._take_up()
            self.cells.rouse(self.rows.hot_rows, self.rows.hot, WARM_FROM, self.rest)
        else:
            self.cells.build(WARM_FROM, self.rest, taken_up, self._last_step()[0])
            self._placed = self.cells.can_follow and taken_up
            self._anew = True
        self._check_cells()
        self._rings = self._wanted()
        self.rows.choose_hot(self._all_hot, self._lit_box(), self._rings)
        self.cold_since += 1

    def renew(self) -> None:
        """Choose every row anew at the next build: a run resumed here, which has to, then has the same bits.

        Lists among still particles stay: searched anew they would be the same.
        """
        self.rows.renew()
        self.stale = self.outgrown = self._anew = True

    def forget(self) -> None:
        """Choose every row and search every list anew at the next build; for particles that were put elsewhere."""
        self.rows.forget()
        self.warmed()
        self.stale = self.outgrown = True

    def warmed(self) -> None:
        """Look at the cold as well, at the next choice of hot rows and in the accounts: not the passes changed them."""
        self._placed = False
        self.cold_since += 1

    def restart(self) -> None:
        """Forget all that was known of particles and beam: another moment was loaded, of this scene."""
        self.rows.everyone_is_hot()  # among them those who have melted and wait to be let go
        self._lit_centre = self._next_centre = self._last_centre = None
        self.forget()

    def _check_lists(self) -> None:
        self._check(
            self.rows.overflow, "a neighbour list is full: particles crowd far beyond their spacing", "lists"
        )

    def _check_cells(self) -> None:
        self._check(self.cells.invalid, "a particle has no finite place", "position or temperature")
        self._check(self.cells.overflow, "a cell is full: particles crowd far beyond their spacing", "cells")

    def _lit_box(self) -> tuple[Any, Any]:
        d = self.state.dimension
        low, high = np.full(d, 1.0), np.full(d, -1.0)  # empty
        self._lit_centre = self._next_centre
        if self._lit_centre is not None and self._laser is not None and self.bins is not None:
            reach = beam_reach(self._laser) + self._margin + 2.0 * self.bins.size
            low[: d - 1] = np.asarray(self._lit_centre) - reach
            high[: d - 1] = np.asarray(self._lit_centre) + reach
            low[d - 1], high[d - 1] = self.bins.bottom() - self._margin, np.inf
        return self._box(low), self._box(high)

    def _check(self, flag: Any, rule: str, what: str) -> None:
        particle = int(flag[None])
        if particle >= 0:
            place = self.state.array("position")[particle]
            where = ", ".join(f"{1e6 * x:.2f} um" for x in place)
            raise BlowUpError(
                f"neighbour search ({what}): {rule} (particle {particle} at {where}); "
                "a smaller numerics.courant or a larger numerics.sound_speed may help"
            )
