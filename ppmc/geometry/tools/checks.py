"""Checks before a run: tools that pass through each other, a charge that starts inside a tool."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.errors import SceneError
from ppmc.geometry.points import as_points
from ppmc.geometry.tools.distance import signed_distances
from ppmc.geometry.tools.packed import PLANE
from ppmc.geometry.tools.toolset import ToolSet

FloatArray = NDArray[np.float64]

OPPOSED = -0.9
# Cosine between a face's normal and a motion above which the motion opens or closes what lies before the face.
ALONG = 0.3
SAMPLES_ALONG = 12
INSTANTS = 4
MOST_KNOTS = 50
SMALLEST_MOVE = 1e-9  # of the reach: what is no rounding


@dataclass(frozen=True)
class Gap:
    """Smallest distance between two tools that face each other.

    Attributes
    ----------
    first, second : str
        Names of the tools.
    gap : float
        Distance between the faces, mm; negative where they have passed through each other.
    time : float
        When, s.
    point : ndarray, shape (3,)
        Where, mm.
    """

    first: str
    second: str
    gap: float
    time: float
    point: FloatArray


def tool_gaps(tools: ToolSet, low: ArrayLike, high: ArrayLike, end_time: float) -> list[Gap]:
    """Return the smallest gap, over the stroke, of each pair of tools that face each other in a box.

    At a sample point the two distances add up to the gap wherever the normals are opposed, whichever tool the point
    is in. Tools whose walls meet at an angle may overlap outside the cavity and often must; they are no pair here.
    Faces that slide along each other are none either, such as a ram's in walls that it reaches into, nor are tools that
    rest unless both are planes. Points that start inside a tool, such as those under a sheet on a punch, are left out,
    unless all do.

    Parameters
    ----------
    tools : ToolSet
        The tools; those under force stay where they are drawn.
    low, high : array_like, shape (3,)
        The box in which material will be, mm.
    end_time : float
        End of the run, s.
    """
    axes = [np.linspace(a, b, SAMPLES_ALONG) for a, b in zip(np.asarray(low), np.asarray(high), strict=True)]
    points = np.ascontiguousarray(np.array(np.meshgrid(*axes, indexing="ij")).reshape(3, -1).T, dtype=float)
    clear = tools.clearance(points)[0] >= 0.0
    points = points[clear] if clear.any() else points
    smallest: dict[tuple[int, int], Gap] = {}
    planes = tools.arrays.kind == PLANE
    times = _instants(tools, end_time)
    paths = np.array([tools.offsets(t) for t in times])
    for time in times:
        phi, normals = signed_distances(tools.arrays, tools.offsets(time), points)
        for i in range(len(tools)):
            for j in range(i + 1, len(tools)):
                relative = paths[:, i] - paths[:, j]
                way = relative - relative[0]
                way = way[int(np.argmax(np.linalg.norm(way, axis=1)))]
                moves = float(np.linalg.norm(way))
                if moves == 0.0 and not (planes[i] and planes[j]):
                    continue
                facing = np.einsum("nc,nc->n", normals[i], normals[j]) < OPPOSED
                if moves > 0.0:
                    facing &= np.abs(normals[i] @ way) > ALONG * moves
                if not facing.any():
                    continue
                total = np.where(facing, phi[i] + phi[j], math.inf)
                where = int(np.argmin(total))
                known = smallest.get((i, j))
                if known is None or total[where] < known.gap:
                    gap = Gap(tools.names[i], tools.names[j], float(total[where]), time, points[where])
                    smallest[i, j] = gap
    return list(smallest.values())


def check_tools_apart(tools: ToolSet, low: ArrayLike, high: ArrayLike, end_time: float, least: float = 0.0) -> None:
    """Refuse tools that leave less than `least` (mm) between them at the start or at any time up to `end_time`.

    Raises
    ------
    SceneError
        Naming the pair, the time and the gap.
    """
    for pair in tool_gaps(tools, low, high, end_time):
        if pair.gap > least + 1e-9:
            continue
        where = ", ".join(f"{v:.4g}" for v in pair.point)
        state = f"overlap by {-pair.gap:.4g} mm" if pair.gap < -1e-9 else f"leave a gap of {max(pair.gap, 0.0):.4g} mm"
        fix = "move one of them" if pair.time == 0.0 else "shorten `travel`, the table or `solver.end_time`"
        raise SceneError(
            f"tooling: '{pair.first}' and '{pair.second}' {state} at t = {pair.time:.4g} s near ({where}) mm; {fix}"
        )


def check_charge_clear(tools: ToolSet, points: ArrayLike, tolerance: float = 1e-6) -> None:
    """Refuse particles whose centres lie inside a tool in the drawn position.

    Parameters
    ----------
    tools : ToolSet
        The tools.
    points : array_like, shape (n, 3)
        Particle centres, mm.
    tolerance : float
        Depth that is let pass, mm.

    Raises
    ------
    SceneError
        Naming each tool, how many particles are in it and how deep.
    """
    phi, _ = tools.distances(as_points(points))
    faults = []
    for name, distance in zip(tools.names, phi, strict=True):
        inside = distance < -tolerance
        if inside.any():
            worst = int(np.argmin(distance))
            where = ", ".join(f"{v:.4g}" for v in np.asarray(points)[worst])
            faults.append(
                f"{int(inside.sum()):,} of {len(distance):,} particles are inside '{name}', "
                f"the deepest by {-distance[worst]:.4g} mm at ({where}) mm"
            )
    if faults:
        raise SceneError(
            "tooling: the charge starts inside a tool: " + "; ".join(faults) + "; move the charge or the tool"
        )


def idle_tools(tools: ToolSet, points: ArrayLike, reach: float, end_time: float) -> list[str]:
    """Return a line for each moving tool that never touches the charge, or only leaves it.

    Parameters
    ----------
    tools : ToolSet
        The tools.
    points : array_like, shape (n, 3)
        Places of the charge at the start, mm.
    reach : float
        Distance from a particle's centre at which a tool touches it, mm.
    end_time : float
        End of the run, s; tools under force may go as far as their speed and travel allow.
    """
    where = as_points(points)
    times = _instants(tools, end_time)
    offsets = [_furthest(tools, time) for time in times]
    nearest = np.array([signed_distances(tools.arrays, shift, where)[0].min(axis=1) for shift in offsets])
    lines = []
    for k, name in enumerate(tools.names):
        moved = np.array([shift[k] for shift in offsets])
        if not np.abs(moved - moved[0]).max() > 0.0:
            continue
        closest = int(np.argmin(nearest[:, k]))
        if nearest[closest, k] > reach:
            lines.append(
                f"tool '{name}' never reaches the charge: it comes no nearer than {nearest[closest, k]:.4g} mm up to "
                f"{end_time:.4g} s; move it, or give it more speed, travel or time"
            )
        elif closest == 0 and (np.diff(nearest[:, k]) > SMALLEST_MOVE * reach).all():
            lines.append(f"tool '{name}' only leaves the charge; turn its motion round if it is to press")
    return lines


def _furthest(tools: ToolSet, time: float) -> FloatArray:
    """Return where each tool is, shape (tools, 3), mm; those under force as far as nothing holds them up."""
    offsets = tools.offsets(time)
    for forced in tools.motions.forced:
        offsets[forced.tool] = forced.direction * min(forced.max_speed * time, forced.travel)
    return offsets


def _instants(tools: ToolSet, end_time: float) -> list[float]:
    """Return the times to look at: start, end, each change of a motion (of many, some) and some between."""
    knots = [0.0]
    while (later := tools.next_break(knots[-1])) < end_time:
        knots.append(later)
    knots = knots[:: 1 + len(knots) // MOST_KNOTS]
    between = [np.linspace(a, b, INSTANTS + 1)[:-1] for a, b in pairwise([*knots, end_time]) if b > a]
    return [float(t) for t in np.concatenate([*between, [end_time]])]
