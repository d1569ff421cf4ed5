"""Tools as plain arrays, the form in which kernels see them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PLANE, BOX, CYLINDER, EXTRUSION, REVOLUTION, MESH = range(6)
"""Codes of `ToolArrays.kind`."""

SEGMENT_COLUMNS = 12
"""Columns of `ToolArrays.segments`, see there."""


class ToolArrays(NamedTuple):
    """All tools of a scene, index by index, in mm; a numba-friendly tuple of arrays.

    A point is first brought into a tool's own frame, ``local = frame @ (x - offset - origin)``.
    """

    kind: NDArray[np.int64]
    """(tools,) shape code."""
    side: NDArray[np.float64]
    """(tools,) 1 for a solid tool, -1 where the material is kept inside the shape."""
    convex: NDArray[np.bool_]
    """(tools,) whether the tool is convex, so that it has one nearest wall everywhere outside."""
    origin: NDArray[np.float64]
    """(tools, 3) origin of the tool's frame in the drawn position."""
    frame: NDArray[np.float64]
    """(tools, 3, 3) rows: the tool's axes; a plane's normal is row 2."""
    size: NDArray[np.float64]
    """(tools, 4): box half sides less rounding, rounding; cylinder radius and half length less rounding, -,
    rounding; extrusion half length; revolution half spine."""
    segment_start: NDArray[np.int64]
    """(tools + 1,) first row of each tool's outline in `segments`."""
    segments: NDArray[np.float64]
    """(segments, 12) outline, solid on the left: x0, y0, x1, y1; arc centre x, y; radius (0 = straight); 1 for an
    arc round the solid, -1 for a hollow one; pseudonormal at the start; pseudonormal at the end."""
    box: NDArray[np.float64]
    """(tools, 2, 3) bounding box of the shape in its own frame (infinite where it is)."""
    grid_start: NDArray[np.int64]
    """(tools,) first value of a mesh tool's distance grid."""
    grid_shape: NDArray[np.int64]
    """(tools, 3) nodes along the local x, y, z; 0 for other tools."""
    grid_origin: NDArray[np.float64]
    """(tools, 3) first node in the local frame."""
    grid_spacing: NDArray[np.float64]
    """(tools,) spacing of the grid."""
    grid_values: NDArray[np.float32]
    """(nodes,) signed distances, x fastest, negative in the shape."""
