"""A quasi-isotropic elastic sheet on a tool: elastic forces, and their relaxation along the tool's surface."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit

Array = NDArray[np.floating]
# Maps points, shape (n, 3), onto the surface that the sheet's middle lies on, and gives the normals there.
Project = Callable[[Array], tuple[Array, Array]]

MOST_STEPS = 3000
# A triangle flattened to this squared area ratio resists no further, so that forces stay finite.
SMALLEST_DETERMINANT = 1e-4
# No node moves further than this share of the node distance in one step.
LONGEST_MOVE = 0.1
# A sheet with faces pressed together to less than this share of their area is about to fold.
FOLDING = 0.2
# Forces that would change strains by less than this count as balanced.
STRAIN_TOLERANCE = 5e-5


@njit
def membrane_forces(x, hu, hv, poisson):  # type: ignore[no-untyped-def]
    """Return the elastic forces on the nodes of a sheet, for unit stiffness E t.

    Parameters
    ----------
    x : ndarray, shape (nu, nv, 3)
        Node positions, mm.
    hu, hv : float
        Node distances of the flat sheet, mm.
    poisson : float
        Poisson's ratio.

    Returns
    -------
    ndarray, shape (nu, nv, 3)
        Minus the gradient of the energy of a neo-Hookean membrane, W = mu/2 (I1 - 2 - 2 ln J) + lambda/2 (ln J)^2,
        whose logarithm keeps a sheet in compression from folding through itself. Each quadrilateral is the mean of
        its two divisions into triangles, so that no diagonal is preferred.
    """
    nu, nv = x.shape[0], x.shape[1]
    force = np.zeros_like(x)
    mu = 0.5 / (1.0 + poisson)
    lame = poisson / (1.0 - poisson * poisson)
    # Half of each triangle's area, since every quadrilateral is divided twice.
    area = 0.25 * hu * hv
    for i in range(nu - 1):
        for j in range(nv - 1):
            for corner in range(4):
                # The triangle at a corner: edges along u and v to the two neighbours.
                ci, cj = i + (corner & 1), j + (corner >> 1)
                ui, vj = i + 1 - (corner & 1), j + 1 - (corner >> 1)
                su, sv = (ui - ci) / hu, (vj - cj) / hv
                uu, vv, uv = 0.0, 0.0, 0.0
                for a in range(3):
                    fu = (x[ui, cj, a] - x[ci, cj, a]) * su
                    fv = (x[ci, vj, a] - x[ci, cj, a]) * sv
                    uu += fu * fu
                    vv += fv * fv
                    uv += fu * fv
                det = max(uu * vv - uv * uv, SMALLEST_DETERMINANT)
                # S = mu I + (lambda ln J - mu) C^-1 with C the metric and J^2 = det C.
                share = (0.5 * lame * math.log(det) - mu) / det
                suu, svv, suv = mu + share * vv, mu + share * uu, -share * uv
                for a in range(3):
                    fu = (x[ui, cj, a] - x[ci, cj, a]) * su
                    fv = (x[ci, vj, a] - x[ci, cj, a]) * sv
                    pu = area * (fu * suu + fv * suv) * su
                    pv = area * (fu * suv + fv * svv) * sv
                    force[ui, cj, a] -= pu
                    force[ci, vj, a] -= pv
                    force[ci, cj, a] += pu + pv
    return force


def membrane_energy(x: Array, hu: float, hv: float, poisson: float) -> float:
    """Return the energy whose negative gradient `membrane_forces` is, in plain NumPy."""
    total = 0.0
    for ci, ui in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
        for cj, vj in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
            fu, fv = (x[ui, cj] - x[ci, cj]) / hu, (x[ci, vj] - x[ci, cj]) / hv
            uu, vv, uv = np.sum(fu * fu, -1), np.sum(fv * fv, -1), np.sum(fu * fv, -1)
            log_j = 0.5 * np.log(uu * vv - uv * uv)
            density = (uu + vv - 2 - 2 * log_j) * 0.25 / (1 + poisson) + 0.5 * poisson / (1 - poisson**2) * log_j**2
            total += 0.25 * hu * hv * float(np.sum(density))
    return total


def least_area(x: Array, hu: float, hv: float, normals: Array) -> float:
    """Return the least ratio of a quadrilateral's corner area, seen along the surface's normal, to the flat one's."""
    least = np.inf
    for ci, ui, su in ((slice(None, -1), slice(1, None), 1.0), (slice(1, None), slice(None, -1), -1.0)):
        for cj, vj, sv in ((slice(None, -1), slice(1, None), 1.0), (slice(1, None), slice(None, -1), -1.0)):
            area = np.cross(x[ui, cj] - x[ci, cj], x[ci, vj] - x[ci, cj]) * (su * sv / (hu * hv))
            least = min(least, float(np.sum(area * normals[ci, cj], axis=-1).min()))
    return least


