"""From the scene's domain to a lattice of particles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.lattice import Lattice, box_lattice, filled_lattice
from ppmc.errors import SceneError
from ppmc.scene.charge import BoxDomain, ChargeSection, CylinderDomain, ExtrusionDomain, SurfaceDomain

Array = NDArray[np.floating]


def lattice_of(section: ChargeSection, folder: Path = Path()) -> Lattice:
    """Return the particles of a charge.

    Parameters
    ----------
    section : ChargeSection
        Domain, spacing and layers.
    folder : Path
        Folder that relative paths of surfaces refer to.

    Raises
    ------
    SceneError
        If the spacing does not suit the domain or the outline is no simple polygon.
    InputFileError
        If a surface cannot be read or is not closed.
    """
    domain, spacing, layers = section.domain, section.spacing, section.layers
    if isinstance(domain, BoxDomain):
        return box_lattice(domain.origin, domain.size, spacing, layers)
    if isinstance(domain, CylinderDomain):
        return _cylinder(domain, spacing, layers)
    if isinstance(domain, ExtrusionDomain):
        return _extrusion(domain, spacing, layers)
    return _surface(domain, spacing, layers, folder)


def _cylinder(domain: CylinderDomain, spacing: tuple[float, float, float], layers: int | None) -> Lattice:
    """Return the lattice of an upright cylinder."""
    centre, radius = np.asarray(domain.centre), domain.radius
    lower = centre - np.array([radius, radius, 0.0])
    upper = centre + np.array([radius, radius, domain.height])

    def inside(points: Array) -> NDArray[np.bool_]:
        return np.sum((points[:, :2] - centre[:2]) ** 2, axis=1) < radius**2

    volume = np.pi * radius**2 * domain.height
    return filled_lattice(lower, upper, volume, inside, spacing, layers, what="the cylinder")


def _extrusion(domain: ExtrusionDomain, spacing: tuple[float, float, float], layers: int | None) -> Lattice:
    """Return the lattice of an extruded polygon."""
    outline = np.asarray(domain.outline, dtype=float)
    area = polygon_area(outline)
    scale = np.ptp(outline, axis=0)
    if abs(area) < 1e-9 * float(scale[0] * scale[1] + 1e-300) or _crosses_itself(outline):
        raise SceneError("charge.domain.outline: the polygon has no area or its edges cross; list its corners in order")

    def inside(points: Array) -> NDArray[np.bool_]:
        return points_in_polygon(points[:, :2], outline)

    lower = np.append(outline.min(axis=0), domain.base)
    upper = np.append(outline.max(axis=0), domain.base + domain.height)
    volume = abs(area) * domain.height
    return filled_lattice(lower, upper, volume, inside, spacing, layers, what="the extrusion")


def _surface(domain: SurfaceDomain, spacing: tuple[float, float, float], layers: int | None, folder: Path) -> Lattice:
    """Return the lattice inside a closed surface from a file."""
    from ppmc.geometry import closed_surface, points_inside

    surface = closed_surface(folder / domain.file, unit=domain.unit)
    lower, upper = surface.bounds

    def inside(points: Array) -> NDArray[np.bool_]:
        return points_inside(surface, points)

    return filled_lattice(lower, upper, surface.volume, inside, spacing, layers, what=f"the surface {domain.file}")


def polygon_area(outline: Array) -> float:
    """Return the signed area of a polygon, shape (m, 2); positive anticlockwise (shoelace formula)."""
    x, y = (outline - outline[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def points_in_polygon(points: Array, outline: Array) -> NDArray[np.bool_]:
    """Return whether points, shape (n, 2), lie in a polygon, shape (m, 2), by counting crossings of a ray along +x1."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        spans = (y0 > y) != (y1 > y)
        inside ^= spans & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


def _crosses_itself(outline: Array) -> bool:
    """Return whether two edges that share no corner meet."""
    a, b = outline, np.roll(outline, -1, axis=0)
    m = len(outline)

    def side(o: Array, e: Array, x: Array) -> Array:
        return (e[..., 0] - o[..., 0]) * (x[..., 1] - o[..., 1]) - (e[..., 1] - o[..., 1]) * (x[..., 0] - o[..., 0])

    for i in range(m - 1):
        j = np.arange(i + 2, m if i > 0 else m - 1)
        if len(j) == 0:
            continue
        apart = side(a[i], b[i], a[j]) * side(a[i], b[i], b[j]) < 0
        if np.any(apart & (side(a[j], b[j], a[i]) * side(a[j], b[j], b[i]) < 0)):
            return True
    return False
