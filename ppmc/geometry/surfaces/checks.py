"""What makes a triangle mesh a closed surface; each fault has one message that says what to do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SMALLEST_PLAUSIBLE = 1.0
LARGEST_PLAUSIBLE = 3000.0
MOST_PAIRS = 3_000_000_000


def check_vertices(points: FloatArray, triangles: IntArray, name: str) -> None:
    """Refuse an empty mesh, vertex numbers out of range and vertices that are not finite."""
    if len(triangles) == 0:
        raise InputFileError(f"{name}: holds no triangles; export the surface as a triangle mesh")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputFileError(
            f"{name}: a triangle refers to vertex {int(triangles.max())} but there are {len(points)}; "
            "the file is damaged, export it again"
        )
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputFileError(
            f"{name}: coordinates that are not finite in {len(bad)} vertices, the first is number {bad[0]} "
            f"({points[bad[0]].tolist()}); export the surface again"
        )


def doubtful_scale(points: FloatArray, name: str) -> str | None:
    """Return a doubt about a size that is no mould part in mm, else None; a guess is no reason to refuse."""
    longest = float(np.ptp(points, axis=0).max())
    if SMALLEST_PLAUSIBLE <= longest <= LARGEST_PLAUSIBLE:
        return None
    guess = "m" if longest < SMALLEST_PLAUSIBLE else "um"
    return (
        f"{name}: read in mm, as the scene gives no unit; its longest side is then {longest:.4g} mm. "
        f"If the coordinates are in {guess}, set `unit: {guess}`; `unit: mm` says that they are not"
    )


def check_closed(points: FloatArray, triangles: IntArray, name: str, *, crossing: bool) -> None:
    """Refuse a mesh that is open, not manifold, inconsistently oriented, inside out, flat or crossing itself."""
    if len(triangles) == 0:
        raise InputFileError(f"{name}: all triangles are degenerate (two equal vertices); export it at a finer setting")
    _check_edges(points, triangles, name)
    if crossing:
        _check_crossing(points, triangles, name)
    _check_orientation(points, triangles, name)


def _check_edges(points: FloatArray, triangles: IntArray, name: str) -> None:
    """Refuse edges that do not join exactly two triangles running through them in opposite directions."""
    directed = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    key = directed.min(axis=1) * len(points) + directed.max(axis=1)
    edges, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)

    def place(edge: int) -> str:
        ends = points[[edge // len(points), edge % len(points)]]
        return "(" + ", ".join(f"{v:.4g}" for v in ends.mean(axis=0)) + ") mm"

    single = edges[counts == 1]
    if len(single):
        raise InputFileError(
            f"{name}: the surface is open: {len(single)} edges belong to one triangle only, the first at "
            f"{place(single[0])}. Close the holes in the CAD or mesh program (export a solid, not a face)"
        )
    many = edges[counts > 2]
    if len(many):
        raise InputFileError(
            f"{name}: the surface is not manifold: {len(many)} edges join more than two triangles, the first at "
            f"{place(many[0])}. Remove doubled or inner faces and unite touching bodies"
        )
    forward = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    disagree = edges[np.bincount(inverse.reshape(-1), weights=forward) != 0]
    if len(disagree):
        raise InputFileError(
            f"{name}: neighbouring triangles disagree in orientation at {len(disagree)} edges, the first at "
            f"{place(disagree[0])}. Recompute the normals consistently and outward"
        )


def _check_orientation(points: FloatArray, triangles: IntArray, name: str) -> None:
    """Refuse a surface without volume, and bodies turned inside out; a void in a body must be inward."""
    from ppmc.geometry.surfaces.crossings import points_in_mesh, sort_into_columns
    from ppmc.geometry.surfaces.surface import mesh_volume

    size = np.ptp(points, axis=0)
    volume = mesh_volume(points, triangles)
    if abs(volume) <= 1e-9 * float(np.max(size)) ** 3:
        raise InputFileError(
            f"{name}: the surface encloses no volume ({volume:.3g} mm^3 in a box of "
            f"{size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} mm); thicken the sheet into a solid"
        )
    if volume < 0:
        raise InputFileError(
            f"{name}: the surface is inside out (volume {volume:.4g} mm^3): its normals point inward. "
            "Flip all triangles; a surface that bounds a cavity also points away from it, with `inside: true`"
        )
    bodies = _bodies(triangles, len(points))
    if len(bodies) == 1 or len(bodies) > 200:
        return
    for k, body in enumerate(bodies):
        others = np.concatenate([b for m, b in enumerate(bodies) if m != k])
        depth = bool(points_in_mesh(sort_into_columns(points, others), points[body[0, :1]])[0])
        if (mesh_volume(points, body) < 0) != depth:
            where = points[body[0, 0]]
            raise InputFileError(
                f"{name}: body {k + 1} of {len(bodies)}, with a vertex at ({where[0]:.4g}, {where[1]:.4g}, "
                f"{where[2]:.4g}) mm, is turned inside out; flip its triangles (or unite bodies that overlap)"
            )


def _bodies(triangles: IntArray, vertices: int) -> list[IntArray]:
    """Return the triangles of each connected part."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    count, label = connected_components(
        coo_array((np.ones(len(a)), (a, b)), shape=(vertices, vertices)), directed=False
    )
    if count == 1:
        return [triangles]
    of_triangle = label[triangles[:, 0]]
    order = np.argsort(of_triangle, kind="stable")
    return [triangles[part] for part in np.split(order, np.flatnonzero(np.diff(of_triangle[order])) + 1)]


def _check_crossing(points: FloatArray, triangles: IntArray, name: str) -> None:
    """Refuse triangles that pierce each other; passed over where the pairs to try would be too many."""
    from ppmc.geometry.surfaces.triangles import first_self_crossing

    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    pairs = []
    for axis in range(3):
        ordered = np.sort(low[:, axis])
        pairs.append(
            int(np.sum(np.searchsorted(ordered, high[:, axis], side="right")) - len(low) * (len(low) + 1) // 2)
        )
    axis = int(np.argmin(pairs))
    if pairs[axis] > MOST_PAIRS:
        return
    order = np.argsort(low[:, axis], kind="stable")
    small = 1e-12 * float(np.max(np.ptp(points, axis=0))) ** 3
    partner = first_self_crossing(points, triangles, order, low, high, axis, small)
    found = np.flatnonzero(partner >= 0)
    if len(found):
        where = corners[order[found[0]]].mean(axis=0)
        raise InputFileError(
            f"{name}: the surface crosses itself: {len(found)} triangles are pierced by others, the first at "
            f"({where[0]:.4g}, {where[1]:.4g}, {where[2]:.4g}) mm. "
            "Unite overlapping bodies (boolean union) and export again"
        )
