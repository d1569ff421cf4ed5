"""Voxel products: the grey volume that a phantom makes, and the orientations that the CT stage finds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ppmc.errors import InputFileError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import pyvista as pv
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from ppmc.files import MemoryVoxels, Provenance, VoxelFile, VoxelGrid
    from ppmc.files.voxels import Index
    from ppmc.particles import Particles


class Voxels:
    """A volume or orientations, in memory or in a file of which parts are read when they are asked for.

    Arrays are indexed [z, y, x]; vectors are (x1, x2, x3) in tool coordinates. ``voxels["confidence"]`` is a field.

    Attributes
    ----------
    product : str
        ``"volume"`` or ``"orientations"``.
    grid : VoxelGrid
        Shape, spacing (mm), origin and direction.
    names : tuple of str
        Fields that it has.
    provenance : Provenance
        Where it comes from.
    path : Path or None
        Its file, None if it is in memory.
    """

    product: str
    grid: VoxelGrid
    names: tuple[str, ...]
    provenance: Provenance
    path: Path | None

    def __init__(self, voxels: VoxelFile, path: Path | None = None) -> None:
        self.product, self.grid, self.names = voxels.product, voxels.grid, voxels.names
        self.provenance = voxels.provenance
        self.path = path
        self._kept = None if path is not None else voxels

    @classmethod
    def read(cls, path: str | Path) -> Voxels:
        """Read a volume or an orientations file.

        Raises
        ------
        InputFileError
            If the file is missing, damaged or no voxels.
        """
        from ppmc.files import product_of, read_voxels

        path = Path(path)
        product = product_of(path)
        if product not in ("volume", "orientations"):
            raise InputFileError(f"{path}: holds '{product}', no voxels; ppmc.read takes every product")
        with read_voxels(path, product) as voxels:
            return cls(voxels, path)

    @classmethod
    def in_memory(cls, voxels: MemoryVoxels) -> Voxels:
        """Take voxels that are in memory."""
        return cls(voxels)

    @contextmanager
    def opened(self) -> Iterator[VoxelFile]:
        """Open the file for the length of a block; each part that is read is verified."""
        from ppmc.files import read_voxels

        if self._kept is not None:
            yield self._kept
            return
        assert self.path is not None
        with read_voxels(self.path, self.product, verify=False) as voxels:
            if voxels.provenance.key != self.provenance.key or voxels.grid != self.grid:
                raise InputFileError(f"{self.path}: is not the file any more that was read; read it again")
            yield voxels

    def array(self, name: str, index: Index | None = None) -> np.ndarray:
        """Return a field, shape (nz, ny, nx[, components]), or the part that three slices (z, y, x) cut out.

        Raises
        ------
        InputFileError
            If there is no such field, or it is damaged.
        """
        from ppmc.files.voxels import ALL

        if name not in self.names:
            where = self.path or f"{self.product} in memory"
            raise InputFileError(f"{where}: has no field '{name}'; it has {', '.join(self.names)}")
        with self.opened() as voxels:
            return voxels.read(name, ALL if index is None else index)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a field whole."""
        return self.array(name)

    def __repr__(self) -> str:
        """Return the voxels in one line."""
        nz, ny, nx = self.grid.shape
        return f"Voxels({self.product}, {nx} x {ny} x {nz}, {', '.join(self.names)})"

    @property
    def particles(self) -> Particles:
        """Voxels with known directions as points, each with its volume (mm^3).

        Raises
        ------
        InputFileError
            If there are no directions: only volumes of phantoms have true ones.
        """
        from ppmc.analysis.averages.sources import orientations_source, truth_source
        from ppmc.particles import join

        with self.opened() as voxels:
            source = orientations_source(voxels) if self.product == "orientations" else truth_source(voxels)
            return join(list(source.parts()), source.label)

    @property
    def A(self) -> np.ndarray:  # noqa: N802
        """Fibre orientation tensor ``<p p>`` of all voxels with known directions, shape (3, 3) (J, section II.A)."""
        return self.particles.A

    @property
    def N(self) -> np.ndarray:  # noqa: N802
        """Normal orientation tensor ``<r r>`` of all voxels with known directions, shape (3, 3) (J, section II.A)."""
        return self.particles.N

    def to_pandas(self) -> pd.DataFrame:
        """Return a table with a row a voxel of known direction, see :meth:`ppmc.particles.Particles.to_pandas`."""
        return self.particles.to_pandas()

    def to_pyvista(self) -> pv.ImageData:
        """Return the voxels as a PyVista image with all fields as point data, mm."""
        import pyvista as pv

        grid = self.grid
        image = pv.ImageData(dimensions=grid.shape[::-1], spacing=grid.spacing, origin=grid.origin)
        image.direction_matrix = grid.rotation
        for name in self.names:
            values = self.array(name)
            image.point_data[name] = values.reshape(grid.count, *values.shape[3:])
        return image

    def plot(
        self, name: str = "fibre_direction", *, cut: tuple[ArrayLike, ArrayLike] | None = None,
        save: str | Path | None = None,
    ) -> Figure:  # fmt: skip
        """Draw a view off screen, see :meth:`ppmc.Flow.plot`."""
        from ppmc.api.plot import plot

        return plot(self.particles, name, cut, save)

    def write(self, output: str | Path, *, force: bool = False) -> Path:
        """Write the file that the stage writes.

        Raises
        ------
        StorageError
            If it cannot be written.
        """
        from ppmc.files import check_output, is_product, write_voxels
        from ppmc.files.lock import Claim, locked

        output = Path(output)
        with locked([Claim(output)]):
            check_output(output, [self.path], is_own=is_product(self.product), force=force)
            fields = {name: self.array(name) for name in self.names}
            write_voxels(output, self.product, fields, grid=self.grid, provenance=self.provenance)
        return output

    def digest(self) -> str:
        """Return a digest of all fields, for those that no file holds."""
        import hashlib

        from ppmc.files.digests import digest

        parts: list[Any] = [self.grid, *(f"{name} {digest(self.array(name))}" for name in self.names)]
        return hashlib.sha256("\n".join(map(str, parts)).encode()).hexdigest()
