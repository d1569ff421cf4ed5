"""The CT stage: grey-value volume in, orientations out; and the phantom, a volume with known orientations."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ppmc.ct.block import Box
from ppmc.ct.field_of_view import field_of_view
from ppmc.ct.floor import gradient_floor, raised
from ppmc.ct.found import Found
from ppmc.ct.noise import noise_level, noise_tensor
from ppmc.ct.orientations import FIELD_NAMES, Cells, Job, cells_of, compute_tiles, grey_reference, threads_of
from ppmc.ct.parts import Fields, Parts
from ppmc.ct.phantom import Phantom
from ppmc.ct.registration import registered
from ppmc.ct.segment import mask_reader, specimen_mask
from ppmc.ct.settings import settings
from ppmc.ct.signal import Signal, signal_of
from ppmc.ct.source import Volume, open_volume
from ppmc.ct.suggest import advise
from ppmc.ct.tiles import MIB, Tiling, tiling
from ppmc.errors import InputFileError, SceneError
from ppmc.files import (
    FIELDS,
    Claim,
    MemoryVoxels,
    Provenance,
    VoxelGrid,
    VoxelWriter,
    check_output,
    is_product,
    one_writer,
)
from ppmc.files.chunks import rounded
from ppmc.files.voxels import Packed, chunks_of
from ppmc.notices import notice
from ppmc.progress import Progress
from ppmc.scene.depends import of_ct, of_phantom
from ppmc.scene.sections.ct import VolumeSource

if TYPE_CHECKING:
    from ppmc.scene import Scene
    from ppmc.scene.sections.ct import CtSection

JOB_THREADS = 4
"""Threads for which work that may go on elsewhere is cut, unless the scene says: all machines must cut it alike."""


@one_writer(lambda given: [Claim(given["output"])])
def make_phantom(scene: Scene, output: Path, *, force: bool = False) -> Path:
    """Write the synthetic CT volume of a scene, with its true orientations.

    Parameters
    ----------
    scene : Scene
        Scene with a section ``phantom``; its ``seed`` decides every random draw.
    output : Path
        Volume file to write: grey, mask, fibre_direction, platelet_normal, platelet_id.
    force : bool
        Replace an output that is no volume of ppmc.

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
    check_output(output, [*scene.named_files("tooling"), scene.file], is_own=is_product("volume"), force=force)
    phantom = Phantom(section, scene.seed)
    provenance = Provenance.of(scene, of_phantom(scene))
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


def _claims(given: Mapping[str, Any]) -> list[Claim]:
    """Return what a run writes: a share of the tiles, beside others, or the whole file, alone."""
    output, part = Path(given["output"]), given["part"]
    if part is None:
        return [Claim(output)]
    share = output.with_name(f"{output.stem}.part-{part[0]}-of-{part[1]}{output.suffix or '.vtkhdf'}")
    return [Claim(output, shared=True), Claim(share)]


