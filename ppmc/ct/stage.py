"""The CT stage: grey-value volume in, orientations out; and the phantom, a volume with known orientations."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ppmc.ct.orientations import FIELD_NAMES, Job, grey_reference, orientations, threads_of
from ppmc.ct.phantom import Phantom
from ppmc.ct.registration import registered
from ppmc.ct.settings import settings
from ppmc.ct.source import Volume, open_volume
from ppmc.errors import InputFileError, SceneError
from ppmc.files import FIELDS, Provenance, VoxelGrid, VoxelWriter, check_output
from ppmc.progress import Progress
from ppmc.scene.ct import VolumeSource

if TYPE_CHECKING:
    from ppmc.scene import Scene
    from ppmc.scene.ct import CtSection


def make_phantom(scene: Scene, output: Path) -> Path:
    """Write the synthetic CT volume of a scene, with its true orientations.

    Parameters
    ----------
    scene : Scene
        Scene with a section ``phantom``; its ``seed`` decides every random draw.
    output : Path
        Volume file to write: grey, mask, fibre_direction, platelet_normal, platelet_id.

    Returns
    -------
    Path
        ``output``.

    Raises
    ------
    SceneError
        If the scene has no phantom.
    StorageError
        If the file cannot be written.
    """
    section = scene.require("phantom")
    check_output(output, [])
    phantom = Phantom(section, scene.seed)
    provenance = Provenance.collect("ppmc.ct", scene, ("phantom",), seed=scene.seed)
    names = [field.name for field in FIELDS["volume"]]
    planes = phantom.grid.shape[0]
    with (
        VoxelWriter(
            output, "volume", names, grid=phantom.grid, provenance=provenance, grey_dtype=section.grey_type
        ) as writer,
        Progress("phantom", total=planes, unit="planes") as bar,
    ):
        for slab in phantom.slabs():
            for name, values in slab.fields.items():
                writer.write(name, slab.first, values)
            bar.advance(len(slab.fields["grey"]))
    return output


def run(scene: Scene, *, input: Path | None = None, output: Path) -> Path:
    """Find fibre directions and platelet normals in a CT volume.

    Parameters
    ----------
    scene : Scene
        Scene with a section ``ct``.
    input : Path, optional
        The volume; ``ct: source: path`` of the scene by default.
    output : Path
        Orientations file to write.

    Returns
    -------
    Path
        ``output``.

    Raises
    ------
    SceneError
        If the scene's windows do not fit the volume, or it lacks what the file needs.
    InputFileError
        If the volume or mask is missing, damaged or of the wrong shape.
    StorageError
        If the file cannot be written.
    """
    section = scene.require("ct")
    path = volume_path(scene, input)
    mask_path = scene.locate(section.mask.path) if section.mask is not None and section.mask.path else None
    check_output(output, [path, *([mask_path] if mask_path else [])])
    with opened(scene, path, mask_path) as volume:
        job = plan(scene, volume)
        spacing = job.spacing
        grid = registered(VoxelGrid(volume.shape, spacing, volume.origin, volume.direction), section.registration)
        provenance = Provenance.collect("ppmc.ct", scene, ("ct",), inputs=[path, mask_path])
        with (
            VoxelWriter(
                output, "orientations", FIELD_NAMES, grid=grid.strided(job.stride), provenance=provenance
            ) as out,
            Progress("structure tensor", total=job.shape[0], unit="planes") as bar,
        ):
            for block in orientations(job, threads_of(section.threads)):
                for name, values in block.fields.items():
                    out.write(name, block.first, in_tool_axes(name, values, grid))
                bar.advance(len(block.fields["valid"]))
    return output


def volume_path(scene: Scene, input: Path | None) -> Path:
    """Return the volume to read: the one given, else the scene's."""
    section = scene.require("ct")
    if input is not None:
        return Path(input)
    if section.source.path is None:
        raise SceneError("no CT volume: give --input, or ct: source: path: in the scene")
    return Path(scene.locate(section.source.path))


@contextmanager
def opened(scene: Scene, path: Path, mask_path: Path | None) -> Iterator[Volume]:
    """Open the volume and the mask that belongs to it."""
    section: CtSection = scene.require("ct")
    with ExitStack() as stack:
        volume = stack.enter_context(open_volume(path, section.source))
        if mask_path is not None and section.mask is not None:
            source = VolumeSource(dataset=section.mask.dataset, shape=volume.shape, dtype="uint8")
            mask = stack.enter_context(open_volume(mask_path, source))
            if mask.shape != volume.shape:
                raise InputFileError(
                    f"{mask_path}: the mask has shape {mask.shape}, but the volume {path.name} has {volume.shape}; "
                    "they must be equal"
                )
            volume = replace(volume, read_mask=mask.read)
        yield volume


def plan(scene: Scene, volume: Volume) -> Job:
    """Work out filters, windows and units for a volume."""
    section: CtSection = scene.require("ct")
    spacing = volume.spacing
    given = section.source.voxel_size
    if given is not None:
        spacing = given if isinstance(given, tuple) else (given, given, given)
    if spacing is None:
        raise SceneError(f"{volume.path} does not state its voxel size: give ct: source: voxel_size: (mm, or '50 um')")
    thickness = section.platelet_thickness
    if thickness is None and scene.phantom is not None:
        thickness = scene.phantom.platelet.thickness
    return Job(
        volume=volume,
        spacing=spacing,
        chosen=settings(section, spacing, volume.shape, thickness),
        reference=grey_reference(volume),
        stride=section.stride,
        least_confidence=section.least_confidence,
    )


def in_tool_axes(name: str, values: np.ndarray[Any, Any], grid: VoxelGrid) -> np.ndarray[Any, Any]:
    """Return a field with its vectors turned from the grid's axes to the tool's."""
    vectors = name in ("fibre_direction", "platelet_normal")
    if not vectors or np.array_equal(grid.rotation, np.eye(3)):
        return values
    return np.asarray(values @ grid.rotation.T.astype(np.float32))