def relax(x: Array, hu: float, hv: float, poisson: float, project: Project) -> tuple[Array, float, int]:
    """Return a sheet in balance on a surface, its middle node held so that it does not slide off.

    Parameters
    ----------
    x : ndarray, shape (nu, nv, 3)
        Start, on the surface.
    hu, hv, poisson : float
        As in `membrane_forces`.
    project : callable
        Brings points onto the surface.

    Returns
    -------
    x : ndarray, shape (nu, nv, 3)
        Positions in balance.
    residual : float
        Largest out-of-balance force along the surface, as a strain.
    steps : int
        Steps taken.

    Notes
    -----
    Damped dynamics with a power-controlled damping (FIRE: Bitzek et al., PRL 97 (2006) 170201,
    doi:10.1103/PhysRevLett.97.170201); positions are brought back onto the surface at every step.
    """
    shape = x.shape
    middle = (shape[0] // 2, shape[1] // 2)
    held = x[middle].copy()
    # Stable for unit mass hu hv: the stiffest mode of the sheet has about this frequency.
    step_most = 0.8 * min(hu, hv) / np.sqrt(8.0 / (1.0 - poisson**2)) * 2.0
    step, damping, uphill = 0.25 * step_most, 0.1, 0
    _, normals = project(x.reshape(-1, 3))
    normals = normals.reshape(shape)
    velocity = np.zeros_like(x)
    residual = np.inf
    for count in range(MOST_STEPS):
        force = membrane_forces(x, hu, hv, poisson)
        force -= np.sum(force * normals, axis=-1, keepdims=True) * normals
        force[middle] = 0.0
        residual = float(np.linalg.norm(force, axis=-1).max()) / min(hu, hv)
        if residual < STRAIN_TOLERANCE:
            return x, residual, count
        acceleration = force / (hu * hv)
        power = float(np.sum(acceleration * velocity))
        if power > 0:
            size = np.linalg.norm(velocity) / max(float(np.linalg.norm(acceleration)), 1e-300)
            velocity = (1.0 - damping) * velocity + damping * size * acceleration
            uphill += 1
            if uphill > 5:
                step, damping = min(step * 1.1, step_most), damping * 0.99
        else:
            velocity[:] = 0.0
            step, damping, uphill = step * 0.5, 0.1, 0
        velocity += step * acceleration
        farthest = step * float(np.linalg.norm(velocity, axis=-1).max())
        if farthest > LONGEST_MOVE * min(hu, hv):
            velocity *= LONGEST_MOVE * min(hu, hv) / farthest
        moved, turned = project((x + step * velocity).reshape(-1, 3))
        x, normals = moved.reshape(shape), turned.reshape(shape)
        x[middle] = held
        velocity -= np.sum(velocity * normals, axis=-1, keepdims=True) * normals
    return x, residual, MOST_STEPS


def relax_coarsely(x: Array, hu: float, hv: float, poisson: float, project: Project) -> Array:
    """Return a sheet far from balance brought near it, by relaxing every fourth and then every second node first.

    Long waves take as many steps to even out as there are nodes along them; on a coarse sheet that is few. What the
    coarse sheet moves is passed on to all nodes by cubic interpolation, unless that would fold the fine sheet.
    Arguments as `relax`; the numbers of nodes are one more than a multiple of four, or that level is left out.
    """
    from scipy.interpolate import RectBivariateSpline

    u, v = np.arange(x.shape[0], dtype=float), np.arange(x.shape[1], dtype=float)
    for stride in (4, 2):
        if (x.shape[0] - 1) % stride or (x.shape[1] - 1) % stride or min(x.shape[:2]) < 4 * stride:
            continue
        coarse = x[::stride, ::stride]
        moved = relax(coarse, stride * hu, stride * hv, poisson, project)[0] - coarse
        change = [RectBivariateSpline(u[::stride], v[::stride], moved[..., a])(u, v) for a in range(3)]
        points, normals = project((x + np.stack(change, axis=-1)).reshape(-1, 3))
        if least_area(points.reshape(x.shape), hu, hv, normals.reshape(x.shape)) > FOLDING:
            x = points.reshape(x.shape)
    return x
