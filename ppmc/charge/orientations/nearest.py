"""Nearest valid voxel of each particle: the map from CT orientations to particles.

Vectors are taken over whole from one voxel and never averaged or interpolated: directions without a sign have no
meaningful mean, and the papers' Lagrangian model keeps platelets distinct (J, section III.B; A, section 2).

A volume may be far larger than memory; only slabs of slices that hold particles (and their neighbourhood) are read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit
from ppmc.files import VoxelGrid
from ppmc.orientation import normalise

Array = NDArray[np.floating]
# A slab of one field stays below this many bytes; with the few fields read at a time the stage keeps well below 1 GiB.
SLAB_BYTES = 64 * 2**20
# Opening one more block costs about as much time as reading this many voxels.
VOXELS_WORTH_A_READ = 50_000.0
# Distances within this share of a voxel are ties, decided by the lower index.
TIE = 1e-9


class VoxelSource(Protocol):
    """What the map needs of an orientations file."""

    grid: VoxelGrid
    names: Any

    def read(self, name: str, region: tuple[slice, slice, slice]) -> NDArray[Any]:
        """Return a block of a field, shape (z, y, x[, component])."""

    def read_points(self, name: str, region: tuple[slice, slice, slice], points: NDArray[Any]) -> NDArray[Any]:
        """Return a field at voxels (z, y, x) of a block, shape (n[, component]); `points` count from its first."""


@dataclass(frozen=True)
class NearestMap:
    """Outcome of the search.

    Attributes
    ----------
    voxel : ndarray, shape (n, 3), int64
        Index (z, y, x) of the voxel each particle takes its data from; -1 where there is none.
    distance : ndarray, shape (n,)
        Distance from particle to voxel centre, mm; inf where there is none.
    outside : ndarray, shape (n,), bool
        Whether the particle lies outside the volume.
    """

    voxel: NDArray[np.int64]
    distance: Array
    outside: NDArray[np.bool_]

    @property
    def found(self) -> NDArray[np.bool_]:
        """Whether each particle has data, shape (n,)."""
        return self.voxel[:, 0] >= 0


@njit
def _nearest_in_slab(mask, first, index, spacing, radius, voxel, distance_squared):  # type: ignore[no-untyped-def]
    """Improve `voxel` and `distance_squared` by the valid voxels of one block that lie within `radius`."""
    nz, ny, nx = mask.shape
    dx, dy, dz = spacing[0], spacing[1], spacing[2]
    smallest = min(dx, min(dy, dz))
    for i in range(index.shape[0]):
        x, y, z = index[i, 0] - first[2], index[i, 1] - first[1], index[i, 2] - first[0]
        best = min(distance_squared[i], radius * radius)
        reach = np.sqrt(best)
        z0, z1 = max(0, int(np.ceil(z - reach / dz - 1e-9))), min(nz - 1, int(np.floor(z + reach / dz + 1e-9)))
        y0, y1 = max(0, int(np.ceil(y - reach / dy - 1e-9))), min(ny - 1, int(np.floor(y + reach / dy + 1e-9)))
        x0, x1 = max(0, int(np.ceil(x - reach / dx - 1e-9))), min(nx - 1, int(np.floor(x + reach / dx + 1e-9)))
        slack = TIE * smallest * smallest
        for kz in range(z0, z1 + 1):
            ez = ((kz - z) * dz) ** 2
            for ky in range(y0, y1 + 1):
                ey = ez + ((ky - y) * dy) ** 2
                if ey > best + slack:
                    continue
                for kx in range(x0, x1 + 1):
                    if mask[kz, ky, kx] == 0:
                        continue
                    e = ey + ((kx - x) * dx) ** 2
                    if e < best - slack or (voxel[i, 0] < 0 and e <= best + slack):
                        best = min(e, best)
                        distance_squared[i] = e
                        voxel[i, 0] = kz + first[0]
                        voxel[i, 1] = ky + first[1]
                        voxel[i, 2] = kx + first[2]


def nearest_valid_voxels(
    source: VoxelSource, points: Array, *, radius: float, confidence: float = 0.0, slab_bytes: int = SLAB_BYTES
) -> NearestMap:
    """Return the nearest voxel with data of each point.

    Parameters
    ----------
    source : VoxelSource
        Orientations with `valid` and, for a threshold above zero, `confidence`.
    points : ndarray, shape (n, 3)
        Positions in the coordinates of the source's grid, mm.
    radius : float
        How far the voxel's centre may lie from the point, mm; at least half a voxel's diagonal is searched, so that
        a point in a valid voxel always finds it. ``inf`` takes the nearest however far.
    confidence : float
        Voxels of lower confidence have no data.
    slab_bytes : int
        Bound on the bytes of one field in memory.

    Raises
    ------
    KeyError
        If a confidence is asked for that the source does not hold.
    """
    grid = source.grid
    index = grid.to_index(points)
    counts = np.array(grid.shape[::-1])
    outside = np.any((index < -0.5 - 1e-6) | (index > counts - 0.5 + 1e-6), axis=1)
    voxel = np.full((len(points), 3), -1, dtype=np.int64)
    squared = np.full(len(points), np.inf)
    spacing = np.asarray(grid.spacing, dtype=float)
    half_diagonal = 0.5 * float(np.linalg.norm(spacing)) * (1.0 + 1e-9)
    for reach in _reaches(half_diagonal, radius, index, counts, spacing):
        todo = np.flatnonzero(voxel[:, 0] < 0)
        for block, members in _blocks(index[todo], reach / spacing, grid.shape, 6, slab_bytes):
            mask = _valid_block(source, block, confidence)
            first = np.array([s.start for s in block], dtype=np.int64)
            chosen = todo[members]
            part, part_squared = voxel[chosen], squared[chosen]
            _nearest_in_slab(mask, first, index[chosen], spacing, reach, part, part_squared)
            voxel[chosen], squared[chosen] = part, part_squared
    return NearestMap(voxel, np.sqrt(squared), outside)


def _reaches(
    half_diagonal: float, radius: float, index: Array, counts: NDArray[np.int64], spacing: Array
) -> list[float]:
    """Return search distances, doubled from half a voxel's diagonal to the radius, or to the whole volume if inf."""
    if np.isinf(radius):
        away = np.maximum(np.maximum(-index, index - counts), 0.0) * spacing
        radius = float(np.linalg.norm(counts * spacing) + np.linalg.norm(away, axis=1).max(initial=0.0))
    radius = max(radius, half_diagonal)
    steps = int(np.ceil(np.log2(radius / half_diagonal)))
    return [half_diagonal * 2.0**k for k in range(steps)] + [radius]


