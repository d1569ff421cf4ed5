"""Triquadratic functions of a cell, and what they are at its sub-points.

A cell has 27 nodes, numbered like the entries of an array (3, 3, 3), and SUB points a side in the middles of equal
parts. With two points and more to a parabola's derivative the sums over full cells are those of the integrals for
everything that a linear velocity field asks for, so that such a field is a solution.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit

SUB = 4  # points a side of a cell
POINTS = SUB**3
NODES = 27


@njit(cache=True, inline="always")
def parabolas(s, value, slope):
    """Three functions of one coordinate s in [-1, 1] and their slopes, into `value` and `slope`, shape (3,)."""
    value[0], value[1], value[2] = 0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)
    slope[0], slope[1], slope[2] = s - 0.5, -2.0 * s, s + 0.5


@njit(cache=True)
def functions(local, value, gradient):
    """Values (27,) and local gradients (27, 3) of a cell's functions at a place in it, each coordinate in [-1, 1]."""
    v, d = np.empty((3, 3)), np.empty((3, 3))
    for c in range(3):
        parabolas(local[c], v[c], d[c])
    for a in range(3):
        for b in range(3):
            for c in range(3):
                node = (a * 3 + b) * 3 + c
                value[node] = v[0, a] * v[1, b] * v[2, c]
                gradient[node, 0] = d[0, a] * v[1, b] * v[2, c]
                gradient[node, 1] = v[0, a] * d[1, b] * v[2, c]
                gradient[node, 2] = v[0, a] * v[1, b] * d[2, c]


def sub_points() -> tuple[np.ndarray, np.ndarray]:
    """Local places of a cell's sub-points, shape (points, 3), and local gradients there, shape (points, 27, 3)."""
    side = (2.0 * np.arange(SUB) + 1.0) / SUB - 1.0
    local = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1).reshape(-1, 3)
    gradients, value = np.empty((POINTS, NODES, 3)), np.empty(NODES)
    for point in range(POINTS):
        functions(local[point], value, gradients[point])
    return local, gradients
