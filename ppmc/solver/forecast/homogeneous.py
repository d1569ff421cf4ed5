r"""Finds scenes whose flow is a homogeneous squeeze, so that their answer is known before anything is run.

A prism between two parallel plates that slip, its sides free or held by slip walls, deforms evenly if its viscosity is
that of a Newtonian fluid, of collimated fibres or of planar random ones. Which of these it is says the material itself
(:meth:`ppmc.materials.law.Material.even_as`). Where the dissipation is :math:`f\eta_{23}\dot\varepsilon^2`, the
effective rate is :math:`\sqrt f\dot\varepsilon`: shear thinning changes the force, and nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ppmc.geometry.domain import closed_domain
from ppmc.geometry.tools.toolset import ToolSet
from ppmc.materials import Material
from ppmc.scene.sections.charge import BoxDomain, PlanarRandomOrientation, UniformOrientation
from ppmc.scene.sections.tooling import CylinderTool, ExtrusionTool
from ppmc.solver.forecast.closed_form import Case

if TYPE_CHECKING:
    from ppmc.scene import Scene

Array = NDArray[np.float64]
TOLERANCE = 1e-6  # of the charge's extent: faces closer than this touch
SAMPLES = 15
INSTANTS = 9
KINDS = {"newtonian": "Newtonian", "planar": "planar random", "collimated": "collimated"}


@dataclass(frozen=True)
class Squeeze:
    """The exact answer of a homogeneous squeeze.

    Attributes
    ----------
    kind : str
        What is squeezed, and how its sides are held.
    stretches : dict of str to float
        Final length over initial length, by direction.
    orientation : ndarray, shape (3,), or None
        Diagonal of the final A along x1, x2, x3, or None where the charge's own is not known in closed form.
    forces : two tuples of (float, float)
        Time, s, and press force, uN: where the squeeze begins and just before it ends.
    even : bool
        Whether all particles deform alike; where each has a random direction, only their mean does.
    """

    kind: str
    stretches: dict[str, float]
    orientation: Array | None
    forces: tuple[tuple[float, float], ...]
    even: bool


def homogeneous_squeeze(scene: Scene, tools: ToolSet) -> Squeeze | None:
    """Return the exact answer of a scene, or None if its flow is not a homogeneous squeeze.

    Parameters
    ----------
    scene : Scene
        With sections `charge`, `tooling`, `material` and `solver`.
    tools : ToolSet
        Its tools.
    """
    prism = _prism(scene)
    if prism is None or tools.motions.forced:
        return None
    low, high, volume, axes, points = prism
    for axis in axes:
        gap = _plates(tools, low, high, axis, points, scene.require("solver").end_time)
        if gap is not None:
            return _answer(scene, tools, low, high, volume, axis, points, gap)
    return None


@dataclass(frozen=True)
class _Gap:
    """Two plates: their numbers, where the lower one stands, and the gap between them at knots of their motion."""

    plates: tuple[int, int]
    bottom: Array
    times: Array
    widths: Array


def _prism(scene: Scene) -> tuple[Array, Array, float, tuple[int, ...], Array] | None:
    """Return bounds, volume, axes it may be squeezed along, and points, shape (m, 3), of a charge that is a prism."""
    assert scene.charge is not None
    domain = scene.charge.domain
    if isinstance(domain, BoxDomain):
        low = np.array(domain.origin)
        high = low + np.array(domain.size)
        return low, high, float(np.prod(high - low)), (2, 1, 0), _grid(low, high)
    if not isinstance(domain, CylinderTool | ExtrusionTool) or getattr(domain, "edge_radius", 0.0) > 0.0:
        return None
    axis = int(np.argmax(np.abs(domain.axis)))
    if abs(domain.axis[axis]) < 1.0 - 1e-12:
        return None
    solid = closed_domain(domain, scene.directory)
    low, high = solid.bounds
    points = _grid(low, high)
    return low, high, solid.volume, (axis,), points[solid.contains(points)]


def _grid(low: Array, high: Array) -> Array:
    """Return points from face to face of a box, a little inside."""
    at = [np.linspace(a, b, SAMPLES) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 3)
    middle = 0.5 * (low + high)
    return np.asarray(middle + (points - middle) * (1.0 - 1e-9))


def _facing(tools: ToolSet, points: Array, axis: int, sign: float, tolerance: float) -> tuple[int, float] | None:
    """Return the nearest tool that lies flat before all points of a face with outward normal sign e_axis; its gap."""
    phi, normals = tools.distances(points)
    flat = (-sign * normals[..., axis] > 1.0 - 1e-9).all(axis=1) & (np.ptp(phi, axis=1) < tolerance)
    flat &= phi.min(axis=1) > -tolerance
    if not flat.any():
        return None
    tool = int(np.argmin(np.where(flat, phi[:, 0], math.inf)))
    return tool, max(float(phi[tool, 0]), 0.0)


def _plates(tools: ToolSet, low: Array, high: Array, axis: int, points: Array, end: float) -> _Gap | None:
    """Return the plates that close on a prism along an axis, or None."""
    tolerance = TOLERANCE * float(np.max(high - low))
    lower, upper = points.copy(), points.copy()
    lower[:, axis], upper[:, axis] = low[axis], high[axis]
    first, second = _facing(tools, lower, axis, -1.0, tolerance), _facing(tools, upper, axis, 1.0, tolerance)
    if first is None or second is None:
        return None
    (below, under), (above, over) = first, second
    times = [0.0]
    while (later := tools.next_break(times[-1])) < end:
        times.append(later)
    at = np.array([*times, end])
    moved = np.array([tools.offsets(t)[[below, above]] for t in at])
    across = np.delete(moved, axis, axis=2)
    widths = high[axis] - low[axis] + under + over + moved[:, 1, axis] - moved[:, 0, axis]
    closing = widths[-1] < (high[axis] - low[axis]) * (1.0 - 1e-9) and widths[-1] > 0.0
    if np.abs(across).max() > tolerance or np.diff(widths).max() > tolerance or not closing:
        return None
    return _Gap((below, above), low[axis] - under + moved[:, 0, axis], at, widths)


def _walls(
    tools: ToolSet, low: Array, high: Array, axis: int, end: float
) -> tuple[NDArray[np.bool_], dict[tuple[int, int], int]]:
    """Return which sides of a box are held by fixed tools, shape (3, 2), and the tool of each (axis, side)."""
    held, touching = np.zeros((3, 2), dtype=bool), {}
    tolerance = TOLERANCE * float(np.max(high - low))
    for side in {0, 1, 2} - {axis}:
        for k, (sign, level) in enumerate(((-1.0, low[side]), (1.0, high[side]))):
            face = _grid(low, high)
            face[:, side] = level
            found = _facing(tools, face, side, sign, tolerance)
            if found is not None and found[1] < tolerance and not np.any(tools.offsets(end)[found[0]]):
                held[side, k] = True
                touching[side, k] = found[0]
    return held, touching


def _fibres(scene: Scene, axis: int) -> Array | str | None:
    """Return the direction of collimated fibres in the plane, "planar", or None for any other charge."""
    assert scene.charge is not None
    source = scene.charge.orientation
    if isinstance(source, UniformOrientation) and abs(source.fibre_direction[axis]) < 1e-9:
        return np.array(source.fibre_direction)
    if isinstance(source, PlanarRandomOrientation) and abs(source.normal[axis]) > 1.0 - 1e-9:
        return "planar"
    return None


def _answer(
    scene: Scene, tools: ToolSet, low: Array, high: Array, volume: float, axis: int, points: Array, gap: _Gap
) -> Squeeze | None:
    """Return the exact answer for a prism between plates, or None where its flow is not homogeneous."""
    assert scene.charge is not None
    material: Material = scene.require("material")
    box = isinstance(scene.charge.domain, BoxDomain)
    held, touching = _walls(tools, low, high, axis, gap.times[-1]) if box else (np.zeros((3, 2), dtype=bool), {})
    channel = np.flatnonzero(held.all(axis=1))
    fibres = _fibres(scene, axis)
    acting = _acting(material, fibres, bool(held.any()))
    oblique = isinstance(fibres, np.ndarray) and np.abs(fibres).max() < 1.0 - 1e-9
    slip = not any(tools.tools[k].wall.rubs for k in {*gap.plates, *touching.values()})
    if acting is None or not slip or len(channel) == 2 or (oblique and held.any()):
        return None
    case = Case(axis, int(channel[0]) if len(channel) else None, fibres, acting, material.ratio)
    height = float(high[axis] - low[axis])
    if not _stays_between(tools, low, high, points, held, touching, gap, case):
        return None
    final = height / float(gap.widths[-1])
    sides = "with free sides" if case.channel is None else f"between side walls across x{case.channel + 1}"
    return Squeeze(
        f"{KINDS[acting]} charge {sides}",
        case.named_stretches(final),
        case.orientation(final),
        _forces(gap, case, height, volume, material),
        acting != "planar" or material.even_as() == "planar",
    )


def _stays_between(
    tools: ToolSet, low: Array, high: Array, points: Array,
    held: NDArray[np.bool_], touching: dict[tuple[int, int], int], gap: _Gap, case: Case,
) -> bool:  # fmt: skip
    """Return whether the deforming prism stays on plates and side walls everywhere, and out of all tools."""
    axis, height = case.axis, float((high - low)[case.axis])
    tolerance = TOLERANCE * float(np.max(high - low))
    anchor = np.where(held[:, 0], low, np.where(held[:, 1], high, 0.5 * (low + high)))
    faces = {(axis, side): plate for side, plate in enumerate(gap.plates)} | touching
    for time in np.linspace(0.0, gap.times[-1], INSTANTS):
        open_width = float(np.interp(time, gap.times, gap.widths))
        width = min(height, open_width)
        moved = anchor + (points - anchor) @ case.stretch(height / width).T
        bottom = float(np.interp(time, gap.times, gap.bottom))
        moved[:, axis] = bottom + (points[:, axis] - low[axis]) * width / height
        phi = tools.distances(moved, time)[0]
        if phi.min() < -tolerance:
            return False
        for (a, side), tool in faces.items():
            face = np.abs(points[:, a] - (low, high)[side][a]) < tolerance
            if phi[tool, face].max() > tolerance + max(0.0, open_width - height):
                return False
    return True


def _acting(material: Material, fibres: Array | str | None, walls: bool) -> str | None:
    """Return what the viscosity is that of, one of `KINDS`, or None if of nothing so simple."""
    kind = material.even_as()
    if kind == "planar":
        # Next to a side wall the plane of its fibres is the wall's.
        return None if walls else "planar"
    if kind != "fibres":
        return kind
    if isinstance(fibres, str):
        # Stretched alike, fibres of all directions thin alike; between side walls some are stretched more.
        return None if walls and material.rate_dependent else "planar"
    return None if fibres is None else "collimated"


def _forces(
    gap: _Gap, case: Case, height: float, volume: float, material: Material
) -> tuple[tuple[float, float], ...]:  # fmt: skip
    """Return time and press force where the squeeze begins and just before it ends, of a volume in mm^3."""

    def force(time: float, width: float, speed: float) -> tuple[float, float]:
        factor, rate = case.factor(height / width), speed / width
        return time, factor * (volume * float(material.shear_at(math.sqrt(factor) * rate))) * speed / width**2

    # The motion is linear between knots.
    closing = [k for k in range(len(gap.times) - 1) if gap.widths[k + 1] < min(height, gap.widths[k])]
    speeds = -np.diff(gap.widths) / np.diff(gap.times)
    first, last = closing[0], closing[-1]
    start = min(height, float(gap.widths[first]))
    begin = float(gap.times[first] + (gap.widths[first] - start) / speeds[first])
    return (
        force(begin, start, float(speeds[first])),
        force(float(gap.times[last + 1]), float(gap.widths[last + 1]), float(speeds[last])),
    )
