"""The chain beside the phantom's truth: choose the interior, average each link over it, pair voxels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ppmc.analysis.averages.regions import Region
from ppmc.analysis.averages.sources import Source, grid_box, occupied_indices, orientations_source, truth_source
from ppmc.analysis.flow.results import TruthComparison
from ppmc.analysis.flow.truth import AngleErrors, truth_rows
from ppmc.files import VoxelFile
from ppmc.particles import Particles

DEFAULT_MARGIN = 0.1


def compare_with_truth(
    volume: VoxelFile,
    orientations: VoxelFile,
    margin: float | None,
    links: Sequence[tuple[str, str, Source, bool]],
    notes: list[str],
) -> TruthComparison | None:
    """Compare in the interior of the phantom.

    Parameters
    ----------
    volume, orientations : VoxelFile
        Phantom with true directions, and what CT analysis found in it.
    margin : float or None
        Distance from the specimen's faces, mm; a tenth of its smallest extent if None.
    links : sequence of (label, note, source, by_start)
        Further links of the chain; `by_start` picks particles by their reference position instead of their present one.
    notes : list of str
        Gains a line when there is nothing to compare.
    """
    if not {"fibre_direction", "platelet_normal"} <= set(volume.names):
        return None
    interior, margin = _interior(volume, margin)
    if interior is None:
        notes.append(
            f"No interior is left {margin:.3g} mm from the specimen's faces: CT is not compared with the truth."
        )
        return None

    def inside(samples: Particles) -> np.ndarray:
        return interior.contains(samples.positions)

    def started_inside(samples: Particles) -> np.ndarray:
        return interior.contains(samples.fields["reference_position"])

    region = [interior]
    truth, ct = truth_source(volume), orientations_source(orientations)
    entries = [
        ("phantom truth", "every platelet voxel", truth.averages(region)),
        ("CT", "valid voxels", ct.averages(region)),
    ]
    whole = _unbounded()
    for label, note, source, by_start in links:
        cut = source.where(started_inside if by_start else inside)
        entries.append((label, note, cut.averages(whole)))
    fibre, normal = _pair(volume, ct, interior)
    return TruthComparison(interior, margin, truth_rows(entries), fibre, normal)


def _unbounded() -> list[Region]:
    from ppmc.analysis.averages.regions import everything

    return [everything()]


def _interior(volume: VoxelFile, margin: float | None) -> tuple[Region | None, float]:
    """Return the box around the specimen (its mask, or else the whole grid) shrunk by the margin."""
    nz, ny, nx = volume.grid.shape
    low, high = np.zeros(3), np.array([nx - 1.0, ny - 1.0, nz - 1.0])
    if "mask" in volume.names:
        count, first, last = occupied_indices(volume, lambda index: volume.read("mask", index) > 0)
        if count:
            low, high = first, last
    size = (high - low + 1.0) * np.asarray(volume.grid.spacing)
    margin = float(DEFAULT_MARGIN * size.min()) if margin is None else margin
    return grid_box(volume.grid, low, high, "interior", margin), margin


def _pair(volume: VoxelFile, ct: Source, interior: Region) -> tuple[AngleErrors, AngleErrors]:
    """Measure angles between each valid CT voxel of the interior and the phantom voxel at the same place."""
    fibre, normal = AngleErrors(), AngleErrors()
    nz, ny, nx = volume.grid.shape
    for part in ct.parts():
        part = part.select(interior.contains(part.positions))
        index = np.rint(volume.grid.to_index(part.positions)).astype(np.int64)
        within = np.asarray(((index >= 0) & (index < [nx, ny, nz])).all(axis=1))
        index, part = index[within], part.select(within)
        if not len(part) or part.fibre_direction is None or part.platelet_normal is None:
            continue
        low, high = index.min(axis=0), index.max(axis=0) + 1
        block = tuple(slice(int(low[a]), int(high[a])) for a in (2, 1, 0))
        at = tuple((index - low)[:, a] for a in (2, 1, 0))
        fibre.add(part.fibre_direction, volume.read("fibre_direction", block)[at].astype(float))  # type: ignore[arg-type]
        normal.add(part.platelet_normal, volume.read("platelet_normal", block)[at].astype(float))  # type: ignore[arg-type]
    return fibre, normal
