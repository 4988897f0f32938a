"""One time step: the passes over the particles, their order, and what may be skipped."""
