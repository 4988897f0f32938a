"""A config becomes particles: numpy arrays, seeded, the same on every machine."""
