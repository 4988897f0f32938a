"""One run: the simulation, its folder, its loop."""