@one_writer(_claims)
def run(
    scene: Scene,
    *,
    input: Path | None = None,
    output: Path,
    resume: bool = False,
    part: tuple[int, int] | None = None,
    force: bool = False,
    tell: Callable[[str], None] | None = None,
) -> Path:
    """Find fibre directions and platelet normals in a CT volume.

    Parameters
    ----------
    scene : Scene
        Scene with a section ``ct``.
    input : Path, optional
        The volume; ``ct: source: path`` of the scene by default.
    output : Path
        Orientations file to write.
    resume : bool
        Keep each finished tile in the folder ``<output>.parts`` until all are done, and use those found there.
    part : tuple of int, optional
        (i, n): compute only the i-th (from 1) of n shares of the tiles, and leave them in that folder; a later call
        with ``resume`` gathers them. For shares on several machines.
    force : bool
        Replace an output that holds no orientations of ppmc.
    tell : callable, optional
        Called with each line of what was found: share of valid voxels, certainty, A and N.

    Returns
    -------
    Path
        ``output``, or the folder of parts if ``part`` is given.

    Raises
    ------
    SceneError
        If the scene's windows do not fit the volume or the memory, or it lacks what the file needs.
    InputFileError
        If the volume or mask is missing, damaged or of the wrong shape.
    StorageError
        If the file cannot be written.
    """
    section = scene.require("ct")
    path = volume_path(scene, input)
    depends = of_ct(scene, path)
    guarded = [*depends.inputs, *scene.named_files("tooling"), scene.file]
    check_output(output, guarded, is_own=is_product("orientations"), force=force)
    with opened(scene, path, mask_path(scene)) as volume:
        job = plan(scene, volume)
        grid = registered(VoxelGrid(volume.shape, job.spacing, volume.origin, volume.direction), section.registration)
        keeps = resume or part is not None
        cells = cells_of(job)
        # sums that take little of the memory are kept in it, others in a file
        kept = 0.0 if cells is None or cells.nbytes > section.memory * MIB / 4 else cells.nbytes / MIB
        wanted = section.threads or (JOB_THREADS if keeps else threads_of(0))
        threads, tiles = _cut(job, section, section.memory - kept, wanted)
        threads = min(threads, threads_of(section.threads))
        provenance = Provenance.of(scene, depends)
        boxes = tiles.boxes()
        total = Found(job.shape)
        parts = Parts(output.with_name(f"{output.name}.parts"), provenance, tiles) if keeps else None
        if part is not None:
            boxes = boxes[part[0] - 1 :: part[1]]
        if parts is not None:
            boxes = parts.missing(boxes)
        with scratch_file(output) as scratch, ExitStack() as stack:
            writer = None if parts is not None else stack.enter_context(_writer(output, job, grid, provenance))
            fill = 2 * len(boxes) > len(tiles.boxes())
            for tile, box in _measured(
                job, grid, cells, boxes, threads, fill=fill, scratch=None if kept else scratch,
                packed=None if writer is None else writer.packed,
            ):  # fmt: skip
                if parts is not None:
                    parts.keep(tile.fields, box)
                elif writer is not None:
                    _put(writer, tile, box)
                total.join(tile.found)
        if part is not None and parts is not None:
            return parts.folder
        if parts is not None:
            total = Found(job.shape)
            with _writer(output, job, grid, provenance) as out:
                for box in tiles.boxes():
                    fields = parts.read(box)
                    _put(out, Tile(fields, total, out.packed(fields, box)), box)
                    total.add(fields, box)
            parts.remove()
        if tell is not None:
            for line in total.lines():
                tell(line)
    return output


def measure(scene: Scene, volume: Volume) -> MemoryVoxels:
    """Find fibre directions and platelet normals in an open volume, and keep them in memory.

    Parameters
    ----------
    scene : Scene
        Scene with a section ``ct``.
    volume : Volume
        The volume, its mask with it.

    Returns
    -------
    MemoryVoxels
        All that an orientations file holds, bit for bit, but its origin.

    Raises
    ------
    SceneError, InputFileError
        As `run`.
    """
    section = scene.require("ct")
    job = plan(scene, volume)
    grid = registered(VoxelGrid(volume.shape, job.spacing, volume.origin, volume.direction), section.registration)
    cells = cells_of(job)
    kept = 0.0 if cells is None else cells.nbytes / MIB
    threads, tiles = _cut(job, section, section.memory - kept, section.threads or threads_of(0))
    out = grid.strided(job.stride)
    specs = {spec.name: spec for spec in FIELDS["orientations"] if spec.name in _names(job)}
    arrays = {
        name: np.zeros((*out.shape, *((spec.components,) if spec.components > 1 else ())), spec.dtype)
        for name, spec in specs.items()
    }
    for tile, box in _measured(job, grid, cells, tiles.boxes(), min(threads, threads_of(section.threads))):
        for name, values in tile.fields.items():
            at = tuple(slice(first, first + n) for (first, _), n in zip(box, values.shape, strict=False))
            arrays[name][at] = rounded(np.ascontiguousarray(values, specs[name].dtype), specs[name])
    return MemoryVoxels("orientations", arrays, grid=out, provenance=Provenance("ppmc.ct"))