def read_frames(
    source: VoxelSource, voxel: NDArray[np.int64], slab_bytes: int = SLAB_BYTES
) -> tuple[Array, Array, Array]:
    """Return p, r and confidence of voxels.

    Parameters
    ----------
    source : VoxelSource
        Orientations file.
    voxel : ndarray, shape (n, 3), int64
        Indices (z, y, x).
    slab_bytes : int
        Bound on the bytes of one field in memory.

    Returns
    -------
    fibre_direction, platelet_normal : ndarray, shape (n, 3)
        Unit length and perpendicular to double precision (the file holds single precision).
    confidence : ndarray, shape (n,)
        1 if the source has none.
    """
    p = normalise(read_voxels_at(source, "fibre_direction", voxel, slab_bytes))
    r: Array = read_voxels_at(source, "platelet_normal", voxel, slab_bytes)
    r = normalise(r - np.sum(r * p, axis=1, keepdims=True) * p)
    has = "confidence" in source.names
    return p, r, read_voxels_at(source, "confidence", voxel, slab_bytes) if has else np.ones(len(voxel))


def read_voxels_at(
    source: VoxelSource, name: str, voxel: NDArray[np.int64], slab_bytes: int = SLAB_BYTES
) -> NDArray[np.float64]:
    """Return one field at voxels (z, y, x), shape (n,) or (n, 3), reading only the slabs that hold them."""
    components = 3 if name in ("fibre_direction", "platelet_normal") else 1
    out = np.empty((len(voxel), components) if components > 1 else len(voxel))
    for block, members in _slabs(voxel[:, ::-1], np.zeros(3), source.grid.shape, 4 * components, slab_bytes):
        out[members] = source.read_points(name, block, voxel[members] - [s.start for s in block])
    return out


