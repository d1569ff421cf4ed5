"""Frames from CT: placement in the tool, nearest voxel, and what to do with particles that have no data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.orientations.directions import planar_random, uniform_frames
from ppmc.charge.orientations.frames import DEFAULT, FROM_CT, RANDOM, Frames
from ppmc.charge.orientations.nearest import NearestMap, VoxelSource, nearest_valid_voxels, read_frames, read_voxels_at
from ppmc.errors import InputFileError, SceneError
from ppmc.scene.sections.charge import CtOrientation, NearestOrientation, UniformOrientation

Array = NDArray[np.floating]


def placement(section: CtOrientation) -> tuple[Array, Array]:
    """Return the rotation, shape (3, 3), and translation, shape (3,), from CT to tool coordinates.

    The rotation matrix is Rodrigues' formula, I + sin(a) K + (1 - cos(a)) K^2, with K v = axis x v.
    """
    R = np.eye(3)
    if section.rotation is not None:
        x, y, z = section.rotation.axis
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        a = np.radians(section.rotation.angle)
        R = np.eye(3) + np.sin(a) * K + (1.0 - np.cos(a)) * (K @ K)
    return R, np.asarray(section.translation, dtype=float)


def frames_from_ct(
    section: CtOrientation,
    source: VoxelSource,
    positions: Array,
    spacing: tuple[float, float, float],
    generator: np.random.Generator,
    platelet_ids: VoxelSource | None = None,
    name: str = "the orientations file",
) -> Frames:
    """Return the frames of the nearest valid voxels (J, section III.B).

    Parameters
    ----------
    section : CtOrientation
        Thresholds, placement and fallback.
    source : VoxelSource
        Orientations.
    positions : ndarray, shape (n, 3)
        Particles in tool coordinates, mm.
    spacing : three floats
        Lattice spacing, mm; its largest is the default search radius.
    generator : numpy.random.Generator
        Used by the planar random fallback only.
    platelet_ids : VoxelSource, optional
        Volume with the field `platelet_id`, in the same coordinates as `source`; each particle takes the platelet of
        the voxel it stands in.
    name : str
        Names the file in messages.

    Raises
    ------
    SceneError
        If particles have no data and no fallback is given; with the share of particles covered.
    InputFileError
        If a confidence is asked for that the file does not hold.
    """
    if section.confidence > 0.0 and "confidence" not in source.names:
        raise InputFileError(
            f"{name}: no dataset 'confidence', but charge.orientation.confidence is {section.confidence:g}; "
            "set it to 0 or write the file with `ppmc ct`"
        )
    R, shift = placement(section)
    local = (positions - shift) @ R
    radius = section.search_radius or max(spacing)
    found = nearest_valid_voxels(source, local, radius=radius, confidence=section.confidence)
    has_data = found.found
    n, missing = len(positions), int(np.count_nonzero(~has_data))
    if missing and section.fallback is None:
        raise SceneError(_no_data_message(found, section, name, radius))
    if missing and isinstance(section.fallback, NearestOrientation):
        far = nearest_valid_voxels(source, local[~has_data], radius=np.inf, confidence=section.confidence)
        if not far.found.all():
            raise InputFileError(
                f"{name}: no voxel at all is valid with a confidence of at least {section.confidence:g}; "
                "lower charge.orientation.confidence or look at the file with `ppmc info`"
            )
        found.voxel[~has_data], found.distance[~has_data] = far.voxel, far.distance
    mapped = found.found
    p, r, confidence = np.empty((n, 3)), np.empty((n, 3)), np.zeros(n)
    voxel_p, voxel_r, confidence[mapped] = read_frames(source, found.voxel[mapped])
    p[mapped], r[mapped] = voxel_p @ R.T, voxel_r @ R.T
    code = np.full(n, FROM_CT, dtype=np.int32)
    rest = ~mapped
    if rest.any():
        p[rest], r[rest], code[rest] = _fallback(section, int(rest.sum()), generator)
    direct = found.distance <= 0.5 * float(np.linalg.norm(source.grid.spacing)) * (1.0 + 1e-9)
    frames = Frames.of(p, r, FROM_CT)
    frames.notes.update(
        share_with_data=1.0 - missing / n,
        share_outside_volume=float(np.mean(found.outside)),
        share_in_valid_voxel=float(np.mean(direct & has_data)),
        particles_without_data=missing,
        fallback=section.fallback.source if section.fallback else "none",
        largest_distance_mm=float(found.distance[mapped].max(initial=0.0)),
    )
    frames = replace(frames, source=code, confidence=confidence)
    return frames.with_ids(_ids_at(platelet_ids, local)) if platelet_ids is not None else frames


def _fallback(section: CtOrientation, n: int, generator: np.random.Generator) -> tuple[Array, Array, int]:
    """Return p, r and source code of the particles without data."""
    choice = section.fallback
    if isinstance(choice, UniformOrientation):
        return *uniform_frames(n, choice.fibre_direction, choice.platelet_normal), DEFAULT
    assert choice is not None and not isinstance(choice, NearestOrientation)
    r = np.tile(np.asarray(choice.normal, dtype=float), (n, 1))
    return planar_random(r, generator), r, RANDOM


def _ids_at(volume: VoxelSource, local: Array) -> NDArray[np.int64]:
    """Return the platelet of the voxel that holds each particle, -1 outside the volume, in resin and in voids."""
    nearest = np.rint(volume.grid.to_index(local)).astype(np.int64)
    counts = np.array(volume.grid.shape[::-1])
    within = np.all((nearest >= 0) & (nearest < counts), axis=1)
    ids = np.full(len(local), -1, dtype=np.int64)
    ids[within] = read_voxels_at(volume, "platelet_id", nearest[within][:, ::-1]).astype(np.int64)
    return ids


def _no_data_message(found: NearestMap, section: CtOrientation, name: str, radius: float) -> str:
    """Return the message for a charge that the volume does not cover."""
    n = len(found.distance)
    missing, outside = int(np.count_nonzero(~found.found)), int(np.count_nonzero(found.outside))
    text = (
        f"{name}: only {1 - missing / n:.2%} of the {n:,} particles have a valid voxel within {radius:g} mm"
        f" (confidence at least {section.confidence:g}); {missing:,} have none"
    )
    if outside:
        text += (
            f", and {outside / n:.2%} of the particles lie outside the CT volume: check charge.domain and"
            " charge.orientation.translation"
        )
    return text + "; say what they get with charge.orientation.fallback, for example {source: nearest}"
