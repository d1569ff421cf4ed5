"""Orientations of a volume, block by block on a pool of threads.

The volume is read in slabs of planes; a slab's rows are shared out to the threads. Kernels release the interpreter's
lock, and each voxel is computed by exactly one of them, in an order of operations that depends neither on the blocks
nor on the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.block import NO_COARSE, Box, Coarse, Floats, Reference, window_tensors
from ppmc.ct.combine import orient_block
from ppmc.ct.normals import cell_axis, cell_windows, coarse_grid, smooth_cells
from ppmc.ct.settings import Settings
from ppmc.ct.source import Volume

REFERENCE_PLANES = 64
FIELD_NAMES = ("fibre_direction", "platelet_normal", "eigenvalues", "confidence", "planarity", "valid")
LEAST_ENERGY = 1e-6
"""Mean squared gradient per squared voxel, in units of the grey values' variance, below which there is no texture."""


@dataclass(frozen=True)
class Block:
    """Results of some planes: first output plane, and fields (nz, ny, nx[, 3])."""

    first: int
    fields: dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class Job:
    """Everything that a block needs to know.

    Attributes
    ----------
    volume : Volume
        Grey values.
    spacing : tuple of float
        Voxel size (x, y, z), mm.
    chosen : Settings
        Filters.
    reference : Reference
        Unit of grey values.
    stride : int
        Distance of output voxels.
    least_confidence : float
        Linearity below which a voxel is invalid.
    noise : ndarray, shape (6,)
        Tensor of the noise, in units of the reference.
    """

    volume: Volume
    spacing: tuple[float, float, float]
    chosen: Settings
    reference: Reference
    stride: int = 1
    least_confidence: float = 0.0
    noise: Floats | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of output voxels (nz, ny, nx)."""
        nz, ny, nx = ((n - 1) // self.stride + 1 for n in self.volume.shape)
        return nz, ny, nx


def grey_reference(volume: Volume) -> Reference:
    """Return mean and standard deviation of some evenly spaced planes (of the specimen, if there is a mask)."""
    nz, ny, nx = volume.shape
    planes = np.unique(np.linspace(0, nz - 1, min(nz, REFERENCE_PLANES)).round().astype(int))
    count, total, squares = 0, 0.0, 0.0
    # Squares are taken about a value near the mean, so that a large offset costs no digits.
    near = float(
        volume.read((slice(nz // 2, nz // 2 + 1), slice(ny // 2, ny // 2 + 1), slice(nx // 2, nx // 2 + 1)))[0, 0, 0]
    )
    for z in planes:
        box = (slice(z, z + 1), slice(0, ny), slice(0, nx))
        grey = volume.grey(box, near).astype(np.float64)
        chosen = grey if volume.read_mask is None else grey[volume.read_mask(box) != 0]
        count += chosen.size
        total += float(chosen.sum())
        squares += float((chosen * chosen).sum())
    if count == 0:
        return Reference(0.0, 1.0)
    mean = total / count
    unit = float(np.sqrt(max(squares / count - mean * mean, 0.0)))
    return Reference(near + mean, unit if unit > 0.0 else 1.0)


def threads_of(asked: int) -> int:
    """Return the number of threads to use; 0 asks for all cores."""
    return (
        asked
        if asked > 0
        else (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    )


def coarse_tensors(job: Job, pool: ThreadPoolExecutor, rows: int = 4) -> Coarse | None:
    """Return the tensors of the large window, or None where r comes from the window of p."""
    if job.chosen.normal_window is None:
        return None
    cells = job.chosen.cell[::-1]
    axes = [cell_axis(n, c) for n, c in zip(job.volume.shape, cells, strict=True)]
    windows = cell_windows(job.chosen)
    sums = np.empty((axes[0][1], axes[1][1], 7, axes[2][1]), np.float32)
    across = tuple((start, start + (n - 1) * c + 1) for (start, n), c in zip(axes[1:], cells[1:], strict=True))

    def fill(first: int) -> None:
        last = min(first + rows, axes[0][1])
        along = (axes[0][0] + first * cells[0], axes[0][0] + (last - 1) * cells[0] + 1)
        box: Box = (along, across[0], across[1])
        sums[first:last] = window_tensors(
            job.volume, job.chosen, job.reference, box, windows, stride=cells, averaged=False
        )

    list(pool.map(fill, range(0, axes[0][1], rows)))
    return coarse_grid(smooth_cells(sums, job.chosen, job.spacing), job.chosen, job.volume.shape)


def empty_fields(shape: tuple[int, int, int]) -> dict[str, NDArray[Any]]:
    """Return arrays for the results of some output voxels (nz, ny, nx)."""
    vectors = {
        name: np.empty((*shape, 3), np.float32) for name in ("fibre_direction", "platelet_normal", "eigenvalues")
    }
    scalars = {name: np.empty(shape, np.float32) for name in ("confidence", "planarity")}
    return {**vectors, **scalars, "valid": np.ones(shape, np.uint8)}


def orient(job: Job, box: Box, coarse: Coarse | None, fields: dict[str, NDArray[Any]], first: int) -> None:
    """Find the orientations of a box of output indices (z, y, x); ``fields`` begin at output plane ``first``."""
    k = job.stride
    steps = job.chosen.side_steps
    # Displaced windows need tensors between the output voxels.
    step = 1 if steps else k
    inside: Any = tuple(
        (max(a * k - steps, 0), min((b - 1) * k + 1 + steps, n))
        for (a, b), n in zip(box, job.volume.shape, strict=True)
    )
    corner = np.array([a * k - first for (a, _), (first, _) in zip(box, inside, strict=True)])
    tensors = window_tensors(
        job.volume, job.chosen, job.reference, inside, job.chosen.window, stride=(step,) * 3, noise=job.noise
    )
    place = tuple(a - b for (a, _), b in zip(box, (first, 0, 0), strict=True))
    counts = tuple(b - a for a, b in box)
    if job.volume.read_mask is not None:
        here: Any = tuple(slice(a * k, (b - 1) * k + 1) for a, b in box)
        part = tuple(slice(a, a + n) for a, n in zip(place, counts, strict=True))
        fields["valid"][part] = job.volume.read_mask(here)[::k, ::k, ::k] != 0
    start, cell = np.zeros(3, np.int64), np.ones(3, np.int64)
    if coarse is not None:
        start, cell = np.array(coarse.start[::-1]), np.array(coarse.step[::-1])
    scale = job.reference.unit**2
    orient_block(
        tensors, corner[::-1].copy(), k // step, (1.0 / np.array(job.spacing)).astype(np.float32), steps,
        NO_COARSE if coarse is None else coarse.tensors, np.array([a * k for a, _ in box[::-1]]), k, start, cell,
        np.float32(scale), np.float32(scale * LEAST_ENERGY / min(job.spacing) ** 2), np.float32(job.least_confidence),
        np.array(place[::-1]), np.array(counts[::-1]), *(fields[name] for name in FIELD_NAMES),
    )  # fmt: skip


def orientations(job: Job, threads: int, planes: int = 32, rows: int = 64) -> Iterator[Block]:
    """Yield the orientations of a volume from bottom to top, ``planes`` output planes at a time."""
    nz, ny, nx = job.shape
    with ThreadPoolExecutor(threads) as pool:
        coarse = coarse_tensors(job, pool)
        for first in range(0, nz, planes):
            last = min(first + planes, nz)
            boxes: list[Box] = [((first, last), (y, min(y + rows, ny)), (0, nx)) for y in range(0, ny, rows)]
            fields = empty_fields((last - first, ny, nx))
            list(pool.map(lambda box, f=fields, z=first: orient(job, box, coarse, f, z), boxes))
            yield Block(first, fields)
