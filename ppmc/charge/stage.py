"""Charge stage: scene (and orientations file) in, charge file out."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ppmc.charge.domains.domain import lattice_of
from ppmc.charge.domains.drape import drape, flat_sheet, turned
from ppmc.charge.domains.lattice import Lattice
from ppmc.charge.exchange import CSV_HEAD, read_points, writer_of
from ppmc.charge.exchange.points import oriented_points
from ppmc.charge.figures.pictures import View, draw_cut, draw_in_tool, draw_top_view, space_of
from ppmc.charge.orient import frames_of
from ppmc.charge.orientations.frames import GIVEN, Frames
from ppmc.charge.orientations.from_ct import frames_from_ct
from ppmc.charge.orientations.imported import imported_frames
from ppmc.charge.orientations.nearest import VoxelSource
from ppmc.charge.orientations.surface_normals import distance_of, local_frames, regional_frames
from ppmc.errors import InputFileError, SceneError
from ppmc.files import (
    Claim,
    ParticleFile,
    Provenance,
    check_output,
    is_product,
    one_writer,
    read_particles,
    read_voxels,
    whole_file,
    write_particles,
)
from ppmc.files.beside import marked_file
from ppmc.files.lock import locked
from ppmc.files.storage import is_text_with
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.orientation import orientation_tensor, to_six
from ppmc.particles import Particles, charge_particles
from ppmc.scene import Scene
from ppmc.scene.depends import of_charge
from ppmc.scene.sections.charge import (
    ChargeSection,
    CtOrientation,
    DrapedDomain,
    FileOrientation,
    LocalOrientation,
    RegionalOrientation,
)

# Second key of the random generator, so that stages that share the scene's seed draw different numbers.
STAGE_NUMBER = 3
ROUNDING = 1e-14  # largest change of a component of a unit vector that is but rounding


@one_writer(lambda given: [Claim(given["output"])])
def run(
    scene: Scene, *, input: Path | None = None, output: Path, volume: Path | None = None, force: bool = False
) -> Path:
    """Fill the charge's domain with particles and write them.

    Parameters
    ----------
    scene : Scene
        With a section `charge`.
    input : Path, optional
        Orientations file; needed if, and read only if, ``charge.orientation.source`` is ``ct``.
    output : Path
        Charge file to write.
    volume : Path, optional
        Volume file with true platelet ids (a phantom's), instead of the scene's ``charge.orientation.platelet_ids``.
    force : bool
        Replace an output that is no charge of ppmc.

    Returns
    -------
    Path
        The charge file.

    Raises
    ------
    SceneError
        If the section does not describe a charge, a tool it names is missing, or particles are left without
        orientation.
    InputFileError
        If an input is missing or broken.
    StorageError
        If the output cannot be written.
    """
    section: ChargeSection = scene.require("charge")
    inputs = _inputs(scene, section, input, volume)
    depends = of_charge(scene, input, volume)
    # Moulds are not replaced, be they none of what this stage reads.
    named = [*depends.inputs, *scene.named_files("tooling"), scene.file]
    check_output(output, named, is_own=is_product("charge"), force=force)
    # The digest of a large CT file takes longer than the map from it.
    with ThreadPoolExecutor(1) as beside, opened(section, inputs) as sources:
        provenance = beside.submit(Provenance.of, scene, depends)
        made = fill(scene, sources)
    write_particles(
        output, "charge", made.positions, made.fields, provenance=provenance.result(), extra=made.extra
    )  # fmt: skip
    return output


def write(charge: ParticleFile, output: Path, *, force: bool = False) -> Path:
    """Write a charge that was made in memory; its origin is the one that it carries.

    Raises
    ------
    SceneError
        If `output` is a file of another kind, and `force` is not given.
    StorageError
        If it cannot be written.
    """
    with locked([Claim(output)]):
        check_output(output, [], is_own=is_product("charge"), force=force)
        write_particles(
            output, "charge", charge.positions, charge.fields, provenance=charge.provenance, extra=charge.extra
        )
    return output


def charge_origin(
    scene: Scene, orientations: Path | None, volume: Path | None, made_here: Mapping[str, str]
) -> Provenance:
    """Return the origin of a charge; `made_here` has digests of voxels that no file holds."""
    return Provenance.of(scene, of_charge(scene, orientations, volume), made_here)


def given_particles(
    positions: ArrayLike, fibre_direction: ArrayLike, platelet_normal: ArrayLike, volume: ArrayLike,
    platelet_id: ArrayLike | None = None, spacing: Sequence[float] | None = None,
) -> ParticleFile:  # fmt: skip
    """Return a charge of particles that are given one by one.

    Parameters
    ----------
    positions : array_like, shape (n, 3)
        mm.
    fibre_direction, platelet_normal : array_like, shape (n, 3) or (3,)
        p and r.
    volume : array_like, shape (n,) or ()
        mm^3.
    platelet_id : array_like, shape (n,), optional
    spacing : three floats, optional
        Of the lattice, mm.

    Raises
    ------
    InputFileError
        If the arrays are no charge, naming the first particle at fault.
    """
    x = np.array(positions, dtype=np.float64)
    n = len(x) if x.ndim else 0
    p, r = (_for_all(v, n) for v in (fibre_direction, platelet_normal))
    sizes = np.asarray(volume, dtype=np.float64)
    sizes = np.full(n, float(sizes)) if sizes.ndim == 0 else sizes
    ids = np.full(n, -1, np.int64) if platelet_id is None else np.asarray(platelet_id)
    for name, values in (("volume", sizes), ("platelet_id", ids)):
        if values.shape != (n,):
            raise InputFileError(f"charge: {name} has shape {values.shape}, must be ({n},)")
    bad = np.flatnonzero(~(np.isfinite(sizes) & (sizes > 0.0)))
    if len(bad):
        raise InputFileError(f"charge: volume of point {bad[0] + 1} is {sizes[bad[0]]:.6g} mm^3, must be positive")
    points = oriented_points("charge", x, p, r, sizes, ids)
    # What is exact already stays as it is, to the bit: particles of a charge give the same charge.
    p, r = (v if np.abs(v - made).max() < ROUNDING else made for v, made in ((p, points.p), (r, points.r)))
    frames = Frames.of(p, r, GIVEN).with_ids(ids)
    extra = {
        "total_volume": float(sizes.sum()),
        "fibre_tensor": to_six(points.A).tolist(),
        "normal_tensor": to_six(points.N).tolist(),
    }
    if spacing is not None:
        extra["spacing"] = [float(h) for h in spacing]
    return ParticleFile(x, _fields(sizes, frames), extra, Provenance.collect("ppmc.charge"))


def _for_all(direction: ArrayLike, n: int) -> np.ndarray:
    """Return one direction for each particle."""
    values = np.asarray(direction, dtype=np.float64)
    return np.tile(values, (n, 1)) if values.shape == (3,) else values


@dataclass(frozen=True)
class Sources:
    """What orientations come from, where not from the scene alone.

    Attributes
    ----------
    orientations : VoxelSource or None
        Voxel orientations, for the source ``ct``.
    truth : VoxelSource or None
        Volume with true platelet ids.
    points : Particles or None
        Points with directions, for the source ``file``.
    name : str
        Names the orientations in messages.
    """

    orientations: VoxelSource | None = None
    truth: VoxelSource | None = None
    points: Particles | None = None
    name: str = "the orientations"


@contextmanager
def opened(section: ChargeSection, inputs: list[Path]) -> Iterator[Sources]:
    """Open the files that orientations come from: orientations first, then true platelet ids."""
    if isinstance(section.orientation, FileOrientation):
        yield Sources(points=read_points(inputs[0]))
        return
    with ExitStack() as stack:
        voxels = [
            stack.enter_context(read_voxels(path, product))
            for path, product in zip(inputs, ("orientations", "volume"), strict=False)
        ]
        if len(voxels) == 2 and "platelet_id" not in voxels[1].names:
            raise InputFileError(
                f"{inputs[1]}: no dataset 'platelet_id'; charge.orientation.platelet_ids wants a phantom's volume"
            )
        first, second = (*voxels, None, None)[:2]
        yield Sources(first, second, name=str(inputs[0]) if inputs else Sources.name)


def fill(scene: Scene, sources: Sources = Sources()) -> ParticleFile:
    """Fill the charge's domain with particles; no file of the chain is read or written.

    Parameters
    ----------
    scene : Scene
        With a section `charge`; its seed decides every random draw.
    sources : Sources
        Orientations from elsewhere, if the section asks for them.

    Returns
    -------
    ParticleFile
        All that a charge file holds but its origin.

    Raises
    ------
    SceneError, InputFileError
        As `run`.
    """
    section: ChargeSection = scene.require("charge")
    generator = np.random.default_rng([scene.seed, STAGE_NUMBER])
    if isinstance(section.domain, DrapedDomain):
        lattice, frames = _draped(scene, section, section.domain, generator, sources)
    else:
        lattice = lattice_of(section, scene.directory)
        frames = _frames(scene, section, lattice, generator, sources)
    return ParticleFile(
        np.asarray(lattice.positions, np.float64), _fields(lattice.volumes, frames), summary(lattice, frames)
    )


def _draped(
    scene: Scene, section: ChargeSection, domain: DrapedDomain, generator: np.random.Generator, sources: Sources
) -> tuple[Lattice, Frames]:
    """Return the particles and frames of a sheet laid onto a tool.

    Orientations of the flat sheet turn with it; those about normals are drawn where the particles have come to lie.
    """
    sheet = flat_sheet(domain, section.spacing, section.layers)
    distance = distance_of(domain.tool, scene.tooling, scene.directory, "charge.domain.tool")
    draped = drape(domain, sheet, distance)
    lattice = replace(sheet, positions=draped.positions)
    if isinstance(section.orientation, RegionalOrientation | LocalOrientation):
        frames = _frames(scene, section, lattice, generator, sources)
        frames.notes.update(draped.notes)
        return lattice, frames
    return lattice, turned(_frames(scene, section, sheet, generator, sources), draped)


def export(charge: Path, output: Path, *, keep: Iterable[Path | None] = (), force: bool = False) -> Path:
    """Write the particles of a charge file for another program; the ending chooses the format.

    Parameters
    ----------
    charge : Path
        Charge file.
    output : Path
        CSV, NPZ, VTU or Abaqus .inp file to write.
    keep : iterable of Path
        Files that are not replaced: those that a scene names, and the scene.
    force : bool
        Replace a file that was not exported by ppmc.

    Raises
    ------
    SceneError
        If the ending is not known, or `output` is the charge file or one to keep.
    InputFileError
        If the charge file is missing or broken.
    StorageError
        If the output cannot be written.
    """
    write = writer_of(output)
    inputs = [charge, *keep]
    points = charge_particles(read_particles(charge, "charge"), str(charge))
    if output.suffix.lower() == ".csv":
        check_output(output, inputs, is_own=is_text_with(CSV_HEAD), force=force)
        with whole_file(output) as temporary:
            write(temporary, points)
    else:
        with marked_file(output, inputs, force=force) as temporary:
            write(temporary, points)
    return output


def draw(scene: Scene, charge: Path, folder: Path, *, force: bool = False) -> list[Path]:
    """Draw a charge: top view, cuts with the tools, and a view in the tool where VTK can draw.

    Parameters
    ----------
    scene : Scene
        For the tools, and the direction from which a draped charge is seen.
    charge : Path
        Charge file.
    folder : Path
        Folder for the pictures.
    force : bool
        Replace pictures of other programs.

    Returns
    -------
    list of Path
        The pictures drawn.

    Raises
    ------
    InputFileError
        If the charge file is missing or broken.
    SceneError
        If another program's picture has the name of one of these.
    StorageError
        If the folder cannot be written to.
    """
    particles = read_particles(charge, "charge")
    domain = scene.require("charge").domain
    view = View.against(domain.down) if isinstance(domain, DrapedDomain) else View()
    tools = compile_tools(scene.tooling, scene.directory) if scene.tooling else None
    clearance = (lambda points: tools.clearance(points)[0]) if tools is not None else None
    space = space_of(particles, tools)

    inputs = [charge, *scene.every_named_file()]
    top, cut, in_tool = (folder / f"charge_{name}.png" for name in ("top", "cut", "in_tool"))
    with marked_file(top, inputs, force=force) as temporary:
        draw_top_view(particles, temporary, view)
    with marked_file(cut, inputs, force=force) as temporary:
        draw_cut(particles, temporary, view, clearance, space)
    image = draw_in_tool(particles, view, clearance, space)
    if isinstance(image, str):
        print(f"no three-dimensional picture of the charge: {image}", file=sys.stderr)
        return [top, cut]
    with marked_file(in_tool, inputs, force=force) as temporary:
        temporary.write_bytes(image)
    return [top, cut, in_tool]


def summary(lattice: Lattice, frames: Frames) -> dict[str, Any]:
    """Return the figures stored beside the particles, and printed: lattice, totals, orientation tensors, notes."""
    return {
        "spacing": list(lattice.spacing),
        "layers": lattice.shape[0],
        "lattice_shape": list(lattice.shape),
        "total_volume": float(lattice.volumes.sum()),
        "volume_scale": lattice.volume_scale,
        "fibre_tensor": to_six(orientation_tensor(frames.fibre_direction, lattice.volumes)).tolist(),
        "normal_tensor": to_six(orientation_tensor(frames.platelet_normal, lattice.volumes)).tolist(),
        **frames.notes,
    }


def _inputs(scene: Scene, section: ChargeSection, orientations: Path | None, volume: Path | None) -> list[Path]:
    """Return the files that orientations come from: orientations first, then true platelet ids."""
    choice = section.orientation
    if isinstance(choice, FileOrientation):
        return [scene.locate(choice.file)]
    if not isinstance(choice, CtOrientation):
        return []
    if orientations is None:
        raise SceneError(
            "charge.orientation.source is 'ct', which needs an orientations file: give --input, or run `ppmc ct` first"
        )
    if not Path(orientations).is_file():
        raise InputFileError(f"{orientations}: no such orientations file; make it with `ppmc ct`")
    if volume is None and choice.platelet_ids is not None:
        volume = scene.locate(choice.platelet_ids)
    return [Path(orientations)] + ([Path(volume)] if volume is not None else [])


def _frames(
    scene: Scene, section: ChargeSection, lattice: Lattice, generator: np.random.Generator, sources: Sources
) -> Frames:
    """Return the frames of all particles, from what was read or from the scene alone."""
    choice = section.orientation
    if isinstance(choice, RegionalOrientation):
        return regional_frames(choice, lattice.positions, generator)
    if isinstance(choice, LocalOrientation):
        distance = distance_of(choice.tool, scene.tooling, scene.directory, "charge.orientation.tool")
        return local_frames(distance, lattice.positions, generator)
    if isinstance(choice, FileOrientation):
        assert sources.points is not None
        return imported_frames(choice, sources.points, lattice.positions)
    if not isinstance(choice, CtOrientation):
        return frames_of(choice, lattice, generator)
    assert sources.orientations is not None
    return frames_from_ct(
        choice, sources.orientations, lattice.positions, lattice.spacing, generator, sources.truth, name=sources.name
    )


def _fields(volume: np.ndarray, frames: Frames) -> dict[str, np.ndarray]:
    """Return the arrays of the charge file."""
    return {
        "fibre_direction": frames.fibre_direction,
        "in_plane_direction": frames.in_plane_direction,
        "platelet_normal": frames.platelet_normal,
        "volume": volume,
        "platelet_id": frames.platelet_id,
        "region_id": frames.region_id,
        "confidence": frames.confidence,
        "orientation_source": frames.source,
    }
