"""A draped charge: a flat sheet formed over a tool and thickened without widening it.

The papers formed the sheet's surface and padded it along the outward normal, which widens a charge whose edges lie on
sloping walls (D, Fig 7). Here the surface that is formed is the sheet's middle, half a thickness above the tool, so
that the mean width over the thickness is the flat sheet's; and heights are chosen column by column so that every cell
keeps its volume through bends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.domains.lattice import Lattice, box_lattice
from ppmc.charge.domains.lay_down import lay_down, node_coordinates, onto_offset
from ppmc.charge.domains.membrane import Project, relax, relax_coarsely
from ppmc.charge.orientations.frames import DRAPED, Frames
from ppmc.charge.orientations.surface_normals import Distance
from ppmc.errors import SceneError
from ppmc.orientation import push_affine, push_normal
from ppmc.scene.sections.charge import DrapedDomain

Array = NDArray[np.floating]
# A bend may thin or thicken cells; below this ratio of areas a face would all but fold over.
LEAST_AREA_RATIO = 0.1
# Cosine between a face's normal and `down` above which no sheet stays on it.
UNDERSIDE = 0.05
# A mean width or length over the thickness that exceeds the flat sheet's by more than this is taken back.
WIDER = 0.002
GIVE = 0.004


@dataclass(frozen=True)
class Draped:
    """The sheet on the tool.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        Particles, in the order of the flat lattice, mm.
    deformation_gradient : ndarray, shape (n, 3, 3)
        From flat sheet (along, across, up) to the tool's coordinates; determinant one.
    notes : dict
        Width and length over the flat sheet's, stretch, balance.
    """

    positions: Array
    deformation_gradient: Array
    notes: dict[str, float]


def flat_sheet(domain: DrapedDomain, spacing: tuple[float, float, float], layers: int | None) -> Lattice:
    """Return the lattice of the flat sheet: x1 along, x2 across, both centred, x3 up from its lower face."""
    length, width, thickness = domain.size
    return box_lattice((-length / 2.0, -width / 2.0, 0.0), (length, width, thickness), spacing, layers)


def drape(domain: DrapedDomain, sheet: Lattice, distance: Distance) -> Draped:
    """Return the sheet on the tool.

    Parameters
    ----------
    domain : DrapedDomain
        Sheet and how it is laid down.
    sheet : Lattice
        The flat sheet's particles, as `flat_sheet` gives them.
    distance : callable
        Signed distance and normal of the tool.

    Raises
    ------
    SceneError
        If the sheet misses the tool, does not come to lie on it, or is too thick for its bends.
    """
    length, width, thickness = domain.size
    project = onto_offset(distance, thickness / 2.0)
    track = onto_offset(distance, thickness / 2.0, rounds=1)
    u, v = node_coordinates(length, sheet.spacing[0]), node_coordinates(width, sheet.spacing[1])
    hu, hv = u[1] - u[0], v[1] - v[0]
    start, isometric = lay_down(domain, u, v, distance, project)
    if not isometric:
        start = relax_coarsely(start, hu, hv, domain.poisson_ratio, project)
    nodes, residual, _ = relax(start, hu, hv, domain.poisson_ratio, track)
    draped = _thickened(domain, sheet, project, _at_columns(nodes, u, v, sheet))
    # Outer halves of bends are longer than inner ones; the middle takes less, so that the mean over the thickness is no
    # wider or longer than the flat sheet. A sheet that is pressed together one way also gives way the other: of that
    # GIVE is left, for the straight parts would pay for all of it.
    for give in (0.0, GIVE, GIVE):
        over = [max(draped.notes[f"{name}_ratio"] - give, 1.0) for name in ("length", "width")]
        thicker = [max(draped.notes[f"{name}_over_middle"], 1.0) for name in ("length", "width")]
        if give == 0.0:
            over = [min(o, t) for o, t in zip(over, thicker, strict=True)]
        if max(over) < 1.0 + WIDER:
            continue
        hu, hv = hu / over[0], hv / over[1]
        nodes, residual, _ = relax(nodes, hu, hv, domain.poisson_ratio, track)
        draped = _thickened(domain, sheet, project, _at_columns(nodes, u, v, sheet))
    draped.notes["forming_residual_strain"] = float(residual)
    return draped


def _thickened(domain: DrapedDomain, sheet: Lattice, project: Project, columns: Array) -> Draped:
    """Return the sheet round its middle surface.

    Parameters
    ----------
    domain, sheet, project
        As in `drape`.
    columns : ndarray, shape (n1, n2, 3)
        Middle surface at the particles' columns.
    """
    length, width, thickness = domain.size
    n3, n2, n1 = sheet.shape
    middle, normals = (a.reshape(n1, n2, 3) for a in project(columns.reshape(-1, 3)))
    under = np.mean(normals @ np.asarray(domain.down) > UNDERSIDE)
    if under > 0:
        raise SceneError(
            f"charge.domain: {under:.1%} of the sheet would lie on the underside of tool '{domain.tool}'; take a "
            "smaller sheet, move its centre, or turn `down`"
        )
    du, dv = sheet.spacing[0], sheet.spacing[1]
    Xu, nu, Xv, nv = (
        _tangential(_slope(field, step, axis), normals)
        for step, axis in ((du, 0), (dv, 1))
        for field in (middle, normals)
    )
    # Area of a face at height w from the middle over the flat one's: a0 + a1 w + a2 w^2.
    a0 = np.sum(normals * np.cross(Xu, Xv), axis=-1)
    a1 = np.sum(normals * (np.cross(Xu, nv) + np.cross(nu, Xv)), axis=-1)
    a2 = np.sum(normals * np.cross(nu, nv), axis=-1)
    positions = np.empty((n3, n2, n1, 3))
    gradient = np.empty((n3, n2, n1, 3, 3))
    for k in range(n3):
        w = _height((k + 0.5) * thickness / n3, thickness, a0, a1, a2)
        area = a0 + a1 * w + a2 * w * w
        if not area.min() > LEAST_AREA_RATIO:
            raise SceneError(
                f"charge.domain: a sheet of {thickness:g} mm does not fit the bends of tool '{domain.tool}': it would "
                "fold over; take a thinner sheet or larger fillets"
            )
        positions[k] = (middle + w[..., None] * normals).transpose(1, 0, 2)
        for axis, column in enumerate((Xu + w[..., None] * nu, Xv + w[..., None] * nv, normals / area[..., None])):
            gradient[k, ..., axis] = column.transpose(1, 0, 2)
    long, wide = _mean_extent(positions, 2), _mean_extent(positions, 1)
    flat_long, flat_wide = length * (n1 - 1) / n1, width * (n2 - 1) / n2
    notes = {
        "length_ratio": long / flat_long if n1 > 1 else 1.0,
        "width_ratio": wide / flat_wide if n2 > 1 else 1.0,
        "length_over_middle": long / _mean_extent(middle[None], 1) if n1 > 1 else 1.0,
        "width_over_middle": wide / _mean_extent(middle[None], 2) if n2 > 1 else 1.0,
        "least_areal_stretch": float(a0.min()),
        "largest_areal_stretch": float(a0.max()),
    }
    return Draped(positions.reshape(-1, 3), gradient.reshape(-1, 3, 3), notes)


def turned(frames: Frames, draped: Draped) -> Frames:
    """Return the flat sheet's frames after forming: p by F.p (J1), r by F^-T.r (J2)."""
    F = draped.deformation_gradient
    p, r = push_affine(frames.fibre_direction, F), push_normal(frames.platelet_normal, F)
    notes = {**frames.notes, **draped.notes}
    source = np.full(len(p), DRAPED, dtype=np.int32)
    return replace(frames, fibre_direction=p, platelet_normal=r, source=source, notes=notes)


