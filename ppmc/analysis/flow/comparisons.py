"""The input's flow beside other material: another run, the measured part, a mask of the flow front (D Figs 6 and 7)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ppmc.analysis.averages.sources import Source, flow_source, mask_source, orientations_source
from ppmc.analysis.flow.ensemble import RunDifference, particle_difference
from ppmc.analysis.flow.occupancy import CELL_IN_SPACINGS, Cells, cells_around, occupancy, overlap, silhouette
from ppmc.errors import InputFileError
from ppmc.files import SeriesFile, VoxelFile, read_voxels
from ppmc.orientation import angle_between_axes

if TYPE_CHECKING:
    from ppmc.scene.sections.analysis import FrontMask

# Axes of a view along x1, x2, x3: to the right, and up.
PLANES = ((1, 2), (0, 2), (0, 1))
GREYS = 255.0
GREYS_OF_16_BITS = 65535.0


@dataclass(frozen=True)
class FrontView:
    """Two states seen along one axis.

    Attributes
    ----------
    axis : int
        Along which one looks, 0, 1 or 2.
    input, other : ndarray, shape (a, b)
        How far each covers a place, 0 to 1; the first index runs to the right, the second up.
    extent : tuple of 4 float
        left, right, lower, upper, mm.
    """

    axis: int
    input: NDArray[np.float64]
    other: NDArray[np.float64]
    extent: tuple[float, float, float, float]


@dataclass(frozen=True)
class Comparison:
    """One frame of the input's flow beside something else.

    Attributes
    ----------
    label : str
        The other.
    time : float
        Of the input's frame, s.
    particle_count : int
        Of that frame.
    difference : RunDifference
        Overlap of the filled space, and what pairs of particles tell; NaN where there is nothing to tell.
    seen : tuple of 3 float
        Overlap as seen along x1, x2, x3; NaN where the other is not known in that view.
    view : FrontView
    same_particles : bool
        Whether both move the same particles, so that they can be compared one by one.
    distance, angle : ndarray, shape (n,), or None
        Of each particle to itself in the other run, mm, and between its fibre directions, degrees.
    """

    label: str
    time: float
    particle_count: int
    difference: RunDifference
    seen: tuple[float, float, float]
    view: FrontView
    same_particles: bool = False
    distance: NDArray[np.float64] | None = None
    angle: NDArray[np.float64] | None = None


def compare_runs(flow: SeriesFile, label: str, other: SeriesFile, axis: int) -> Comparison:
    """Compare the last frames of two runs: the space they fill, and particle by particle if they are the same."""
    a, b = (next(flow_source(file, -1).parts()) for file in (flow, other))
    cells = _cells([a.positions, b.positions], max(a.spacing, b.spacing))
    both = occupancy([a], cells), occupancy([b], cells)
    shared, seen, view = _overlaps(*both, cells, axis)
    same = len(a) == len(b) and np.allclose(a.fields["reference_position"], b.fields["reference_position"], atol=1e-6)
    p, q = a.fibre_direction, b.fibre_direction
    time = float(flow.times[-1])
    if not same or p is None or q is None:
        return Comparison(label, time, len(a), _unpaired(shared), seen, view)
    distance = np.linalg.norm(a.positions - b.positions, axis=1)
    difference = particle_difference((a.positions, b.positions), (p, q), shared)
    angle = np.asarray(angle_between_axes(p, q), dtype=np.float64)
    return Comparison(label, time, len(a), difference, seen, view, True, distance, angle)


def compare_with_part(flow: SeriesFile, part: VoxelFile, label: str, axis: int) -> Comparison:
    """Compare the space that the last frame fills with the measured part; there are no particles to pair."""
    return _with_voxels(flow, -1, orientations_source(part, label), part, label, axis)


def compare_with_mask(flow: SeriesFile, path: Path, section: FrontMask, axis: int) -> Comparison:
    """Compare the front with a mask: the field ``mask`` of a volume, or a picture of the part seen along an axis.

    Parameters
    ----------
    flow : SeriesFile
    path : Path
        Volume file, or a picture (PNG, TIFF, ...).
    section : FrontMask
        Time, and for a picture its place.
    axis : int
        Along which a picture was taken.

    Raises
    ------
    InputFileError
        If the file cannot be read or marks nothing.
    """
    frame = -1 if section.time is None else int(np.argmin(np.abs(flow.times - section.time)))
    label = f"mask {path.stem}"
    if path.suffix == ".vtkhdf":
        with read_voxels(path, "volume") as volume:
            source = mask_source(volume, label)
            if not source.count:
                raise InputFileError(f"{path}: the field 'mask' marks no voxel")
            return _with_voxels(flow, frame, source, volume, label, axis)
    marked = read_picture(path, section.material)
    samples = next(flow_source(flow, frame).parts())
    right, up = PLANES[axis]
    corners = np.full((2, 3), samples.positions.mean(axis=0))
    corners[0, [right, up]] = section.origin
    corners[1, [right, up]] = np.array(section.origin) + np.array(marked.shape) * section.pixel
    cells = cells_around((samples.positions, corners), samples.spacing, CELL_IN_SPACINGS * samples.spacing)
    seen_input = silhouette(occupancy([samples], cells), axis)
    at = [
        np.floor((cells.centres(a) - start) / section.pixel).astype(int)
        for a, start in zip((right, up), section.origin, strict=True)
    ]
    inside = [(k >= 0) & (k < n) for k, n in zip(at, marked.shape, strict=True)]
    other = np.zeros(seen_input.shape)
    other[np.ix_(*inside)] = marked[np.ix_(at[0][inside[0]], at[1][inside[1]])]
    seen = [np.nan, np.nan, np.nan]
    seen[axis] = overlap(seen_input, other)
    view = FrontView(axis, seen_input, other, _extent(cells, axis))
    time, unknown = float(flow.times[frame]), _unpaired(float("nan"))
    return Comparison(label, time, len(samples), unknown, (seen[0], seen[1], seen[2]), view)


def read_picture(path: Path, material: str) -> NDArray[np.bool_]:
    """Return which pixels show material, first index to the right, second up.

    Parameters
    ----------
    path : Path
    material : {"bright", "dark"}
        Which side of half the grey scale is material.

    Raises
    ------
    InputFileError
        If the file is no picture, or all of it lies on one side.
    """
    from PIL import Image

    try:
        with Image.open(path) as picture:
            if picture.mode in ("I;16", "I", "F"):
                grey = np.asarray(picture, dtype=float) / (GREYS_OF_16_BITS if picture.mode != "F" else 1.0)
            else:
                grey = np.asarray(picture.convert("L"), dtype=float) / GREYS
    except (OSError, ValueError) as error:
        raise InputFileError(f"{path}: cannot be read as a picture of the flow front: {error}") from None
    marked = grey > 0.5 if material == "bright" else grey <= 0.5
    if marked.all() or not marked.any():
        raise InputFileError(
            f"{path}: {'every' if marked.all() else 'no'} pixel counts as material ({material}); "
            "give a picture of two tones, or the other value of analysis.front.mask.material"
        )
    return np.asarray(marked.T[:, ::-1])


def _with_voxels(flow: SeriesFile, frame: int, source: Source, file: VoxelFile, label: str, axis: int) -> Comparison:
    samples = next(flow_source(flow, frame).parts())
    corners = np.array([source.lower, source.upper]) if source.count else np.empty((0, 3))
    cells = _cells([samples.positions, corners], max(samples.spacing, source.spacing))
    # A voxel is a box of its own proportions, not a cube.
    edges = np.diag(np.array(file.grid.spacing) / source.spacing) @ file.grid.rotation.T
    both = occupancy([samples], cells), occupancy(source.parts(), cells, edges)
    shared, seen, view = _overlaps(*both, cells, axis)
    return Comparison(label, float(flow.times[frame]), len(samples), _unpaired(shared), seen, view)


def _cells(clouds: list[np.ndarray], spacing: float) -> Cells:
    return cells_around(clouds, spacing, CELL_IN_SPACINGS * spacing)


def _overlaps(
    first: NDArray[np.float64], second: NDArray[np.float64], cells: Cells, axis: int
) -> tuple[float, tuple[float, float, float], FrontView]:
    shadows = [(silhouette(first, a), silhouette(second, a)) for a in range(3)]
    x1, x2, x3 = (overlap(*pair) for pair in shadows)
    return overlap(first, second), (x1, x2, x3), FrontView(axis, *shadows[axis], _extent(cells, axis))


def _extent(cells: Cells, axis: int) -> tuple[float, float, float, float]:
    right, up = PLANES[axis]
    low = cells.origin
    high = low + cells.size * np.array(cells.shape)
    return float(low[right]), float(high[right]), float(low[up]), float(high[up])


def _unpaired(shared: float) -> RunDifference:
    nan = float("nan")
    return RunDifference(nan, nan, nan, nan, shared)
