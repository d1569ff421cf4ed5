"""How a volume is cut into tiles that fit a memory budget."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from ppmc.ct.block import Box
from ppmc.ct.eigen import CHUNK
from ppmc.ct.follow import PACKED, REACH
from ppmc.ct.layout import row_pitch
from ppmc.ct.settings import Settings
from ppmc.ct.steered import TURN
from ppmc.errors import SceneError

MIB = 2**20
BASE_BYTES = 280 * MIB
"""What the interpreter, the compiled kernels and the file libraries take before any voxel is read."""
FIELD_BYTES = 49 + 27
"""Bytes of an output voxel: its fields, and what the file will hold of them, at most."""
CELL_BYTES = 80
"""Sums of a cell of the large window, before and after each of its passes, and the tensors made of them."""
BATCH = 16
"""Planes of tensors at a time: fewer stay in a nearer cache, more share what their windows have in common."""
PLANES = 12
"""Planes of floats that the kernels keep besides."""
FIXED, GRADIENT, FRESH, STEERED, FOLLOWED = 1.0, 1.5, 3.0, 4.0, 3.0
"""Time that an output voxel, a voxel read, a voxel of a buffer that the system must first clear, a voxel with a
steered window and one at which a window that follows the fibre may be take."""
SIDES = (64, 48, 32, 16)
MULTIPLES = (32, 16, 12, 8, 6, 4, 3, 2, 1)


@dataclass(frozen=True)
class Tiling:
    """Tiles of output voxels.

    Attributes
    ----------
    shape : tuple of int
        Output voxels of the volume (nz, ny, nx).
    tile : tuple of int
        Output voxels of a tile, at most.
    """

    shape: tuple[int, int, int]
    tile: tuple[int, int, int]

    def boxes(self) -> list[Box]:
        """Return the tiles as ranges of output indices (z, y, x), in the order of the file."""
        starts = (range(0, n, t) for n, t in zip(self.shape, self.tile, strict=True))
        return [
            tuple((a, min(a + t, n)) for a, t, n in zip(corner, self.tile, self.shape, strict=True))  # type: ignore[misc]
            for corner in itertools.product(*starts)
        ]


def side_halo(chosen: Settings) -> int:
    """Return how many tensors beyond the outputs displaced windows look at."""
    if chosen.follow:
        return REACH
    return chosen.side_steps + 1 if chosen.side_steps else 0


def wide_reach(chosen: Settings) -> tuple[int, int, int]:
    """Return how many voxels beyond a tensor normals are needed (z, y, x): where small steered windows are."""
    return (0, 0, 0) if chosen.steering is None else chosen.steering.voxels[1][::-1]


def steering_reach(chosen: Settings) -> tuple[int, int, int]:
    """Return how many tensors beyond its middle a steered window looks at, in two turns (z, y, x)."""
    if chosen.steering is None:
        return 0, 0, 0
    (x0, y0, z0), (x1, y1, z1) = chosen.steering.voxels
    return z0 + z1, y0 + y1, x0 + x1


def halo_of(chosen: Settings) -> tuple[int, int, int]:
    """Return how many voxels beyond a tile its computation looks at (z, y, x)."""
    reach = zip(chosen.gradient_radius[::-1], chosen.window_radius[::-1], steering_reach(chosen), strict=True)
    hz, hy, hx = (g + w + s + side_halo(chosen) for g, w, s in reach)
    return hz, hy, hx


def tile_bytes(tile: tuple[int, int, int], chosen: Settings, stride: int, itemsize: int, masked: bool) -> int:
    """Return the memory that one tile of output voxels takes while it is computed."""
    grown = [t * stride + 2 * h for t, h in zip(tile, halo_of(chosen), strict=True)]
    voxels = grown[0] * grown[1] * grown[2]
    plane = grown[1] * grown[2] * 4
    outputs = tile[0] * tile[1] * tile[2]
    halo = side_halo(chosen)
    # displaced and steered windows need tensors between the output voxels
    steered = chosen.steering is not None
    dense = 1 if halo or steered else stride
    pulled = min(max(BATCH, stride // dense), tile[0] * stride // dense + 1) + 2 * halo
    slab = pulled * 7
    if steered:
        sums = (3 * TURN + 2 * steering_reach(chosen)[0] + 2 * chosen.window_radius[2]) * 7
    else:
        sums = (2 * chosen.window_radius[2] + 1 + (pulled - 1) * dense) * (7 if masked else 6)
        slab += pulled if masked else 0
    if chosen.follow:
        sums = (2 * chosen.window_radius[2] + BATCH) * (7 if masked else 6)
        slab = BATCH * 7 + pulled * PACKED
    tensors = (sums + slab) * plane // dense**2
    cells = CELL_BYTES if chosen.normal_window is not None else 0
    for t, c, r, w in zip(tile, chosen.cell[::-1], chosen.cell_reach[::-1], wide_reach(chosen), strict=True):
        cells *= (t * stride + 2 * (halo + w)) // c + 2 * r + 3
    values = 4 + itemsize + (16 if masked else 8 if steered else 0)
    return cells + voxels * values + tensors + PLANES * plane + FIELD_BYTES * outputs


def tiling(
    shape: tuple[int, int, int],
    chosen: Settings,
    *,
    stride: int,
    budget: float,
    threads: int,
    itemsize: int,
    masked: bool,
    chunk: tuple[int, int, int] = (16, 16, 16),
) -> Tiling:
    """Return the quickest tiling whose tiles, one for each thread and one being written, fit.

    Parameters
    ----------
    shape : tuple of int
        Output voxels (nz, ny, nx).
    chosen : Settings
        Filters, which decide how far tiles overlap.
    stride : int
        Distance of output voxels.
    budget : float
        Memory, MiB.
    threads : int
        Tiles at work at the same time.
    itemsize : int
        Bytes of a grey value.
    masked : bool
        Whether there is a mask.
    chunk : tuple of int
        Extent of the file's chunks (z, y, x): tiles hold whole ones, unless only smaller tiles fit.

    Raises
    ------
    SceneError
        If not even the smallest tile fits.
    """
    room = budget * MIB - BASE_BYTES
    halo = halo_of(chosen)
    whole = shape[0] * shape[1] * shape[2]
    best: tuple[float, tuple[int, int, int]] | None = None
    least = 0
    whole_ones = [sorted({min(n, s * c) for s in MULTIPLES}, reverse=True) for n, c in zip(shape, chunk, strict=True)]
    smaller = [sorted({min(n, s) for s in SIDES}, reverse=True) for n in shape]
    candidates = itertools.chain(
        itertools.product(*whole_ones), [None], itertools.product(smaller[0], smaller[1], smaller[2])
    )
    for candidate in candidates:
        if candidate is None:
            if best is not None:
                break
            continue
        tile = (candidate[0], candidate[1], candidate[2])
        outputs = tile[0] * tile[1] * tile[2]
        need = tile_bytes(tile, chosen, stride, itemsize, masked) * threads + FIELD_BYTES * outputs
        least = need if least == 0 else min(least, need)
        counts = [-(-n // t) for n, t in zip(shape, tile, strict=True)]
        count = counts[0] * counts[1] * counts[2]
        if need > room:
            continue
        read = counts[2] * row_pitch(tile[2] * stride + 2 * halo[2], stride) * stride / shape[2]
        for n, c, h in zip(shape[:2], counts, halo, strict=False):
            read *= stride + 2.0 * h * c / n
        steered = STEERED if chosen.steering is not None else 0.0
        for n, c in zip(shape, counts, strict=True):
            steered *= stride + 2.0 * side_halo(chosen) * c / n
        lanes = counts[2] * -(-tile[2] // CHUNK) * CHUNK / shape[2]
        buffers = min(threads + 1, count) * outputs / whole
        # the last round may leave threads idle
        work = (FIXED * lanes + steered + (GRADIENT + FOLLOWED * chosen.follow) * read + FRESH * buffers) * (
            -(-count // threads) * threads / count
        )
        if best is None or work < best[0]:
            best = (work, tile)
    if best is None:
        raise SceneError(
            f"ct: memory: {budget:.0f} MiB is too little for {threads} threads; the smallest tiles need "
            f"{(least + BASE_BYTES) / MIB:.0f} MiB (or use fewer threads, or smaller windows)"
        )
    return Tiling(shape, best[1])
