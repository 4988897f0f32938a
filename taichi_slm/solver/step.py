"""The order of the passes in one time step: the page to read first.

Position Verlet (the default) has one force and one continuity evaluation a step, density half a step behind the
velocity. Kick-drift is its symplectic cousin. The printed leapfrog (B.1) moves the density with a velocity that
lags, which is why it needs eight times smaller steps.
"""

from taichi_slm.solver.activity import Activity
from taichi_slm.solver.flow import FlowPasses
from taichi_slm.solver.surface import SurfacePasses


class FlowStep:
    """One step of the flow: who is called, in which order, over which part of the step."""

    def __init__(self, integrator: str, flow: FlowPasses, surface: SurfacePasses | None, activity: Activity,
                 surface_every: int):  # fmt: skip
        self.flow, self.surface, self.activity = flow, surface, activity
        self.surface_every = surface_every
        self.count = 0
        self.advance = {
            "verlet": self.position_verlet,
            "kick_drift": self.kick_drift,
            "leapfrog_printed": self.leapfrog_printed,
        }[integrator]

    def __call__(self, dt: float) -> None:
        """Advance by ``dt`` [s]."""
        self.activity.neighbours()
        self.advance(dt)
        self.count += 1

    def position_verlet(self, dt: float) -> None:
        """Half drift, density, pressure | surface | momentum | kick, half drift | continuity."""
        self.flow.advance(drift=0.5 * dt, density=0.5 * (self.flow.dt + dt))
        self.flow.walls()
        self.surface_forces()
        self.flow.momentum(dt)
        self.flow.kick(dt, drift=0.5 * dt)
        self.flow.continuity()

    def kick_drift(self, dt: float) -> None:
        """Pressure | surface | momentum | kick | continuity at the half-step velocity | drift, density."""
        self.flow.advance(drift=0.0, density=0.0)
        self.flow.walls()
        self.surface_forces()
        self.flow.momentum(dt)
        self.flow.kick(dt, drift=0.0)
        self.flow.continuity()
        self.flow.advance(drift=dt, density=dt)

    def leapfrog_printed(self, dt: float) -> None:
        """(B.1) to the letter: continuity with the velocity of the full step, which is an extrapolation."""
        self.flow.advance(drift=0.0, density=0.0)
        self.flow.walls()
        self.surface_forces()
        self.flow.momentum(dt)
        self.flow.continuity()
        self.flow.kick(dt, drift=dt)
        self.flow.advance(drift=0.0, density=dt)

    def surface_forces(self) -> None:
        """Colour gradient, normals, curvature, tension and Marangoni, every few steps."""
        if self.surface is not None and self.count % self.surface_every == 0:
            self.surface.step()