def _measured(
    job: Job, grid: VoxelGrid, cells: Cells | None, boxes: list[Box], threads: int, *, fill: bool = True,
    scratch: Path | None = None, packed: Callable[[Fields, Box], Packed | None] | None = None,
) -> Iterator[tuple[Tile, Box]]:  # fmt: skip
    """Yield each tile, its vectors in tool coordinates, and its place.

    Parameters
    ----------
    fill : bool
        Whether sums over cells are made for the whole volume first.
    scratch : Path, optional
        File in which they are kept; in memory if left out.
    packed : callable, optional
        Makes a tile's fields ready for the file, on the thread that has found them.
    """

    def finish(fields: Fields, box: Box) -> Tile:
        turned = {name: in_tool_axes(name, values, grid) for name, values in fields.items()}
        found = Found(job.shape)
        found.add(turned, box)
        return Tile(turned, found, None if packed is None else packed(turned, box))

    with ThreadPoolExecutor(threads) as pool, Progress("structure tensor", total=len(boxes), unit="tiles") as bar:
        if cells is not None and fill:
            cells.fill(pool, scratch)
        for block in compute_tiles(job, cells, boxes, pool, threads, finish):
            yield block.finished, block.box
            bar.advance()


def _cut(job: Job, section: CtSection, memory: float, threads: int) -> tuple[int, Tiling]:
    """Return the number of threads and the tiles; where it is left to us, fewer threads rather than too much memory."""
    while True:
        try:
            return threads, tiling(
                job.shape, job.chosen, stride=job.stride, budget=memory, threads=threads,
                itemsize=job.volume.dtype.itemsize, masked=job.volume.read_mask is not None,
                chunk=chunks_of(job.shape),
            )  # fmt: skip
        except SceneError:
            if section.threads > 0 or threads == 1:
                raise
            threads //= 2


@dataclass(frozen=True)
class Tile:
    """A finished tile: its fields, what was found, and the chunks of the file that it fills, if they are whole."""

    fields: Fields
    found: Found
    packed: Packed | None


def _writer(output: Path, job: Job, grid: VoxelGrid, provenance: Provenance) -> VoxelWriter:
    """Return the writer of the output."""
    return VoxelWriter(
        output, "orientations", _names(job), grid=grid.strided(job.stride), provenance=provenance, compact=True
    )


def _names(job: Job) -> list[str]:
    """Return the fields that are found."""
    return [name for name in FIELD_NAMES if job.normals or name not in ("platelet_normal", "planarity")]


def _put(writer: VoxelWriter, tile: Tile, box: Box) -> None:
    """Write a tile."""
    if tile.packed is not None:
        writer.put(tile.packed)
        return
    for name, values in tile.fields.items():
        writer.write(name, box[0][0], values, box[1][0], box[2][0])


@contextmanager
def scratch_file(output: Path) -> Iterator[Path]:
    """Yield the name of a file beside the output that is gone afterwards."""
    path = output.with_name(f".{output.name}.{os.getpid()}.cells")
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def volume_path(scene: Scene, input: Path | None) -> Path:
    """Return the volume to read: the one given, else the scene's."""
    section = scene.require("ct")
    if input is not None:
        return Path(input)
    if section.source.path is None:
        raise SceneError("no CT volume: give --input, or ct: source: path: in the scene")
    return Path(scene.locate(section.source.path))


def mask_path(scene: Scene) -> Path | None:
    """Return the file of the specimen's mask, if the scene names one."""
    mask = scene.require("ct").mask
    return scene.locate(mask.path) if mask is not None and mask.path else None


def origin(scene: Scene, volume: Path) -> Provenance:
    """Return the origin of orientations that are measured in a file."""
    return Provenance.of(scene, of_ct(scene, volume))


@contextmanager
def opened(scene: Scene, path: Path, masked: Path | None) -> Iterator[Volume]:
    """Open the volume and the mask that belongs to it."""
    section: CtSection = scene.require("ct")
    with ExitStack() as stack:
        volume = stack.enter_context(open_volume(path, section.source))
        if masked is not None and section.mask is not None:
            source = VolumeSource(dataset=section.mask.dataset, shape=volume.shape, dtype="uint8")
            mask = stack.enter_context(open_volume(masked, source))
            if mask.shape != volume.shape:
                raise InputFileError(
                    f"{masked}: the mask has shape {mask.shape}, but the volume {path.name} has {volume.shape}; "
                    "they must be equal"
                )
            yield volume.within(mask.read)
        else:
            yield specimen_of(section, volume)


