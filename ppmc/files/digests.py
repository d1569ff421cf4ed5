"""Digests of everything in a file, in blocks where datasets are large, compared block by block as they are read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from itertools import product
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.files.text import attribute, put_attribute

WHOLE_BYTES = 2**25  # datasets up to this size have one digest
DIGESTS = "ppmc/digests"
MANIFEST = "manifest"
LENGTH = 32  # bytes of a SHA-256

Block = tuple[slice, ...]


def digest(values: NDArray[Any]) -> str:
    """Return the SHA-256 of an array's bytes."""
    return hashlib.sha256(
        np.ascontiguousarray(values).tobytes() if values.dtype.kind == "S" else _bytes(values)
    ).hexdigest()


def _bytes(values: NDArray[Any]) -> Any:
    """Return an array's bytes without a copy where there is none to make."""
    flat = np.ascontiguousarray(values).reshape(-1)
    return flat.view(np.uint8) if flat.size else b""


def put_digest(dataset: h5py.Dataset, stored: NDArray[Any]) -> None:
    """Note the digest of a dataset whose values are at hand."""
    put_attribute(dataset, "sha256", digest(stored))


def put_block_digests(dataset: h5py.Dataset, block: tuple[int, ...], found: NDArray[np.uint8] | None = None) -> None:
    """Note a digest for each block of a dataset, read back for that unless the digests are given.

    Parameters
    ----------
    dataset : h5py.Dataset
        The dataset, written.
    block : tuple of int
        Extent of a block along each axis.
    found : ndarray, shape (blocks along each axis, 32), optional
        The digests, if they are known.
    """
    counts = _counts(dataset.shape, block)
    if found is None:
        found = np.zeros((*counts, LENGTH), np.uint8)
        for at, cut in _blocks(dataset.shape, block):
            found[at] = np.frombuffer(bytes.fromhex(digest(dataset[cut])), np.uint8)
    stored = dataset.file.create_dataset(f"{DIGESTS}{dataset.name}", data=found)
    stored.attrs["block"] = np.array(block, dtype=np.int64)
    put_digest(stored, found)


def _counts(shape: tuple[int, ...], block: tuple[int, ...]) -> tuple[int, ...]:
    """Return the number of blocks along each axis."""
    return tuple(-(-n // b) for n, b in zip(shape, block, strict=True))


def _blocks(shape: tuple[int, ...], block: tuple[int, ...], index: Block | None = None) -> Iterator[tuple[Any, Block]]:
    """Yield place and slices of each block, of those only that `index` cuts if it is given."""
    ranges = []
    for axis, (n, b) in enumerate(zip(shape, block, strict=True)):
        first, last = 0, n
        if index is not None and axis < len(index):
            first, last, _ = index[axis].indices(n)
        ranges.append(range(first // b, -(-last // b) if last > first else first // b))
    for at in product(*ranges):
        yield at, tuple(slice(k * b, min((k + 1) * b, n)) for k, b, n in zip(at, block, shape, strict=True))


def has_block_digests(dataset: h5py.Dataset) -> bool:
    """Return whether a dataset has digests of its blocks."""
    return f"{DIGESTS}{dataset.name}" in dataset.file


def put_missing_digests(file: h5py.File) -> None:
    """Give a digest to every dataset that has none yet, and one to the whole of names, attributes and digests."""
    found: list[h5py.Dataset] = []
    file.visititems(lambda _, item: found.append(item) if isinstance(item, h5py.Dataset) else None)
    for dataset in found:
        if "sha256" in dataset.attrs or dataset.name.startswith(f"/{DIGESTS}/") or has_block_digests(dataset):
            continue
        if dataset.nbytes <= WHOLE_BYTES or dataset.ndim == 0:
            put_digest(dataset, np.asarray(dataset[()]))
        else:
            rows = max(1, WHOLE_BYTES // max(1, dataset.nbytes // dataset.shape[0]))
            put_block_digests(dataset, dataset.chunks or (rows, *dataset.shape[1:]))
    if "ppmc" in file:
        put_attribute(file["ppmc"], MANIFEST, manifest(file))


def manifest(file: h5py.File) -> str:
    """Return a digest of all names, shapes, types and attributes of a file, the digests of its data among them."""
    lines: list[str] = []

    def add(name: str, item: Any) -> None:
        kind = f"{item.shape} {item.dtype}" if isinstance(item, h5py.Dataset) else "group"
        lines.append(f"{name} {kind}")
        for key in sorted(item.attrs):
            if (name, key) != ("ppmc", MANIFEST):
                value = np.asarray(item.attrs[key])
                lines.append(f"{name}@{key} {value.dtype} {value.shape} {value.tobytes().hex()}")

    file.visititems(add)
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


class BlockCheck:
    """The comparison of a dataset with its digests, each block once.

    Parameters
    ----------
    dataset : h5py.Dataset
        Data that `ppmc.files.guard.dataset_of` has let through.
    digests : ndarray or None
        Its digests, None if the file has none.
    block : tuple of int
        Extent of a block.
    """

    def __init__(self, dataset: h5py.Dataset, digests: NDArray[np.uint8] | None, block: tuple[int, ...]) -> None:
        self.dataset = dataset
        self.block = block
        self._digests = digests
        self._seen: set[Any] = set()

    def first_unlike(self, index: Block) -> Block | None:
        """Return the first block under `index` that is not what was written, None if all are."""
        if self._digests is None:
            return None
        for at, cut in _blocks(self.dataset.shape, self.block, index):
            if at in self._seen:
                continue
            if digest(self.dataset[cut]) != self._digests[at].tobytes().hex():
                return cut
            self._seen.add(at)
        return None


def whole_digest(dataset: h5py.Dataset) -> str:
    """Return the noted digest of a whole dataset, empty if there is none."""
    return attribute(dataset, "sha256")
