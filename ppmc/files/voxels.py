"""Voxel products: CT volumes and voxel orientations, written whole or slab by slab, read in parts."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.files import vtkhdf
from ppmc.files.digests import LENGTH, BlockCheck, put_block_digests
from ppmc.files.fields import FIELDS, field
from ppmc.files.grid import VoxelGrid
from ppmc.files.guard import (
    block_check,
    check_layout,
    check_orthogonal,
    check_unchanged,
    check_values,
    compare_block,
    dataset_of,
    group_of,
    open_guarded,
)
from ppmc.files.hdf5_output import new_hdf5
from ppmc.files.provenance import Provenance
from ppmc.files.text import attribute, numbers

if TYPE_CHECKING:
    from ppmc.files.chunks import Chunk

CHUNK = (32, 64, 64)
VERIFIED_WHOLE = 2**24  # voxels; larger files are verified where they are read, and whole by `ppmc check`
SLAB = 2**22
Index = tuple[slice, slice, slice]
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
Packed = dict[str, "list[Chunk]"]
ALL: Index = (slice(None), slice(None), slice(None))


def chunks_of(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the extent of the chunks of a voxel product: axes cut into equal parts, so that hardly any is empty."""
    z, y, x = (-(-n // -(-n // m)) for n, m in zip(shape, CHUNK, strict=True))
    return z, y, x


class VoxelWriter:
    """Write a voxel product slab by slab; the file takes its name when the ``with`` block ends well.

    Parameters
    ----------
    path : Path
        The file to make.
    product : str
        ``"volume"`` or ``"orientations"``.
    names : iterable of str
        Fields that will be written.
    grid : VoxelGrid
        Where the voxels stand.
    provenance : Provenance
        Origin of the file.
    grey_dtype : dtype
        Type of ``grey``, if that is among the fields: uint8, uint16 or float32.
    compact : bool
        Round values to what they are worth and compress them (see :mod:`ppmc.files.chunks`).
    """

    def __init__(
        self,
        path: Path,
        product: str,
        names: Iterable[str],
        *,
        grid: VoxelGrid,
        provenance: Provenance,
        grey_dtype: Any = np.uint8,
        compact: bool = False,
    ) -> None:
        self.path = Path(path)
        self.product = product
        self.grid = grid
        self._specs = {name: field(product, name) for name in names}
        self._provenance = provenance
        self._grey = np.dtype(grey_dtype)
        self._compact = compact
        self._stack = ExitStack()
        self.chunk = chunks_of(grid.shape)
        self._digests: dict[str, NDArray[np.uint8]] = {}
        self._loose: set[str] = set()

    def __enter__(self) -> VoxelWriter:
        with ExitStack() as stack:
            self._new = stack.enter_context(new_hdf5(self.path))
            self._file = self._new.file
            self._data = vtkhdf.image_header(vtkhdf.begin(self._file, "ImageData"), self.grid)
            filters = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
            for name, spec in self._specs.items():
                tail = () if spec.components == 1 else (spec.components,)
                dataset = self._data.create_dataset(
                    name,
                    shape=(*self.grid.shape, *tail),
                    dtype=vtkhdf.stored_dtype(spec, self._grey),
                    chunks=(*self.chunk, *tail),
                    **(filters if self._compact else {}),
                )
                vtkhdf.describe(dataset, spec, self._provenance.creator)
            self._provenance.store(self._file, self.product)
            self._stack = stack.pop_all()
        return self

    def write(self, name: str, z0: int, slab: NDArray[Any], y0: int = 0, x0: int = 0) -> None:
        """Write a block of a field, shape (kz, ky, kx[, components]), its first voxel at [z0, y0, x0]."""
        spec = self._specs[name]
        kz, ky, kx = slab.shape[:3]
        if self._compact:
            packed = self.packed({name: slab}, ((z0, z0 + kz), (y0, y0 + ky), (x0, x0 + kx)))
            if packed is not None:
                self.put(packed)
                return
            from ppmc.files.chunks import rounded

            slab = rounded(slab, spec)
        stored = vtkhdf.as_stored(slab, spec, slab.shape[:3])
        self._data[name][z0 : z0 + kz, y0 : y0 + ky, x0 : x0 + kx] = stored
        self._loose.add(name)
        self._new.check()

    def packed(self, fields: Mapping[str, NDArray[Any]], box: Box) -> Packed | None:
        """Return the chunks of fields in a box of voxels (z, y, x), ready for :meth:`put`; may be called on any thread.

        None where the box holds others than whole chunks: then :meth:`write` has to do.
        """
        from ppmc.files.chunks import made

        ranges = []
        for (a, b), n, c in zip(box, self.grid.shape, self.chunk, strict=True):
            if a % c or (b % c and b != n):
                return None
            ranges.append(range(a // c, -(-b // c)))
        out: Packed = {}
        for name, values in fields.items():
            spec = self._specs[name]
            whole = self.chunk if spec.components == 1 else (*self.chunk, spec.components)
            values = vtkhdf.as_stored(values, spec, values.shape[:3])
            out[name] = []
            for at in itertools.product(*ranges):
                cut = tuple(slice(k * c - a, (k + 1) * c - a) for k, c, (a, _) in zip(at, self.chunk, box, strict=True))
                out[name].append(made(values[cut], spec, at, whole))
        return out

    def put(self, packed: Packed) -> None:
        """Write chunks as they are."""
        for name, chunks in packed.items():
            data = self._data[name]
            if name not in self._digests:
                counts = [-(-n // c) for n, c in zip(data.shape, data.chunks, strict=True)]
                self._digests[name] = np.zeros((*counts, LENGTH), np.uint8)
            for chunk in chunks:
                place = [k * c for k, c in zip(chunk.at, self.chunk, strict=True)] + [0] * (data.ndim - 3)
                data.id.write_direct_chunk(tuple(place), chunk.stored)
                self._digests[name][chunk.at].reshape(-1)[:] = np.frombuffer(chunk.digest, np.uint8)
        self._new.check()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            try:
                for name, data in self._data.items():
                    known = None if name in self._loose else self._digests.get(name)
                    put_block_digests(data, data.chunks, known)
            except BaseException as failure:
                if not self._stack.__exit__(type(failure), failure, failure.__traceback__):
                    raise
                return
        self._stack.__exit__(kind, error, trace)


def write_voxels(
    path: Path, product: str, fields: Mapping[str, NDArray[Any]], *, grid: VoxelGrid, provenance: Provenance
) -> None:
    """Write a voxel product that fits into memory, with a digest of every field.

    Parameters
    ----------
    path : Path
        The file to make.
    product : str
        ``"volume"`` or ``"orientations"``.
    fields : mapping of str to ndarray, shape (nz, ny, nx[, components])
        The fields of the product's contract.
    grid : VoxelGrid
        Where the voxels stand.
    provenance : Provenance
        Origin of the file.

    Raises
    ------
    StorageError
        If the file cannot be written.
    """
    grey = np.asarray(fields["grey"]).dtype if "grey" in fields else np.uint8
    writer = VoxelWriter(path, product, fields, grid=grid, provenance=provenance, grey_dtype=grey)
    with writer:
        for name, values in fields.items():
            writer.write(name, 0, np.asarray(values))


@dataclass
class VoxelFile:
    """An open voxel product; fields are read, and verified, in parts.

    Attributes
    ----------
    path : Path
        The file.
    product : str
        Its contract.
    grid : VoxelGrid
        Where the voxels stand.
    names : tuple of str
        Fields it has.
    provenance : Provenance
        Its origin.
    """

    path: Path
    product: str
    grid: VoxelGrid
    names: tuple[str, ...]
    provenance: Provenance
    _file: h5py.File | None
    _checks: dict[str, BlockCheck] = dataclass_field(default_factory=dict)

    def read(self, name: str, index: Index = ALL) -> NDArray[Any]:
        """Return a field, or the part of it that `index` cuts out, verified against its contract.

        Raises
        ------
        InputFileError
            If the field is missing or breaks its contract.
        """
        data = dataset_of(self._file, f"VTKHDF/PointData/{name}", self.path)
        spec = field(self.product, name)
        values = data[index]
        check_values(values, spec, data.name, self.path)
        self._compare(name, index)
        return np.asarray(values)

    def _compare(self, name: str, index: Index) -> None:
        """Refuse a part whose blocks are not those that were written."""
        if name not in self._checks:
            self._checks[name] = block_check(self._file, f"VTKHDF/PointData/{name}", self.path)
        compare_block(self._checks[name], index, self.path)

    def read_points(self, name: str, index: Index, points: NDArray[np.integer[Any]]) -> NDArray[Any]:
        """Return a field at some voxels of a part, shape (n[, components]); only these are verified.

        Parameters
        ----------
        name : str
            The field.
        index : tuple of three slices
            The part that is read, (z, y, x).
        points : ndarray, shape (n, 3), int
            Voxels (z, y, x), counted from the part's first one.

        Raises
        ------
        InputFileError
            If the field is missing, or one of the values breaks its contract.
        """
        data = dataset_of(self._file, f"VTKHDF/PointData/{name}", self.path)
        values = data[index][tuple(np.asarray(points).T)]
        check_values(values, field(self.product, name), data.name, self.path)
        self._compare(name, index)
        return np.asarray(values)

    def verify(self) -> None:
        """Read all fields slab by slab, and verify every value, and that p and r are orthogonal.

        Raises
        ------
        InputFileError
            If a field breaks its contract.
        """
        planes = max(1, SLAB * self.grid.shape[0] // self.grid.count)
        for z in range(0, self.grid.shape[0], planes):
            slab = (slice(z, z + planes), slice(None), slice(None))
            for name in self.names:
                self.read(name, slab)
            if self.product == "orientations":
                self.read_frames(slab)

    def read_frames(self, index: Index = ALL) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return fibre directions and platelet normals, shape (..., 3), verified to be orthogonal."""
        p = self.read("fibre_direction", index)
        r = self.read("platelet_normal", index)
        check_orthogonal(p, r, ("/VTKHDF/PointData/fibre_direction", "platelet_normal"), self.path)
        return p, r


class MemoryVoxels(VoxelFile):
    """A voxel product in memory, which reads like its file.

    Parameters
    ----------
    product : str
        ``"volume"`` or ``"orientations"``.
    fields : mapping of str to ndarray, shape (nz, ny, nx[, components])
        The fields of the product's contract.
    grid : VoxelGrid
        Where the voxels stand.
    provenance : Provenance
        Origin of the product.
    """

    def __init__(
        self, product: str, fields: Mapping[str, NDArray[Any]], *, grid: VoxelGrid, provenance: Provenance
    ) -> None:
        names = tuple(spec.name for spec in FIELDS[product] if spec.name in fields)
        super().__init__(Path(f"{product} in memory"), product, grid, names, provenance, None)
        self.fields = dict(fields)

    def read(self, name: str, index: Index = ALL) -> NDArray[Any]:
        """Return a field, or the part of it that `index` cuts out; a copy, as from a file."""
        return np.array(self.fields[self._known(name)][index])

    def read_points(self, name: str, index: Index, points: NDArray[np.integer[Any]]) -> NDArray[Any]:
        """Return a field at some voxels of a part, see `VoxelFile.read_points`."""
        return np.asarray(self.fields[self._known(name)][index][tuple(np.asarray(points).T)])

    def _known(self, name: str) -> str:
        if name not in self.fields:
            raise InputFileError(f"{self.path}: has no field '{name}'; it has {', '.join(self.names)}")
        return name


@contextmanager
def read_voxels(path: Path, product: str, *, verify: bool = True) -> Iterator[VoxelFile]:
    """Open a voxel product.

    Parameters
    ----------
    path : Path
        The file.
    product : str
        ``"volume"`` or ``"orientations"``.
    verify : bool
        Verify all of a file of up to 2^24 voxels at once; without it each part when it is read.

    Yields
    ------
    VoxelFile

    Raises
    ------
    InputFileError
        If the file or its layout breaks the contract, or a value does in a file of up to 2^24 voxels.
    """
    path = Path(path)
    with open_guarded(path, product) as file:
        root = group_of(file, "VTKHDF", path)
        grid = _grid_of(root, path)
        data = group_of(file, "VTKHDF/PointData", path)
        known = {f.name: f for f in FIELDS[product]}
        for name, spec in known.items():
            if name in data:
                check_layout(dataset_of(file, f"VTKHDF/PointData/{name}", path), spec, grid.shape, path)
            elif spec.required:
                raise InputFileError(f"{path}: /VTKHDF/PointData/{name} is missing ({spec.doc})")
        names = tuple(name for name in known if name in data)
        opened = VoxelFile(path, product, grid, names, Provenance("unknown"), file)
        if verify and grid.count <= VERIFIED_WHOLE:
            opened.verify()
        check_unchanged(file, path)
        opened.provenance = Provenance.load(file)
        yield opened


def _grid_of(root: h5py.Group, path: Path) -> VoxelGrid:
    """Return the grid that the header describes."""
    try:
        kind = attribute(root, "Type")
        if kind != "ImageData":
            raise InputFileError(f"{path}: /VTKHDF@Type is '{kind}', must be 'ImageData'")
        x0, x1, y0, y1, z0, z1 = (int(v) for v in numbers(root, "WholeExtent", 6))
        spacing = tuple(float(v) for v in numbers(root, "Spacing", 3))
        origin = tuple(float(v) for v in numbers(root, "Origin", 3))
        direction = numbers(root, "Direction", 9).reshape(3, 3) if "Direction" in root.attrs else np.eye(3)
        return VoxelGrid((z1 - z0 + 1, y1 - y0 + 1, x1 - x0 + 1), spacing, origin, tuple(map(tuple, direction)))  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError) as error:
        raise InputFileError(f"{path}: /VTKHDF does not describe a voxel grid: {error}") from None