def _valid_block(source: VoxelSource, block: tuple[slice, slice, slice], confidence: float) -> NDArray[np.uint8]:
    """Return 1 where a voxel of the block has data."""
    mask = np.asarray(source.read("valid", block), dtype=np.uint8)
    if confidence > 0.0:
        mask = mask * (np.asarray(source.read("confidence", block)) >= confidence).astype(np.uint8)
    return np.ascontiguousarray(mask)


def _blocks(
    index: NDArray[Any], margin: Array, shape: tuple[int, int, int], voxel_bytes: int, slab_bytes: int
) -> Iterator[tuple[tuple[slice, slice, slice], NDArray[np.int64]]]:
    """Yield blocks that hold all points' neighbourhoods: slabs, or a small box a point where that reads less."""
    slabs = list(_slabs(index, margin, shape, voxel_bytes, slab_bytes))
    in_slabs = sum(float(np.prod([s.stop - s.start for s in block])) for block, _ in slabs)
    box = float(np.prod(2.0 * np.ceil(margin) + 1.0)) + VOXELS_WORTH_A_READ
    if box * len(index) >= in_slabs or box * voxel_bytes > slab_bytes:
        yield from slabs
        return
    limits = np.array(shape[::-1])
    low = np.clip(np.floor(index - margin).astype(np.int64), 0, limits - 1)
    high = np.clip(np.ceil(index + margin).astype(np.int64), 0, limits - 1) + 1
    for i, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        yield (slice(a[2], b[2]), slice(a[1], b[1]), slice(a[0], b[0])), np.array([i])


def _slabs(
    index: NDArray[Any], margin: Array, shape: tuple[int, int, int], voxel_bytes: int, slab_bytes: int
) -> Iterator[tuple[tuple[slice, slice, slice], NDArray[np.int64]]]:
    """Yield blocks (z, y, x) of the volume and the points whose neighbourhood they hold.

    Points are taken in order of z. A block grows while it stays within `slab_bytes` and no run of unused slices
    longer than its margin would be read; a block that one point's margin alone makes too large is split over z, and
    the search goes over the pieces one after the other.
    """
    if len(index) == 0:
        return
    nz, ny, nx = shape
    order = np.argsort(index[:, 2], kind="stable")
    z = index[order, 2]
    low = np.clip(np.floor(z - margin[2]).astype(np.int64), 0, nz - 1)
    high = np.clip(np.ceil(z + margin[2]).astype(np.int64), 0, nz - 1) + 1
    begin = 0
    while begin < len(order):
        # In-plane extent of the points still to come; a good enough bound for all blocks of this call.
        rest = index[order[begin:]]
        x0, y0 = (max(0, int(np.floor(rest[:, a].min() - margin[a]))) for a in (0, 1))
        x1, y1 = (min(n, int(np.ceil(rest[:, a].max() + margin[a])) + 1) for a, n in ((0, nx), (1, ny)))
        if x0 >= x1 or y0 >= y1:
            x0, x1, y0, y1 = min(x0, nx - 1), max(x1, 1), min(y0, ny - 1), max(y1, 1)
            x0, y0 = min(x0, x1 - 1), min(y0, y1 - 1)
        slices = max(1, slab_bytes // max(1, voxel_bytes * (x1 - x0) * (y1 - y0)))
        end = int(np.searchsorted(high, low[begin] + slices, side="right"))
        end = max(end, begin + 1)
        gaps = np.flatnonzero(low[begin + 1 : end] > high[begin : end - 1])
        if len(gaps):
            end = begin + 1 + int(gaps[0])
        members = order[begin:end]
        for start in range(int(low[begin]), int(high[end - 1]), slices):
            stop = min(start + slices, int(high[end - 1]))
            yield (slice(start, stop), slice(y0, y1), slice(x0, x1)), members
        begin = end
