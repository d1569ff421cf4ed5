"""Platelets that stand on edge along the side walls of the charge.

Poured platelets that meet a side wall turn up: their normal is then across the wall instead of across the layers
(J, discussion of Figs 7 and 9). They are placed first, over all layers at once, in a thin layer at the wall.
"""

from __future__ import annotations

import math

import numpy as np

from ppmc.charge.platelets.random_numbers import next_below, next_uniform
from ppmc.compile_cache import njit

# Cells whose walls face more than this cosine apart belong to different walls: platelets do not go round corners.
SAME_WALL = 0.7


@njit
def stand_on_edge(owner, places, normals, wanted, lengths, widths, thickness, height, state):  # type: ignore[no-untyped-def]
    """Let platelets claim cells of the wall layer until `wanted` are taken.

    Parameters
    ----------
    owner : ndarray, shape (m,), int64
        Owner of each wall cell, all -1 at the start; filled with ids from 0.
    places : ndarray, shape (m, 3)
        Centres of the wall cells, mm.
    normals : ndarray, shape (m, 2)
        Unit vectors in x1, x2 towards the wall.
    wanted : int
        Number of cells to take, at most m.
    lengths, widths : ndarray, shape (m,)
        Sizes in the order of placement.
    thickness : float
        Extent of a platelet across the wall, mm.
    height : float
        Height of the charge, which limits how steep fibres can be, mm.
    state : ndarray, shape (1,), uint64
        Random state.

    Returns
    -------
    directions, faces : ndarray, shape (k, 3)
        p and r of each platelet.
    """
    m = len(owner)
    free = np.arange(m)
    left, made = m, 0
    directions = np.empty((m, 3))
    faces = np.empty((m, 3))
    while m - left < wanted:
        c = free[next_below(state, left)]
        n0, n1 = normals[c, 0], normals[c, 1]
        length, width = lengths[made], widths[made]
        steepest = math.asin(min(1.0, height / length))
        angle = (2.0 * next_uniform(state) - 1.0) * steepest
        cosine, sine = math.cos(angle), math.sin(angle)
        kept = 0
        for k in range(left):
            f = free[k]
            x, y, z = places[f, 0] - places[c, 0], places[f, 1] - places[c, 1], places[f, 2] - places[c, 2]
            along, across = -x * n1 + y * n0, x * n0 + y * n1
            u, v = along * cosine + z * sine, z * cosine - along * sine
            inside = abs(u) <= 0.5 * length and abs(v) <= 0.5 * width and abs(across) <= 0.5 * thickness
            if f == c or (inside and normals[f, 0] * n0 + normals[f, 1] * n1 > SAME_WALL):
                owner[f] = made
            else:
                free[kept] = f
                kept += 1
        left = kept
        directions[made] = (-n1 * cosine, n0 * cosine, sine)
        faces[made] = (n0, n1, 0.0)
        made += 1
    return directions[:made], faces[:made]
