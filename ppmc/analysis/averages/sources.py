"""Any product as a source of samples: open files in, `Particles` out, in parts that fit memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ppmc.analysis.averages.averages import RegionAverages, RegionSums, region_sums
from ppmc.analysis.averages.moments import N_SUMS
from ppmc.analysis.averages.regions import Region
from ppmc.errors import InputFileError
from ppmc.files import ParticleFile, SeriesFile, VoxelFile, VoxelGrid
from ppmc.particles import Particles, charge_particles, flow_particles, join

VOXELS_A_SLAB = 4_000_000


@dataclass(frozen=True)
class Source:
    """Something to average over.

    Attributes
    ----------
    label : str
        Name in tables and legends.
    product : str
        Contract of the file it comes from.
    time : float or None
        s; None for products without time.
    count : int
        Points with a meaning (valid voxels, particles).
    lower, upper : ndarray, shape (3,)
        Bounds of the points with half a spacing around, mm; NaN when there is no point.
    spacing : float
        Typical distance of neighbours, mm.
    parts : callable
        Yields the samples in disjoint parts.
    """

    label: str
    product: str
    time: float | None
    count: int
    lower: np.ndarray
    upper: np.ndarray
    spacing: float
    parts: Callable[[], Iterator[Particles]]

    @property
    def title(self) -> str:
        """Label with the time."""
        return self.label if self.time is None else f"{self.label}, t = {self.time:.4g} s"

    def averages(self, regions: list[Region] | tuple[Region, ...]) -> RegionAverages:
        """Average over regions, part by part."""
        total = RegionSums(tuple(regions), np.zeros((len(regions), N_SUMS)))
        for part in self.parts():
            total = total + region_sums(part, regions)
        return total.averages()

    def thinned(self, most: int, seed: int = 0) -> Particles:
        """Return at most about `most` points, drawn evenly at random, for pictures."""
        share = 1.0 if self.count <= most else most / self.count
        rng = np.random.default_rng([seed, 7])
        kept = []
        for part in self.parts():
            chosen = part if share >= 1.0 else part.select(np.flatnonzero(rng.random(len(part)) < share))
            kept.append(chosen)
        if not kept:
            return Particles(self.label, np.empty((0, 3)), np.empty(0), time=self.time)
        return replace(join(kept, self.label), time=self.time)

    def where(self, keep: Callable[[Particles], np.ndarray]) -> Source:
        """Return the source cut to the points for which `keep` gives True."""

        def parts() -> Iterator[Particles]:
            for part in self.parts():
                yield part.select(keep(part))

        return replace(self, parts=parts)


def flow_source(file: SeriesFile, frame: int, label: str = "flow") -> Source:
    """Return one frame of a flow history; the weight is the volume at the start, which the material carries along."""
    samples = flow_particles(file, frame, label)
    # Half the width of the deformed particle along each axis: a squeezed block ends there, not half a spacing on.
    F = samples.fields.get("deformation_gradient")
    stretch = np.ones(3) if F is None else np.sqrt((F.reshape(-1, 3, 3) ** 2).sum(axis=2)).mean(axis=0)
    return _in_memory(samples, "flow", stretch)


def charge_source(file: ParticleFile, label: str = "charge") -> Source:
    """Return a charge."""
    return _in_memory(charge_particles(file, label), "charge")


def orientations_source(file: VoxelFile, label: str = "CT") -> Source:
    """Return the valid voxels of an orientation field; every voxel weighs its own volume."""
    return _voxel_source(file, label, lambda index: file.read("valid", index) > 0)


def truth_source(file: VoxelFile, label: str = "phantom truth") -> Source:
    """Return the platelet voxels of a phantom volume.

    Raises
    ------
    InputFileError
        If the volume carries no true directions.
    """
    if not {"fibre_direction", "platelet_normal"} <= set(file.names):
        raise InputFileError(
            f"{file.path}: has no true fibre_direction and platelet_normal; only phantom volumes do (ppmc phantom)"
        )

    def known(index: tuple[slice, slice, slice]) -> np.ndarray:
        return np.asarray((file.read("fibre_direction", index) != 0).any(axis=-1))

    return _voxel_source(file, label, known)


def mask_source(file: VoxelFile, label: str) -> Source:
    """Return the voxels that a volume's mask marks, without directions.

    Raises
    ------
    InputFileError
        If the volume carries no mask.
    """
    if "mask" not in file.names:
        raise InputFileError(f"{file.path}: has no field 'mask' to compare the flow front with")
    return _voxel_source(file, label, lambda index: file.read("mask", index) > 0, directions=False)


def grid_box(grid: VoxelGrid, low: np.ndarray, high: np.ndarray, name: str, margin: float = 0.0) -> Region | None:
    """Return the box of voxels `low` to `high` (x, y, z; included), shrunk by `margin` mm; None if nothing is left."""
    spacing = np.asarray(grid.spacing)
    lower = (np.asarray(low) - 0.5) * spacing + margin
    upper = (np.asarray(high) + 0.5) * spacing - margin
    if not (upper > lower).all():
        return None
    return Region(name, "box", np.asarray(grid.origin, dtype=float), grid.rotation.T, lower, upper)


def slabs(file: VoxelFile) -> Iterator[tuple[slice, slice, slice]]:
    """Yield index triples that cut the file into slabs of bounded size."""
    nz, ny, nx = file.grid.shape
    depth = max(1, VOXELS_A_SLAB // (ny * nx))
    for z in range(0, nz, depth):
        yield slice(z, min(z + depth, nz)), slice(0, ny), slice(0, nx)


def occupied_indices(
    file: VoxelFile, known: Callable[[tuple[slice, slice, slice]], np.ndarray]
) -> tuple[int, np.ndarray, np.ndarray]:
    """Return how many voxels are known, and the lowest and highest index (x, y, z) among them."""
    count = 0
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for index in slabs(file):
        mask = known(index)
        count += int(mask.sum())
        for axis in range(3):
            # Axes of the array are z, y, x.
            others = tuple(a for a in range(3) if a != 2 - axis)
            hit = np.flatnonzero(mask.any(axis=others))
            if len(hit):
                start = index[2 - axis].start
                low[axis] = min(low[axis], start + hit[0])
                high[axis] = max(high[axis], start + hit[-1])
    return count, low, high


def voxel_positions(grid: VoxelGrid, index: tuple[slice, slice, slice], mask: np.ndarray) -> np.ndarray:
    """Return tool coordinates (n, 3) of the voxels of a slab where `mask` holds."""
    z, y, x = np.nonzero(mask)
    return np.asarray(grid.to_world(np.column_stack([x + index[2].start, y + index[1].start, z + index[0].start])))


def _voxel_source(
    file: VoxelFile,
    label: str,
    known: Callable[[tuple[slice, slice, slice]], np.ndarray],
    directions: bool = True,
) -> Source:
    count, low, high = occupied_indices(file, known)
    volume = float(np.prod(file.grid.spacing))
    lower = upper = np.full(3, np.nan)
    if count:
        corners = np.array(
            [[(low, high)[b][a] + (b - 0.5) for a, b in enumerate(bits)] for bits in np.ndindex(2, 2, 2)]
        )
        world = file.grid.to_world(corners)
        lower, upper = world.min(axis=0), world.max(axis=0)

    def parts() -> Iterator[Particles]:
        for index in slabs(file):
            mask = known(index)
            n = int(mask.sum())
            if n and not directions:
                yield Particles(label, voxel_positions(file.grid, index, mask), np.full(n, volume))
            elif n:
                p = file.read("fibre_direction", index)[mask].astype(float)
                r = file.read("platelet_normal", index)[mask].astype(float)
                yield Particles(label, voxel_positions(file.grid, index, mask), np.full(n, volume), p, r)

    return Source(label, file.product, None, count, lower, upper, float(np.cbrt(volume)), parts)


def _in_memory(samples: Particles, product: str, stretch: np.ndarray | None = None) -> Source:
    """Return samples as a source; their bounds reach half a (stretched) spacing beyond the points."""
    lower, upper = samples.bounds
    half = 0.5 * samples.spacing * (np.ones(3) if stretch is None else stretch)

    def parts() -> Iterator[Particles]:
        yield samples

    low, high = lower - half, upper + half
    return Source(samples.label, product, samples.time, len(samples), low, high, samples.spacing, parts)
