"""The terms of the equations, one file each; none imports another, but for the property tables."""
