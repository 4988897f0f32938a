"""Files of a run: snapshots (VTU, PVD), history (CSV); whole or not at all."""
