"""Chunks of voxel fields as HDF5 stores them: rounded to what they are worth, shuffled, deflated, with their digest.

Chunks are made by whoever has the values, on any thread, and written as they are. Shuffle and deflate are the filters
that every HDF5 library has, so ParaView reads them; ISA-L deflates some ten times as fast as zlib. Digits below what a
field is worth would be noise that no filter takes away.
"""

# Kernels take arrays and scalars only; numba infers their types.
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit
from ppmc.files.fields import Field

try:
    from isal import isal_zlib as deflater
except ImportError:  # no wheel for this machine: slower, and a little smaller
    import zlib as deflater  # type: ignore[no-redef]

LEVEL = 1
ROUNDER = np.float32(12582912.0)
"""1.5 times 2^23: adding and subtracting it rounds a smaller number to an integer, in a loop that vectorises."""
SAMPLE, WORTH = 4096, 0.5
"""Bytes of a plane that are deflated by way of trial, and what must be left of them at most for the rest to follow."""
STORED = 65535
"""Bytes of a stored block of a deflate stream, at most (RFC 1951)."""
VECTOR_STEP = 2.0**-15
"""Components of unit vectors are multiples of this: half of it turns them by less than 0.002 degrees."""
DIGITS = 8
"""Binary digits that other numbers keep: one part in 512, while no window averages enough gradients to tell the energy
of a texture to a hundredth."""


@njit(nogil=True)
def _round_steps(values, step, inverse):
    """Round numbers of up to one to multiples of a step."""
    for i in range(values.shape[0]):
        values[i] = ((values[i] * inverse + ROUNDER) - ROUNDER) * step


@njit(nogil=True)
def _round_digits(bits, dropped):
    """Round positive and negative numbers, given by their bits, to fewer binary digits; infinities stay."""
    half = np.uint32(1) << np.uint32(dropped - 1)
    mask = ~((np.uint32(1) << np.uint32(dropped)) - np.uint32(1))
    for i in range(bits.shape[0]):
        v = bits[i]
        finite = (v & np.uint32(0x7F800000)) != np.uint32(0x7F800000)
        bits[i] = (v + half) & mask if finite else v


@njit(nogil=True)
def _shuffle(bits, out):
    """Put the first bytes of all numbers first, then the second ones, and so on."""
    n = bits.shape[0]
    for i in range(n):
        out[i] = np.uint8(bits[i])
    for i in range(n):
        out[n + i] = np.uint8(bits[i] >> np.uint32(8))
    for i in range(n):
        out[2 * n + i] = np.uint8(bits[i] >> np.uint32(16))
    for i in range(n):
        out[3 * n + i] = np.uint8(bits[i] >> np.uint32(24))


@dataclass(frozen=True)
class Chunk:
    """A chunk of a field, ready to be stored.

    Attributes
    ----------
    at : tuple of int
        Which chunk it is, counted along z, y, x.
    stored : bytes
        What the file holds of it.
    digest : bytes
        SHA-256 of its values within the volume.
    """

    at: tuple[int, ...]
    stored: bytes
    digest: bytes


def rounded(values: NDArray[Any], spec: Field) -> NDArray[Any]:
    """Return values as a file holds them, in memory of their own."""
    out = np.array(values, dtype=spec.dtype, order="C")
    if out.dtype == np.float32:
        flat = out.reshape(-1)
        if spec.check == "unit":
            _round_steps(flat, np.float32(VECTOR_STEP), np.float32(1.0 / VECTOR_STEP))
        else:
            _round_digits(flat.view(np.uint32), 24 - DIGITS)
    return out


def made(values: NDArray[Any], spec: Field, at: tuple[int, ...], chunk: tuple[int, ...]) -> Chunk:
    """Return a chunk of rounded values, which fill it but for what lies beyond the volume.

    Parameters
    ----------
    values : ndarray, shape (kz, ky, kx[, components])
        The part of it within the volume.
    spec : Field
        The field's contract.
    at : tuple of int
        Which chunk it is.
    chunk : tuple of int
        The extent of whole chunks along all axes of the dataset.
    """
    inside = rounded(values, spec)
    digest = hashlib.sha256(inside.reshape(-1).view(np.uint8)).digest()  # type: ignore[arg-type]
    whole = inside
    if inside.shape != chunk:
        whole = np.zeros(chunk, inside.dtype)
        whole[tuple(slice(0, n) for n in inside.shape)] = inside
    raw: Any = whole.reshape(-1).view(np.uint8)
    if whole.dtype.itemsize == 4:
        raw = np.empty(whole.nbytes, np.uint8)
        _shuffle(whole.reshape(-1).view(np.uint32), raw)
    return Chunk(at, deflated(raw, whole.dtype.itemsize), digest)


def deflated(raw: NDArray[np.uint8], planes: int) -> bytes:
    """Return a zlib stream (RFC 1950) of shuffled bytes.

    The middle bytes of numbers are all but random: where a trial shows that deflating gains little they are stored as
    they are, which takes next to no time.
    """
    parts = [b"\x78\x01"]
    for k, plane in enumerate(raw.reshape(planes, -1)):
        last = k == planes - 1
        if not last and len(deflater.compress(plane[:SAMPLE], LEVEL)) > WORTH * min(SAMPLE, plane.size):
            for at in range(0, plane.size, STORED):
                piece = plane[at : at + STORED]
                parts += [b"\x00", piece.size.to_bytes(2, "little"), (piece.size ^ 0xFFFF).to_bytes(2, "little")]
                parts.append(piece)  # type: ignore[arg-type]
            continue
        engine = deflater.compressobj(LEVEL, deflater.DEFLATED, -15)
        parts.append(engine.compress(plane))
        # a flush ends on a whole byte, so that what follows may be joined to it
        parts.append(engine.flush(deflater.Z_FINISH if last else deflater.Z_FULL_FLUSH))
    parts.append(deflater.adler32(raw).to_bytes(4, "big"))
    return b"".join(parts)
