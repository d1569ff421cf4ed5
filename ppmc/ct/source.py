"""Grey-value volumes of any common kind, read in blocks.

Raw files, TIFF (one file of many pages or a folder of slices), HDF5, Zarr and ppmc's own volume files all become a
:class:`Volume`: shape, number type, voxel size if the file knows it, and a function that reads a box.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.tiff import TIFF, Box, tiff_file, tiff_folder
from ppmc.errors import InputFileError, SceneError
from ppmc.scene.ct import VolumeSource

HDF5 = {".h5", ".hdf5", ".hdf", ".nxs"}
RAW = {".raw", ".bin", ".dat", ".vol"}


@dataclass(frozen=True)
class Volume:
    """A volume that is read in boxes.

    Attributes
    ----------
    path : Path
        File or folder.
    shape : tuple of int
        Number of voxels (nz, ny, nx).
    dtype : numpy.dtype
        Number type.
    read : callable
        Returns the voxels of a box of slices (z, y, x).
    spacing : tuple of float or None
        Voxel size (x, y, z) in mm, if the file states it.
    origin, direction
        Place of the grid, if the file states it.
    read_mask : callable or None
        Returns the file's own mask.
    """

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    read: Callable[[Box], NDArray[Any]]
    spacing: tuple[float, float, float] | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    read_mask: Callable[[Box], NDArray[Any]] | None = None

    def grey(self, box: Box, middle: float = 0.0, unit: float = 1.0) -> NDArray[np.float32]:
        """Return ``(grey - middle) / unit`` of a box as float32, never the file's own memory.

        Raises
        ------
        InputFileError
            If a value is NaN or infinite, naming the voxel.
        """
        values = self.read(box)
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                where = np.argwhere(~finite)[0] + [s.start for s in box]
                raise InputFileError(
                    f"{self.path}: voxel [z, y, x] = {[int(i) for i in where]} is not a finite number; "
                    "replace such voxels (for example by the mean) or mask them and fill with zero"
                )
        # Numbers that float32 does not hold exactly lose their offset first.
        exact = values.dtype.itemsize <= 2 or values.dtype == np.float32
        out: NDArray[Any] = values.astype(np.float32 if exact else np.float64, order="C")
        np.subtract(out, out.dtype.type(middle), out=out)
        np.multiply(out, out.dtype.type(1.0 / unit), out=out)
        return out.astype(np.float32, copy=False)


@contextmanager
def open_volume(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a volume.

    Parameters
    ----------
    path : Path
        File or folder of slices; the ending tells the kind.
    source : VolumeSource
        What the scene says about files that do not describe themselves.

    Raises
    ------
    InputFileError
        If the file is missing, damaged, or does not have the shape it should.
    SceneError
        If the scene lacks what a raw file needs.
    """
    path = Path(path)
    if not path.exists():
        raise InputFileError(f"{path}: no such file or folder; give the CT volume with --input or ct: source: path:")
    ending = path.suffix.lower()
    with ExitStack() as stack:
        if ending == ".zarr" or (path / ".zarray").exists() or (path / "zarr.json").exists():
            volume = _zarr(path, source.dataset)
        elif path.is_dir():
            volume = Volume(path, *tiff_folder(path))
        elif ending == ".vtkhdf":
            volume = stack.enter_context(_own(path))
        elif ending in HDF5:
            volume = stack.enter_context(_hdf5(path, source.dataset))
        elif ending in TIFF:
            volume = Volume(path, *stack.enter_context(tiff_file(path)))
        elif ending in RAW or source.shape is not None:
            volume = _raw(path, source)
        else:
            raise InputFileError(
                f"{path}: unknown kind of file '{ending}'; known are .vtkhdf, .h5, .hdf5, .tif, a folder of .tif, "
                ".zarr, and raw files with ct: source: shape: and dtype:"
            )
        if volume.dtype.kind not in "uif":
            raise InputFileError(f"{path}: holds {volume.dtype}; grey values must be integer or floating-point numbers")
        if min(volume.shape) < 1:
            raise InputFileError(f"{path}: has shape {volume.shape}; there are no voxels in it")
        yield volume


def _raw(path: Path, source: VolumeSource) -> Volume:
    if source.shape is None or source.dtype is None:
        raise SceneError(
            f"{path}: a raw file needs ct: source: shape: [nz, ny, nx] and dtype: in the scene; "
            f"given are shape {source.shape} and dtype {source.dtype}"
        )
    dtype = np.dtype(source.dtype).newbyteorder("<" if source.byte_order == "little" else ">")
    need = int(np.prod(source.shape, dtype=np.int64)) * dtype.itemsize + source.header_bytes
    have = path.stat().st_size
    if need != have:
        raise InputFileError(
            f"{path}: has {have:,} bytes, but shape {list(source.shape)} of {source.dtype} with "
            f"{source.header_bytes} header bytes needs {need:,}; correct ct: source:"
        )
    data = np.memmap(path, dtype, "r", source.header_bytes, source.shape)
    return Volume(path, source.shape, dtype, lambda box: np.asarray(data[box]))


@contextmanager
def _own(path: Path) -> Iterator[Volume]:
    from ppmc.files import read_voxels

    with read_voxels(path, "volume") as file:
        dtype = np.asarray(file.read("grey", (slice(0, 1), slice(0, 1), slice(0, 1)))).dtype
        grid = file.grid
        yield Volume(
            path, grid.shape, dtype, lambda box: file.read("grey", box), grid.spacing, grid.origin, grid.direction,
            (lambda box: file.read("mask", box)) if "mask" in file.names else None,
        )  # fmt: skip


@contextmanager
def _hdf5(path: Path, name: str | None) -> Iterator[Volume]:
    from ppmc.files.guard import dataset_of, open_guarded

    with open_guarded(path, "volume") as file:
        data = dataset_of(file, name or _only_volume(file, path), path)
        if data.ndim != 3:
            raise InputFileError(f"{path}: {data.name} has shape {data.shape}; a volume has three dimensions (z, y, x)")
        yield Volume(path, data.shape, data.dtype, lambda box: np.asarray(data[box]))


def _zarr(path: Path, name: str | None) -> Volume:
    try:
        import zarr
    except ImportError:
        raise InputFileError(f"{path}: reading Zarr needs the package zarr: pip install zarr") from None
    try:
        data = zarr.open(str(path), mode="r")
        data = data[name] if name is not None else data
        shape, dtype = tuple(data.shape), np.dtype(data.dtype)
    except Exception as error:  # stores and codecs raise whatever they meet
        raise InputFileError(f"{path}: cannot be read as a Zarr array ({error}); name it with dataset:") from None
    if len(shape) != 3:
        raise InputFileError(f"{path}: has shape {shape}; a volume has three dimensions (z, y, x)")
    return Volume(path, shape, dtype, lambda box: np.asarray(data[box]))


def _only_volume(file: Any, path: Path) -> str:
    """Return the name of the only three-dimensional dataset."""
    import h5py

    found: list[str] = []
    file.visititems(
        lambda name, item: found.append(name) if isinstance(item, h5py.Dataset) and item.ndim == 3 else None
    )
    if len(found) != 1:
        listing = ", ".join(found) or "none"
        raise InputFileError(
            f"{path}: name the volume with ct: source: dataset:; three-dimensional datasets: {listing}"
        )
    return found[0]
