"""Orientations of a volume, tile by tile on a pool of threads.

Kernels release the interpreter's lock, and each voxel is computed by exactly one thread, in an order of operations
that depends neither on the tiles nor on the number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct import sides
from ppmc.ct.block import EMPTY, Box, Coarse, Floats, Reference, TensorStream
from ppmc.ct.combine import BUFFERS, orient_planes
from ppmc.ct.eigen import CHUNK, scratch
from ppmc.ct.follow import PACKED, STEP, pack_planes, weights_along
from ppmc.ct.layout import reused
from ppmc.ct.noise import independent_samples, tilting_part
from ppmc.ct.normals import Cells
from ppmc.ct.settings import Settings
from ppmc.ct.source import Volume
from ppmc.ct.steered import SteeredStream
from ppmc.ct.tiles import BATCH, Tiling, side_halo, wide_reach

REFERENCE_PLANES = 64
VECTORS = ("fibre_direction", "platelet_normal", "eigenvalues")
SCALARS = ("confidence", "planarity", "predicted_error")
FIELD_NAMES = (*VECTORS, *SCALARS, "valid")
ENERGY_OVER_NOISE = 1.5
"""Mean squared gradient, in units of what noise alone would give, below which there is no texture."""
EMPTY_AXES = (np.empty(0, np.int64), np.empty(0, np.int64))
EMPTY_SHARES = (EMPTY, EMPTY)
EMPTY_COARSE = np.empty((0, 0, 6, 0), np.float32)
LEAST_ENERGY = 1e-6
"""Mean squared gradient per squared voxel, in units of the grey values' variance, below which there is no texture."""


