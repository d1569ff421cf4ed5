"""The box in which free space between tools is looked for: no closed cavity about the charge reaches beyond it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.geometry.tools.packed import PLANE
from ppmc.geometry.tools.toolset import ToolSet

FloatArray = NDArray[np.float64]

# Beyond all bodies and the charge, in parts of their size, the flood may still come back.
BEYOND = 0.25


def search_box(tools: ToolSet, points: FloatArray, offsets: FloatArray, margin: float) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner, shape (3,), mm, of a box that holds any closed cavity around the points.

    Planes, and shapes that keep the material inside, are half-spaces which the cavity does not leave. Where these
    leave a direction open, only bodies can end the cavity: the box then ends a way beyond the last of them.

    Parameters
    ----------
    tools : ToolSet
    points : ndarray, shape (n, 3)
        Places in the charge, mm.
    offsets : ndarray, shape (tools, 3)
        Displacements of the tools, mm.
    margin : float
        Added on all sides, mm.
    """
    from scipy.optimize import linprog

    arrays = tools.arrays
    normals: list[FloatArray] = []
    heights: list[float] = []
    low, high = points.min(axis=0), points.max(axis=0)
    for t in range(len(tools)):
        origin, frame = arrays.origin[t] + offsets[t], arrays.frame[t]
        if arrays.kind[t] == PLANE:
            normals.append(frame[2])
            heights.append(float(frame[2] @ origin))
            continue
        ends = arrays.box[t]
        if arrays.side[t] < 0.0:
            for axis in range(3):
                for end, sign in ((ends[0, axis], 1.0), (ends[1, axis], -1.0)):
                    if np.isfinite(end):
                        normals.append(sign * frame[axis])
                        heights.append(float(sign * (frame[axis] @ origin + end)))
        elif np.isfinite(ends).all():
            corners = np.array(np.meshgrid(*ends.T, indexing="ij")).reshape(3, -1).T @ frame + origin
            low, high = np.minimum(low, corners.min(axis=0)), np.maximum(high, corners.max(axis=0))
    beyond = BEYOND * float(np.max(high - low))
    low, high = low - beyond, high + beyond
    if normals:
        # n . x >= height for all of them. Tools that have closed on one another leave no such point, and no bound.
        inward, least = -np.array(normals), -np.array(heights)
        for axis in range(3):
            for side, sign in ((low, 1.0), (high, -1.0)):
                aim = np.zeros(3)
                aim[axis] = sign
                found = linprog(aim, A_ub=inward, b_ub=least, bounds=(None, None))
                if found.status == 0:
                    side[axis] = found.x[axis]
    return low - margin, high + margin