def specimen_of(section: CtSection, volume: Volume) -> Volume:
    """Return a volume with the mask that is found in it, if the section asks for one or there is no other."""
    if section.mask is not None and section.mask.segment:
        found, cell = specimen_mask(volume, exclude_voids=section.mask.exclude_voids)
        return volume.within(mask_reader(found, cell))
    if volume.read_mask is None and (section.mask is None or section.mask.field_of_view):
        return _within_field_of_view(volume)
    return volume


def _within_field_of_view(volume: Volume) -> Volume:
    """Leave out what lies around a round field of view, and say so: its rim would be the strongest texture."""
    seen = field_of_view(volume)
    if seen is None:
        return volume
    notice(
        f"{volume.path}: every voxel beyond {seen.radius:.0f} voxels of x = {seen.middle[1]:.0f}, "
        f"y = {seen.middle[0]:.0f} is {seen.fill:g}: a round field of view; what is outside is left out "
        "(ct: mask: {field_of_view: false} keeps it)"
    )
    return seen.reader(volume)


def suggest(scene: Scene, *, input: Path | None = None) -> list[str]:
    """Return advice on sigma and windows for a volume, as lines of a scene.

    Raises
    ------
    SceneError
        If the voxel size is not known.
    InputFileError
        If the volume is missing or damaged.
    """
    section: CtSection = scene.require("ct")
    with opened(scene, volume_path(scene, input), None) as volume:
        bare = section.model_copy(update={"sigma": None, "fibre_window": None, "normals": True, "follow": True})
        job, signal, level = _plan(bare, volume, _spacing(scene, volume), _thickness(scene))
        alone = noise_tensor(job.chosen, level / job.reference.unit)
        white = job.noise is None or np.array_equal(job.noise, alone)
        return advise(job, signal, level, known=_thickness(scene) is not None, white=white).lines()


def _spacing(scene: Scene, volume: Volume) -> tuple[float, float, float]:
    """Return the voxel size that the scene or else the file states."""
    given = scene.require("ct").source.voxel_size
    if given is not None:
        return given if isinstance(given, tuple) else (given, given, given)
    if volume.spacing is None:
        raise SceneError(f"{volume.path} does not state its voxel size: give ct: source: voxel_size: (mm, or '50 um')")
    return volume.spacing


def _thickness(scene: Scene) -> float | None:
    """Return the platelet thickness that the scene knows of."""
    section: CtSection = scene.require("ct")
    if section.platelet_thickness is None and scene.phantom is not None:
        return scene.phantom.platelet.thickness
    return section.platelet_thickness


def plan(scene: Scene, volume: Volume) -> Job:
    """Work out filters, windows and units for a volume."""
    job, _, _ = _plan(scene.require("ct"), volume, _spacing(scene, volume), _thickness(scene))
    return job


def _plan(
    section: CtSection, volume: Volume, spacing: tuple[float, float, float], thickness: float | None
) -> tuple[Job, Signal, float]:
    """Return the job, what the volume bears, and its noise level."""
    reference = grey_reference(volume)
    level = noise_level(volume) if section.noise_level is None else section.noise_level
    signal = signal_of(volume, spacing, level)
    chosen = settings(section, spacing, volume.shape, thickness, signal)
    noise = None
    if section.correct_noise:
        noise = noise_tensor(chosen, level / reference.unit)
        if section.noise_level is None:
            noise = raised(noise, gradient_floor(volume, spacing, chosen, reference, signal.scale))
    job = Job(
        volume=volume,
        spacing=spacing,
        chosen=chosen,
        reference=reference,
        stride=section.stride,
        least_confidence=section.least_confidence,
        noise=noise,
        normals=section.normals,
    )
    return job, signal, level


def in_tool_axes(name: str, values: np.ndarray[Any, Any], grid: VoxelGrid) -> np.ndarray[Any, Any]:
    """Return a field with its vectors turned from the grid's axes to the tool's."""
    vectors = name in ("fibre_direction", "platelet_normal")
    if not vectors or np.array_equal(grid.rotation, np.eye(3)):
        return values
    return np.asarray(values @ grid.rotation.T.astype(np.float32))