def _at_columns(nodes: Array, u: Array, v: Array, sheet: Lattice) -> Array:
    """Return the middle surface at the particles' columns, shape (n1, n2, 3), by cubic interpolation."""
    from scipy.interpolate import RectBivariateSpline

    _, n2, n1 = sheet.shape
    at_u = (np.arange(n1) + 0.5 - n1 / 2.0) * sheet.spacing[0]
    at_v = (np.arange(n2) + 0.5 - n2 / 2.0) * sheet.spacing[1]
    parts = [RectBivariateSpline(u, v, nodes[..., a], kx=3, ky=3)(at_u, at_v) for a in range(3)]
    return np.stack(parts, axis=-1)


def _slope(values: Array, step: float, axis: int) -> Array:
    """Return differences over the lattice, second order up to its edges; zero where there is one column only."""
    n = values.shape[axis]
    return np.gradient(values, step, axis=axis, edge_order=min(2, n - 1)) if n > 1 else np.zeros_like(values)


def _tangential(vectors: Array, normals: Array) -> Array:
    """Return vectors without their part along the normal, which differences of a curved surface have."""
    return vectors - np.sum(vectors * normals, axis=-1, keepdims=True) * normals


def _height(level: float, thickness: float, a0: Array, a1: Array, a2: Array) -> Array:
    """Return the height from the middle below which a column holds the flat sheet's volume up to `level`.

    The lower face stays on the tool: the integral of a0 + a1 w + a2 w^2 from -thickness/2 is `level`.
    """
    low = -thickness / 2.0
    w = np.full_like(a0, low + level)
    for _ in range(30):
        excess = a0 * (w - low) + a1 * (w**2 - low**2) / 2.0 + a2 * (w**3 - low**3) / 3.0 - level
        w = np.clip(w - excess / np.maximum(a0 + a1 * w + a2 * w * w, 0.05), 4.0 * low, -4.0 * low)
    return w


def _mean_extent(positions: Array, axis: int) -> float:
    """Return the mean length of the lattice lines along one axis, particle to particle, mm."""
    steps = np.linalg.norm(np.diff(positions, axis=axis), axis=-1)
    return float(steps.sum(axis=axis).mean())
