"""Bring grey values into the form the structure-tensor kernel wants: float32, padded by mirroring, x in phases."""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit

Floats = NDArray[np.float32]
U = np.uint64
_OWN = threading.local()
WIDE = 64
LARGEST = np.float32(np.finfo(np.float32).max)


@njit(nogil=True)
def _fill(raw, iz, iy, ix, middle, scale, phases, pitch, out):
    """Write ``(raw - middle) * scale`` at the mapped indices; return the number of values that are not finite."""
    bad = 0
    ny, nx = U(iy.shape[0]), iy.dtype.type(ix.shape[0])
    k, m = U(phases), U(pitch)
    for z in range(U(iz.shape[0])):
        for y in range(ny):
            row = raw[iz[z], iy[y]]
            for s in range(k):
                base = ((z * k + s) * ny + y) * m
                for i in range((nx - s + k - U(1)) // k):
                    v = (np.float32(row[ix[i * k + s]]) - middle) * scale
                    bad += 0 if abs(v) <= LARGEST else 1
                    out[base + i] = v
    return bad


def reused(name: str, size: int) -> Floats:
    """Return an array of this thread's own whose memory the next call with that name gets again.

    Fresh memory for each tile would cost as much time as a tenth of the arithmetic.
    """
    kept: Floats | None = getattr(_OWN, name, None)
    if kept is None or kept.size < size:
        kept = np.zeros(size, np.float32)
        setattr(_OWN, name, kept)
    return kept[:size]


def mirrored(first: int, last: int, n: int) -> NDArray[np.uint64]:
    """Return what stands for indices first .. last - 1 on an axis of n, mirrored about its ends (c b a | a b c)."""
    i = np.arange(first, last) % (2 * n)
    return np.minimum(i, 2 * n - 1 - i).astype(np.uint64)


def row_pitch(nx: int, phases: int) -> int:
    """Return the floats of a padded row of one phase: whole vectors, so that loops over rows leave no remainder."""
    need = -(-nx // phases)
    width = 16 if need >= WIDE else 8
    return -(-need // width) * width


def laid_out(planes: NDArray[np.generic], maps: tuple[NDArray[np.uint64], ...], middle: float, unit: float,
             phases: int) -> tuple[Floats, int]:  # fmt: skip
    """Return grey values (nz, ny, nx) at mapped indices as the kernel wants them, flat (z, phase of x, y, x).

    Parameters
    ----------
    planes : ndarray, shape (nz, ny, nx)
        Grey values of any real type.
    maps : three arrays of indices
        Where to find each z, y and x of the result.
    middle, unit : float
        The result is (grey - middle) / unit.
    phases : int
        Stride along x.

    Returns
    -------
    values : ndarray, flat
        Memory that the next call in the same thread gets again; any finite number pads the rows.
    bad : int
        Number of values that are not finite.
    """
    if planes.dtype not in (np.uint8, np.uint16, np.float32):
        # Numbers that float32 does not hold exactly lose their offset first.
        planes = ((planes.astype(np.float64) - middle) / unit).astype(np.float32)
        middle, unit = 0.0, 1.0
    pitch = row_pitch(len(maps[2]), phases)
    out = reused("grey", len(maps[0]) * phases * len(maps[1]) * pitch)
    native = np.ascontiguousarray(planes, planes.dtype.newbyteorder("="))
    bad = _fill(native, *maps, np.float32(middle), np.float32(1.0 / unit), phases, pitch, out)
    return out, int(bad)
