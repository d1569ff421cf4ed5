r"""Packing: the volume fraction that the particles fill around each of them, walls taken as mirrors.

:math:`\sum_j V_j W_{ij}` over neighbours and their mirror images behind walls, in units of its value in a perfect
lattice. It is one in a well packed interior, above one where particles crowd, below one at free surfaces and voids. It
is measured from positions alone, so that its drift from the transported J can be seen and mended
(:mod:`ppmc.solver.volume_balance`).

Two things would spoil it, and are avoided. At the particles themselves the sum is too large wherever they stand
irregularly, by up to a fifth, for each sees itself; it is therefore sampled at the eight Gauss points of the particle's
own cell. And the mean of two kernel metrics has a larger determinant than either, so that a pair would weigh too
little; each particle's own metric is used.
"""

# mypy: disable-error-code="no-untyped-def"

import functools

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.contact import places
from ppmc.solver.kernel_shape import root_shape
from ppmc.solver.neighbours import Pairs
from ppmc.solver.smoothing import SUPPORT, kernel_value, pair_weight

GAUSS = 0.5 / np.sqrt(3.0)  # places in the cell, in spacings from its centre, at which the sum is sampled
RATIO_STEP = 0.01  # of h in spacings, between which the sum over a lattice is interpolated
INTERIOR = 0.93  # packing above which a particle lies inside the material


def packing(
    pairs: Pairs, positions: np.ndarray, volumes: np.ndarray, shape: np.ndarray, inverse_shape: np.ndarray,
    smoothing_length: float, spacing: np.ndarray, walls: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> np.ndarray:  # fmt: skip
    """Packing of each particle, shape (n,).

    Parameters
    ----------
    pairs : Pairs
    positions : ndarray, shape (n, 3)
        mm.
    volumes : ndarray, shape (n,)
        Current volumes, mm^3.
    shape, inverse_shape : ndarray, shape (n, 6)
        Kernel shapes and their inverse, see :mod:`ppmc.solver.kernel_shape`.
    smoothing_length : float
        mm.
    spacing : ndarray, shape (n,)
        Present spacing of a lattice of such cells, the cube root of the current volume, mm.
    walls : tuple of ndarray
        Numbers of the particles with wall faces within the kernel's support, shape (m,); distances of these, shape
        (m, 3), mm, infinite for none; their unit normals, shape (m, 3, 3), into the material.
    """
    out = np.empty(len(positions))
    rows, distance, normal = walls
    _packing(
        pairs.start, pairs.count, pairs.index, positions, volumes, shape, inverse_shape, GAUSS * spacing,
        smoothing_length, places(rows, len(positions)), distance, normal, out,
    )  # fmt: skip
    return out / np.interp(smoothing_length / spacing, *_lattice_packings(float(np.median(smoothing_length / spacing))))


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
    k = np.arange(-8, 9) - GAUSS
    r2 = (k[:, None, None] ** 2 + k[None, :, None] ** 2 + k[None, None, :] ** 2).ravel()
    return float(sum(kernel_value(float(r), smoothing_ratio) for r in r2))


@njit(cache=True, parallel=True)
def _packing(start, count, index, x, volume, shape, metric, half, h, place, distance, normal, out):
    for i in prange(x.shape[0]):
        step, t, vectors, images = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((7, 2), np.int64)
        root_shape(shape[i], t, vectors, step)
        for a in range(3):
            for b in range(3):
                step[a, b] *= half[i]
        near = place[i] if place[i] >= 0 else 0  # any: without images nothing of it is used
        m = 1
        images[0, 0] = images[0, 1] = -1
        if place[i] >= 0:
            m = _images(distance[near], normal[near], images)
        out[i] = _sum_at(
            i, start[i], count[i], index, x, volume, metric[i], step, half[i], h, images[:m], distance, normal, near
        )  # fmt: skip


@njit(cache=True)
def _images(distance, normal, images):
    # The particles themselves, their images behind each face, and behind each pair of faces at nearly a right angle.
    images[0, 0] = images[0, 1] = -1
    m = 1
    for k in range(distance.shape[0]):
        if distance[k] < np.inf:
            images[m, 0], images[m, 1] = k, -1
            m += 1
    single = m
    for a in range(1, single):
        for b in range(a + 1, single):
            na, nb = normal[images[a, 0]], normal[images[b, 0]]
            if abs(na[0] * nb[0] + na[1] * nb[1] + na[2] * nb[2]) < 0.3:
                images[m, 0], images[m, 1] = images[a, 0], images[b, 0]
                m += 1
    return m


@njit(cache=True)
def _sum_at(i, begin, neighbours, index, x, volume, g, step, half, h, images, distance, normal, near):
    total = 0.0
    reach = SUPPORT * h + np.sqrt(3.0) * half
    for image in range(images.shape[0]):
        # The last turn stands for the particle itself.
        for s in range(neighbours + 1):
            j = np.int64(index[begin + s]) if s < neighbours else np.int64(i)
            d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            for side in range(2):
                k = images[image, side]
                if k >= 0:
                    n0, n1, n2 = normal[near, k, 0], normal[near, k, 1], normal[near, k, 2]
                    height = 2.0 * max(max(distance[near, k], 0.0) + d0 * n0 + d1 * n1 + d2 * n2, 0.0)
                    d0 -= height * n0
                    d1 -= height * n1
                    d2 -= height * n2
            # What is out of reach of the whole cell is out of reach of its Gauss points.
            r2 = g[0] * d0 * d0 + g[1] * d1 * d1 + g[2] * d2 * d2
            r2 += 2.0 * (g[3] * d0 * d1 + g[4] * d1 * d2 + g[5] * d0 * d2)
            if r2 > reach * reach:
                continue
            part = 0.0
            for corner in range(8):
                a = 1.0 if corner & 1 else -1.0
                b = 1.0 if corner & 2 else -1.0
                c = 1.0 if corner & 4 else -1.0
                e0 = d0 + a * step[0, 0] + b * step[0, 1] + c * step[0, 2]
                e1 = d1 + a * step[1, 0] + b * step[1, 1] + c * step[1, 2]
                e2 = d2 + a * step[2, 0] + b * step[2, 1] + c * step[2, 2]
                r2 = g[0] * e0 * e0 + g[1] * e1 * e1 + g[2] * e2 * e2
                r2 += 2.0 * (g[3] * e0 * e1 + g[4] * e1 * e2 + g[5] * e0 * e2)
                part += kernel_value(max(r2, 0.0), h)
            total += 0.125 * volume[j] * part
    return total


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
