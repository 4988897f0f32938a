"""Sums of r r^T, which are symmetric: a loop over neighbours adds up their upper triangle only.

3 numbers instead of 4 in 2-D, 6 instead of 9 in 3-D: a compiler does not see that two sums are one.
"""

from typing import Any

from taichi_slm.backend import ti


def symmetric(dimension: int) -> tuple[Any, Any]:
    """Return the Taichi functions r -> upper triangle of r r^T, row by row, and triangle -> matrix [d, d]."""
    triangle = [(i, j) for i in range(dimension) for j in range(i, dimension)]
    place = [[triangle.index((min(i, j), max(i, j))) for j in range(dimension)] for i in range(dimension)]

    @ti.func
    def products(r):
        return ti.Vector([r[i] * r[j] for i, j in ti.static(triangle)])

    @ti.func
    def matrix(sums):
        return ti.Matrix([[sums[k] for k in ti.static(row)] for row in ti.static(place)])

    return products, matrix