@dataclass(frozen=True)
class Block:
    """Results of a tile.

    Attributes
    ----------
    box : three pairs of int
        Its output voxels (z, y, x).
    fields : dict of ndarray, shape (nz, ny, nx[, 3])
        What was found.
    finished : object
        What the caller's ``finish`` has made of them.
    """

    box: Box
    fields: dict[str, NDArray[np.generic]]
    finished: Any = None


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
        Mean tensor of the noise, in units of the reference.
    normals : bool
        Whether platelet normals are wanted.
    """

    volume: Volume
    spacing: tuple[float, float, float]
    chosen: Settings
    reference: Reference
    stride: int = 1
    least_confidence: float = 0.0
    noise: Floats | None = None
    normals: bool = True

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
    voxel = volume.read((slice(nz // 2, nz // 2 + 1), slice(ny // 2, ny // 2 + 1), slice(nx // 2, nx // 2 + 1)))
    near = 0.0 if volume.without_data(voxel) is not None else float(voxel[0, 0, 0])
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


def empty_fields(shape: tuple[int, int, int]) -> dict[str, NDArray[Any]]:
    """Return arrays for the results of some output voxels (nz, ny, nx)."""
    vectors = {name: np.empty((*shape, 3), np.float32) for name in VECTORS}
    scalars = {name: np.empty(shape, np.float32) for name in SCALARS}
    return {**vectors, **scalars, "valid": np.ones(shape, np.uint8)}


def orient(job: Job, box: Box, coarse: Coarse | None, fields: dict[str, NDArray[Any]]) -> None:
    """Find the orientations of a box of output indices (z, y, x) and write them into ``fields``."""
    k = job.stride
    halo = side_halo(job.chosen)
    if job.volume.read_mask is not None:
        here: Any = tuple(slice(a * k, (b - 1) * k + 1) for a, b in box)
        fields["valid"] &= (job.volume.read_mask(here)[::k, ::k, ::k] != 0).astype(np.uint8)
    # Displaced windows need tensors between the output voxels.
    step = 1 if halo or job.chosen.steering else k
    voxels: Any = tuple((a * k - halo, (b - 1) * k + 1 + halo) for a, b in box)
    apart = k // step
    batch = max(1, BATCH // apart)
    most = (batch - 1) * apart + 1 + 2 * halo
    noise = None if job.noise is None else tilting_part(job.noise)
    stream: TensorStream | SteeredStream
    if job.chosen.steering is not None and coarse is not None:
        stream = SteeredStream(
            job.volume, job.spacing, job.chosen, job.reference, voxels, coarse, noise=noise, halo=halo, step=k
        )
    else:
        stream = TensorStream(
            job.volume, job.chosen, job.reference, voxels, job.chosen.window, stride=(step,) * 3, noise=noise,
            batch=batch if job.chosen.follow else most,
        )  # fmt: skip
    scale = job.reference.unit**2
    least_energy = LEAST_ENERGY / min(job.spacing) ** 2
    if job.noise is not None:
        least_energy = max(least_energy, ENERGY_OVER_NOISE * float(job.noise[:3].sum()))
    inverse_h = (1.0 / np.array(job.spacing)).astype(np.float32)
    along = (STEP * min(job.spacing) * inverse_h).astype(np.float32)
    weights = weights_along() if job.chosen.follow else EMPTY
    samples = independent_samples(job.chosen)
    flat = tuple(fields[name].reshape(-1) for name in FIELD_NAMES)
    ny = stream.counts[1]
    oz, oy, ox = (b - a for a, b in box)
    plane = stream.size
    size = ny * stream.pitch
    # Kernels read a whole chunk where a row ends.
    follow = job.chosen.follow
    slab = reused("slab", (batch if follow else most) * plane + CHUNK * apart)
    scores = reused("scores", most * size + CHUNK * apart) if halo and not follow else EMPTY
    # where windows follow the fibre, tensors are packed voxel by voxel before they are used
    packed = reused("packed", follow * most * size * PACKED)
    inside, rows, columns = (_within(span, n) for span, n in zip(voxels, job.volume.shape, strict=True))
    buffers, score_buffers = scratch(*BUFFERS), scratch(*sides.BUFFERS)
    have = (0, 0)
    for first in range(0, oz, batch):
        last = min(first + batch, oz)
        want = (first * apart, (last - 1) * apart + 1 + 2 * halo)
        kept = max(have[1] - want[0], 0)
        if kept:
            held, floats = (packed, size * PACKED) if follow else (slab, plane)
            held[: kept * floats] = held[(have[1] - have[0] - kept) * floats : (have[1] - have[0]) * floats].copy()
        if scores.size:
            scores[: kept * size] = scores[(have[1] - have[0] - kept) * size : (have[1] - have[0]) * size].copy()
        if follow:
            for begin in range(want[0] + kept, want[1], batch):
                end = min(begin + batch, want[1])
                stream.planes(begin, end, slab)
                pack_planes(
                    slab, stream.channels, (inside[0] - begin, inside[1] - begin), end - begin, begin - want[0],
                    (ny, stream.pitch), rows, columns, packed, score_buffers,
                )  # fmt: skip
        elif isinstance(stream, SteeredStream):
            stream.planes(want[0] + kept, want[1], slab, kept, scores)
        else:
            stream.planes(want[0] + kept, want[1], slab, kept)
            if halo:
                sides.score_planes(
                    slab, (inside[0] - want[0], inside[1] - want[0]), kept, want[1] - want[0], stream.channels,
                    (ny, stream.pitch), rows, columns, scores, score_buffers,
                )  # fmt: skip
        have = want
        lower, share, near = EMPTY_AXES, EMPTY_SHARES, EMPTY_COARSE
        if coarse is not None:
            outputs = ((box[0][0] + first, box[0][0] + last), box[1], box[2])
            lower, share, near = coarse.at(outputs, k)
        orient_planes(
            packed if follow else slab, scores, (ny, stream.pitch, stream.channels), np.full(3, halo), apart, inverse_h,
            job.chosen.side_steps, along, weights, job.chosen.planar, near.reshape(-1),
            (near.shape[0], near.shape[1], near.shape[3]), lower, share, np.float32(scale),
            np.float32(scale * least_energy), np.float32(job.least_confidence), samples, (last - first, oy, ox),
            first * oy * ox, *flat, buffers,
        )  # fmt: skip


def _within(span: tuple[int, int], n: int) -> tuple[int, int]:
    """Return which of the voxels of a span, counted from its first, are among the n of the volume."""
    return max(-span[0], 0), min(n, span[1]) - span[0]


def orientations(job: Job, threads: int, tiles: Tiling, scratch: Path | None = None) -> Iterator[Block]:
    """Yield the orientations of a volume tile by tile, in the order of :meth:`Tiling.boxes`.

    Parameters
    ----------
    job : Job
        What to do.
    threads : int
        Tiles at work at the same time.
    tiles : Tiling
        Where to cut.
    scratch : Path, optional
        File for intermediate sums that would not fit into memory.

    Yields
    ------
    Block
        Its arrays are used again for a later tile: copy or write them before asking for the next.
    """
    with ThreadPoolExecutor(threads) as pool:
        cells = cells_of(job)
        if cells is not None:
            cells.fill(pool, scratch)
        yield from compute_tiles(job, cells, tiles.boxes(), pool, threads)


def cells_of(job: Job) -> Cells | None:
    """Return the cells of the large window, or None where r comes from the window of p."""
    if job.chosen.normal_window is None:
        return None
    return Cells(job.volume, job.spacing, job.chosen, job.reference)


def compute_tiles(
    job: Job,
    cells: Cells | None,
    boxes: list[Box],
    pool: ThreadPoolExecutor,
    threads: int,
    finish: Callable[[dict[str, NDArray[Any]], Box], Any] | None = None,
) -> Iterator[Block]:
    """Yield the orientations of some tiles in the order given; a few buffers go round among the threads.

    ``finish`` works on a tile's fields, on the thread that has found them.
    """
    largest = max((tuple(b - a for a, b in box) for box in boxes), key=lambda n: n[0] * n[1] * n[2], default=(1, 1, 1))
    free = [empty_fields(largest) for _ in range(min(threads + 1, len(boxes)))]  # type: ignore[arg-type]
    waiting = iter(boxes)
    running: deque[tuple[Box, dict[str, NDArray[Any]], Future[tuple[dict[str, NDArray[Any]], Any]]]] = deque()

    def work(box: Box, buffer: dict[str, NDArray[Any]]) -> tuple[dict[str, NDArray[Any]], Any]:
        k = job.stride
        fields = _views(buffer, tuple(b - a for a, b in box))
        beyond = (side_halo(job.chosen) + r for r in wide_reach(job.chosen))
        voxels: Any = tuple((a * k - m, (b - 1) * k + 1 + m) for (a, b), m in zip(box, beyond, strict=True))
        orient(job, box, None if cells is None else cells.around(voxels), fields)
        if not job.normals:
            del fields["platelet_normal"], fields["planarity"]
        return fields, finish(fields, box) if finish is not None else None

    while True:
        while free and (box := next(waiting, None)) is not None:
            buffer = free.pop()
            running.append((box, buffer, pool.submit(work, box, buffer)))
        if not running:
            return
        box, buffer, future = running.popleft()
        yield Block(box, *future.result())
        free.append(buffer)


def _views(buffer: dict[str, NDArray[Any]], shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Return contiguous arrays of a smaller shape in the memory of a buffer."""
    views = {}
    for name, array in buffer.items():
        tail = array.shape[3:]
        size = int(np.prod((*shape, *tail)))
        views[name] = array.reshape(-1)[:size].reshape(*shape, *tail)
    views["valid"][...] = 1
    return views
