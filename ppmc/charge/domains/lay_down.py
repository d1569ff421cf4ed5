"""A first shape of a sheet on a tool, from which forming starts: laid along straight lines, or pressed down small."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.domains.membrane import Project, least_area
from ppmc.charge.orientations.surface_normals import Distance
from ppmc.errors import SceneError
from ppmc.orientation import normalise
from ppmc.scene.sections.charge import DrapedDomain

Array = NDArray[np.floating]
MOST_NODES_A_SIDE = 89


def onto_offset(distance: Distance, offset: float, rounds: int = 4) -> Project:
    """Return the projection onto the surface `offset` above the tool; one round is enough for points close to it."""

    def project(points: Array) -> tuple[Array, Array]:
        for _ in range(rounds):
            phi, normals = distance(points)
            points = points - (phi - offset)[:, None] * normals
        return points, normals if rounds == 1 else distance(points)[1]

    return project


def node_coordinates(extent: float, spacing: float) -> Array:
    """Return one more than a multiple of eight node coordinates, centred, about as dense as the particles."""
    n = min((int(np.ceil(extent / spacing)) + 4) // 8 * 8 + 1, MOST_NODES_A_SIDE)
    return np.linspace(-extent / 2.0, extent / 2.0, max(n, 9))


def lay_down(domain: DrapedDomain, u: Array, v: Array, distance: Distance, project: Project) -> tuple[Array, bool]:
    """Return a first shape, and whether it is laid on along straight lines or, where these cross, pressed down small.

    Raises
    ------
    SceneError
        If the sheet's middle or too much of it misses the tool.
    """
    down = np.asarray(domain.down)
    along = normalise(np.asarray(domain.along) - (np.asarray(domain.along) @ down) * down)
    across = np.cross(-down, along)
    hu, hv = u[1] - u[0], v[1] - v[0]
    x = _laid_along_lines(domain, along, across, u, v, distance, project)
    phi, normals = distance(x.reshape(-1, 3))
    on_tool = np.abs(phi - domain.size[2] / 2.0).max() < 0.05 * domain.size[2]
    if on_tool and least_area(x, hu, hv, normals.reshape(x.shape)) > 0.5:
        return x, True
    flat = u[:, None, None] * along + v[None, :, None] * across
    for scale in np.arange(1.0, 0.15, -0.05):
        points = (np.asarray(domain.centre) + scale * flat).reshape(-1, 3)
        # The corners first: most sheets that are too large miss the tool there.
        ends = [0, len(v) - 1, len(points) - len(v), len(points) - 1]
        if not _drop(points[ends], down, max(domain.size), distance)[1].all():
            continue
        points, hit = _drop(points, down, max(domain.size), distance)
        if not hit.all():
            continue
        x = project(points)[0].reshape(len(u), len(v), 3)
        if least_area(x, hu, hv, project(points)[1].reshape(x.shape)) > 0.0:
            return x, False
    raise SceneError(
        f"charge.domain: a sheet of {domain.size[0]:g} x {domain.size[1]:g} mm does not come to lie on tool "
        f"'{domain.tool}'; take a smaller sheet, move its centre, or turn `down`"
    )


def touching(domain: DrapedDomain, distance: Distance, above: float) -> Array:
    """Return the point, shape (3,), `above` mm over the one on which the sheet's middle comes down.

    Raises
    ------
    SceneError
        If it misses the tool.
    """
    points, hit = _drop(np.asarray(domain.centre)[None], np.asarray(domain.down), max(domain.size), distance)
    if not hit.all():
        raise SceneError(
            f"charge.domain: the line through `centre` {list(domain.centre)} along `down` {list(domain.down)} misses "
            f"tool '{domain.tool}'"
        )
    place: Array = points[0] - above * np.asarray(domain.down)
    return place


def _laid_along_lines(
    domain: DrapedDomain, along: Array, across: Array, u: Array, v: Array, distance: Distance, project: Project
) -> Array:
    """Return the sheet with its middle line laid straight along the tool, and straight lines across it."""
    middle = touching(domain, distance, 0.0)
    x = np.empty((len(u), len(v), 3))
    mu, mv = len(u) // 2, len(v) // 2
    x[mu, mv] = project(middle[None])[0][0]
    for sign in (1, -1):
        _walk(x[:, mv : mv + 1].transpose(1, 0, 2), mu, sign, np.array([sign * along]), u[1] - u[0], project)
    normals = project(x[:, mv])[1]
    sideways = normalise(np.cross(normals, np.gradient(x[:, mv], u[1] - u[0], axis=0)))
    sideways *= np.sign(np.sum(sideways[mu] * across)) or 1.0
    for sign in (1, -1):
        _walk(x, mv, sign, sign * sideways, v[1] - v[0], project)
    return x


def _walk(x: Array, first: int, sign: int, direction: Array, step: float, project: Project) -> None:
    """Fill lines of nodes x, shape (lines, nodes, 3), from node `first` on, straight ahead along the surface."""
    k = first
    while 0 <= k + sign < x.shape[1]:
        ahead = x[:, k] + step * direction
        for _ in range(3):
            there, normals = project(ahead)
            move = there - x[:, k]
            ahead = x[:, k] + move * (step / np.linalg.norm(move, axis=1, keepdims=True))
        x[:, k + sign] = project(ahead)[0]
        move = x[:, k + sign] - x[:, k]
        direction = normalise(move - np.sum(move * normals, axis=1, keepdims=True) * normals)
        k += sign


def _drop(points: Array, down: Array, size: float, distance: Distance) -> tuple[Array, NDArray[np.bool_]]:
    """Return where lines through points first meet the tool from above, and whether they do.

    Each point goes down by its distance to the tool, which never passes through it.
    """
    reach = 10.0 * size
    place = points - reach * down
    gone = np.zeros(len(points))
    hit = np.zeros(len(points), dtype=bool)
    moving = np.arange(len(points))
    for _ in range(1000):
        phi, _ = distance(place[moving])
        hit[moving] = phi < 1e-6 * size
        gone[moving] += phi
        moving = moving[(phi >= 1e-6 * size) & (gone[moving] < 2.0 * reach)]
        if len(moving) == 0:
            break
        place[moving] = points[moving] + (gone[moving] - reach)[:, None] * down
    return place, hit
