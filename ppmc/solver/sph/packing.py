r"""Packing: the volume fraction that the particles fill around each of them, walls taken as mirrors.

:math:`\sum_j V_j W_{ij}` over neighbours and their mirror images behind walls, in units of its value in a perfect
lattice. It is one in a well packed interior, above one where particles crowd, below one at free surfaces and voids. It
is measured from positions alone, so that its drift from the transported J can be seen and mended
(:mod:`ppmc.solver.sph.volume_balance`).

Particles stand where material crowds, so that a sum taken at them is too large wherever they stand irregularly, by up
to a fifth, and each sees itself. What is wanted is the mean over space. The sum is therefore averaged over a sphere
about the particle, of a radius of nearly a spacing: between particles as often as near them, whether these stand in a
lattice, in twins or in rows. With :math:`P' = u\,W(u)`, a neighbour at distance r counts with

.. math:: \frac12\int_{-1}^1 W\big(\sqrt{r^2 + \rho^2 - 2 r\rho\mu}\big)\,d\mu
   = \frac{P(r + \rho) - P(|r - \rho|)}{2 r \rho} ,

a function of the distance alone, so that a charge that is turned reads the same. The sphere sees no farther than the
particle does; so that nothing depends on who is at the edge of its sight, neighbours fade towards it.

A free surface and a loose pocket inside read alike, but for what is next to them: across half a spacing the packing
falls by a quarter to four tenths about a particle at a surface, about one in a pocket mostly by less than a tenth. The
slope is that over the same sphere, from the mean that is weighted with :math:`\mu`. Particles are taken for inside
where none around them is exposed like that (:func:`inside`).

The metric is the particle's own, as everywhere (:mod:`ppmc.solver.particles.neighbours`). Beyond a convex edge comes no
wall but material that is there anyway: a mirror image counts only where it lies in the tool.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.geometry.tools.distance import tool_distance
from ppmc.geometry.tools.packed import PLANE, ToolArrays
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.smoothing import SUPPORT, kernel_value, pair_weight
from ppmc.solver.walls.contact import places
from ppmc.solver.walls.tools import faces_near

RATIO_STEP = 0.01  # of h in spacings, between which the sum over a lattice is interpolated
NEXT_TO_NOTHING = 1e-5  # distance, in supports, below which a point counts as the centre itself
FACES_SEEN = 4  # walls about a particle that count: a corner of a narrow gap has so many
IMAGES = 15  # of a neighbour near four walls: itself, and those behind each, each two and each three of them
# Radius of the sphere, in spacings, over which the sum is averaged. With it particles in twins, in rows and scattered
# about a lattice read as in the lattice, to a few parts in a thousand. Twins along all three axes would read 1.024 with
# 0.87, the distance of a cell's corners, and 0.97 with 1.1.
SAMPLED = 0.97
INTERIOR = 0.93  # packing above which a particle lies inside the material anyhow
# At a plane surface a lattice reads 0.73 with a fall of 0.28 in its first row and 0.98 with 0.03 in its second; cut
# across a body diagonal, 0.63 with 0.36 and 0.85 with 0.15, where the fall has to tell that the second is covered.
EXPOSED_PACKING, EXPOSED_FALL = 0.87, 0.2  # below and above which a particle is exposed
# The same where a kernel kept within its ratio of axes is swollen as far as it may be: across the longer axes of the
# lattice it sees 0.69 of what the lattice's own would, and rows read 0.84 with a fall of 0.19, and 1.00.
SWOLLEN_PACKING, SWOLLEN_FALL = 0.92, 0.13
MOST_EXPOSED = 0.05  # weighted share of exposed neighbours with which a particle still counts as inside


@dataclass
class Packing:
    """Packing of n particles.

    Attributes
    ----------
    value : ndarray, shape (n,)
    fall : ndarray, shape (n,)
        Change of the packing in half a spacing along its slope, over the packing.
    swollen : ndarray, shape (n,), or float
        How far each kernel is swollen against its lattice: 0 for not at all, 1 for as far as it may be.
    """

    value: np.ndarray
    fall: np.ndarray
    swollen: np.ndarray | float = 0.0


@dataclass
class NearWalls:
    """Walls about those of n particles that have some.

    Attributes
    ----------
    tools : ToolArrays
    offsets : ndarray, shape (tools, 3)
        Their present displacements, mm.
    place : ndarray of int32, shape (n,)
        Row of each particle in the following, -1 where no wall is near.
    tool : ndarray of int32, shape (m, k)
        -1 for none.
    distance : ndarray, shape (m, k)
        mm, infinite for none.
    normal : ndarray, shape (m, k, 3)
        Unit normals into the material.
    """

    tools: ToolArrays
    offsets: np.ndarray
    place: np.ndarray
    tool: np.ndarray
    distance: np.ndarray
    normal: np.ndarray

    @classmethod
    def find(cls, tools: ToolArrays, offsets: np.ndarray, positions: np.ndarray, reach: float) -> NearWalls:
        """Find the walls within `reach` (mm) of positions (n, 3)."""
        rows, tool, distance, normal = faces_near(tools, offsets, positions, reach, FACES_SEEN)
        return cls(tools, offsets, places(rows, len(positions)), tool, distance, normal)


def packing(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, inverse_shape: np.ndarray, smoothing_length: float,
    spacing: np.ndarray, walls: NearWalls,
) -> Packing:  # fmt: skip
    """Packing of each particle.

    Parameters
    ----------
    pairs : Pairs
    positions : ndarray, shape (n, 3)
        mm.
    volumes : ndarray, shape (n,)
        Current volumes, mm^3.
    inverse_shape : ndarray, shape (n, 6)
        Inverse kernel shapes, see :mod:`ppmc.solver.particles.kernel_shape`.
    smoothing_length : float
        mm.
    spacing : ndarray, shape (n,)
        Present spacing of a lattice of such cells, the cube root of the current volume, mm.
    walls : NearWalls
        Those within the kernel's support.
    """
    sums, fall = np.empty(len(positions)), np.empty(len(positions))
    _packing(
        pairs.start, pairs.index, positions, volumes, inverse_shape, SAMPLED * spacing, smoothing_length,
        walls.tools, walls.offsets, walls.place, walls.tool, walls.distance, walls.normal, sums, fall,
    )  # fmt: skip
    ratio = smoothing_length / spacing
    # The mean of the direction times a linear field is a third of its change over the radius.
    return Packing(sums / np.interp(ratio, *_lattice_packings(float(np.median(ratio)))), 1.5 / SAMPLED * fall)


def inside(pairs: Pairs, found: Packing, smoothing_length: float) -> np.ndarray:
    """Whether each particle lies inside the material, shape (n,): in a loose pocket, too, but at no free surface."""
    least_packing = EXPOSED_PACKING + (SWOLLEN_PACKING - EXPOSED_PACKING) * found.swollen
    least_fall = EXPOSED_FALL + (SWOLLEN_FALL - EXPOSED_FALL) * found.swollen
    exposed = (found.value < least_packing) & (found.fall > least_fall)
    everywhere = np.ones(len(exposed), dtype=bool)
    share = interior_mean(pairs, exposed.astype(np.float64), everywhere, smoothing_length)
    return (found.value > INTERIOR) | (share < MOST_EXPOSED)


def interior_mean(pairs: Pairs, values: np.ndarray, interior: np.ndarray, smoothing_length: float) -> np.ndarray:
    """Weighted mean of `values` (n,) over each particle and its neighbours, those in the `interior` (n,) only.

    It is one where none counts.
    """
    out = np.empty(len(values))
    own = pair_weight(0.0, smoothing_length)
    _interior_mean(pairs.start, pairs.count, pairs.index, pairs.weight, values, interior, own, out)
    return out


def _lattice_packings(middle: float) -> tuple[np.ndarray, np.ndarray]:
    # The sum over a lattice of spacing one varies by a few parts in a thousand with h. Ratios on a fixed grid, so that
    # what one particle gets does not depend on the others.
    low, high = int(middle * 0.8 / RATIO_STEP), int(middle * 1.25 / RATIO_STEP) + 2
    ratios = RATIO_STEP * np.arange(low, high)
    return ratios, np.array([_lattice_packing(k) for k in range(low, high)])


@functools.cache
def _lattice_packing(number: int) -> float:
    smoothing_ratio = RATIO_STEP * number
    k = np.arange(-8.0, 9.0)
    squares, counts = np.unique(
        (k[:, None, None] ** 2 + k[None, :, None] ** 2 + k[None, None, :] ** 2).ravel(), return_counts=True
    )
    return float(
        sum(
            count * _fading(r2, smoothing_ratio) * _means_over_sphere(r2, SAMPLED, smoothing_ratio)[0]
            for r2, count in zip(squares.tolist(), counts.tolist(), strict=True)
        )
    )


@njit(cache=True, inline="always")
def _fading(r2, h):
    # With the eighth power corners still see nearly all, and lattices that cross the edge of sight make no jump.
    part = r2 / (SUPPORT * h * SUPPORT * h)
    return max(0.0, 1.0 - part * part * part * part)


@njit(cache=True, inline="always")
def _moments_of_kernel(t):
    # Integrals of the kernel times u and times u cubed from zero to u = 2 t h, over its value at zero, t up to one; the
    # kernel is 1 - 10 t^2 + 20 t^3 - 15 t^4 + 4 t^5.
    t2 = t * t
    first = t2 * (0.5 + t2 * (-2.5 + t * (4.0 + t * (-2.5 + t * (4.0 / 7.0)))))
    third = t2 * t2 * (0.25 + t2 * (-5.0 / 3.0 + t * (20.0 / 7.0 + t * (-1.875 + t * (4.0 / 9.0)))))
    return first, third


@njit(cache=True)
def _means_over_sphere(r2, radius, h):
    """Mean over a sphere of the kernel of a point whose squared distance from its centre is `r2`, 1/mm^3.

    And that weighted with the cosine against the direction to the point, over the distance, 1/mm^4.
    """
    per = 1.0 / (SUPPORT * h)
    r, a = per * math.sqrt(r2), per * radius
    if r < NEXT_TO_NOTHING:
        return kernel_value(radius * radius, h), 0.0
    near_first, near_third = _moments_of_kernel(min(abs(r - a), 1.0))
    far_first, far_third = _moments_of_kernel(min(r + a, 1.0))
    first, third = far_first - near_first, far_third - near_third
    scale = kernel_value(0.0, h) / (2.0 * r * a)
    return scale * first, scale * per * ((r * r + a * a) * first - third) / (2.0 * r * r * a)


@njit(cache=True, parallel=True)
def _packing(start, index, x, volume, metric, radius, h, tools, offsets, place, tool, distance, normal, out, fall):
    for i in prange(x.shape[0]):
        images = np.empty((IMAGES, 3), np.int64)
        near = place[i] if place[i] >= 0 else 0  # any: without images nothing of it is used
        images[0] = -1
        m = _images(distance[near], normal[near], images) if place[i] >= 0 else 1
        out[i], fall[i] = _mean_about(
            i, start[i], start[i + 1], index, x, volume, metric[i], radius[i], h, images[:m], tools, offsets, tool,
            distance, normal, near
        )  # fmt: skip


@njit(cache=True)
def _images(distance, normal, images):
    # After the particles themselves: their images behind each face, and behind two and three at nearly right angles.
    m = 1
    for a in range(distance.shape[0]):
        if distance[a] == np.inf:
            continue
        m = _with_image(images, m, a, -1, -1)
        for b in range(a):
            if not _across(normal[a], normal[b]):
                continue
            m = _with_image(images, m, a, b, -1)
            for c in range(b):
                if _across(normal[a], normal[c]) and _across(normal[b], normal[c]):
                    m = _with_image(images, m, a, b, c)
    return m


@njit(cache=True)
def _with_image(images, m, a, b, c):
    images[m, 0], images[m, 1], images[m, 2] = a, b, c
    return m + 1


@njit(cache=True)
def _across(first, second):
    return abs(first[0] * second[0] + first[1] * second[1] + first[2] * second[2]) < 0.3


@njit(cache=True)
def _height(d0, d1, d2, distance, normal):
    # Of a point above a wall, given the way to it from a point at a distance from that wall.
    return max(distance, 0.0) + d0 * normal[0] + d1 * normal[1] + d2 * normal[2]


@njit(cache=True)
def _in_tools(x, i, j, image, tools, offsets, tool, distance, normal):
    # Whether each reflection of j leads into its tool.
    d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
    for k in image:
        if k < 0:
            break
        height = 2.0 * _height(d0, d1, d2, distance[k], normal[k])
        d0 -= height * normal[k, 0]
        d1 -= height * normal[k, 1]
        d2 -= height * normal[k, 2]
        at = tool[k]
        if tools.kind[at] != PLANE:
            phi, _, _, _ = tool_distance(tools, at, offsets, x[i, 0] + d0, x[i, 1] + d1, x[i, 2] + d2)
            if phi > 0.0:
                return False
    return True


@njit(cache=True)
def _mean_about(
    i, begin, end, index, x, volume, g, radius, h, images, tools, offsets, tool, distance, normal, near
):  # fmt: skip
    total, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0
    for image in range(images.shape[0]):
        # The last turn stands for the particle itself.
        for s in range(begin, end + 1):
            j = np.int64(index[s]) if s < end else np.int64(i)
            d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            behind = True
            for side in range(3):
                k = images[image, side]
                if k >= 0:
                    height = 2.0 * _height(d0, d1, d2, distance[near, k], normal[near, k])
                    behind = behind and height > 0.0
                    d0 -= height * normal[near, k, 0]
                    d1 -= height * normal[near, k, 1]
                    d2 -= height * normal[near, k, 2]
            if not behind:
                continue
            r2 = g[0] * d0 * d0 + g[1] * d1 * d1 + g[2] * d2 * d2
            r2 += 2.0 * (g[3] * d0 * d1 + g[4] * d1 * d2 + g[5] * d0 * d2)
            part = volume[j] * _fading(max(r2, 0.0), h)
            if part == 0.0:
                continue
            if image > 0 and not _in_tools(
                x, i, j, images[image], tools, offsets, tool[near], distance[near], normal[near]
            ):
                continue
            mean, slope = _means_over_sphere(max(r2, 0.0), radius, h)
            total += part * mean
            m0 += part * slope * d0
            m1 += part * slope * d1
            m2 += part * slope * d2
    squared = g[0] * m0 * m0 + g[1] * m1 * m1 + g[2] * m2 * m2
    squared += 2.0 * (g[3] * m0 * m1 + g[4] * m1 * m2 + g[5] * m0 * m2)
    return total, math.sqrt(max(squared, 0.0)) / total


@njit(cache=True, parallel=True)
def _interior_mean(start, count, index, weight, values, interior, own, out):
    for i in prange(values.shape[0]):
        total, mass = 0.0, 0.0
        if interior[i]:
            total, mass = own * values[i], own
        for slot in range(start[i], start[i] + count[i]):
            j = index[slot]
            if interior[j]:
                total += weight[slot] * values[j]
                mass += weight[slot]
        out[i] = total / mass if mass > 0.0 else 1.0
