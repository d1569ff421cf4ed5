"""Charge stage: scene (and orientations file) in, charge file out."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ppmc.charge.domains.domain import lattice_of
from ppmc.charge.domains.drape import drape, flat_sheet, turned
from ppmc.charge.domains.lattice import Lattice
from ppmc.charge.exchange import EXPORTED, read_points, writer_of
from ppmc.charge.exchange.points import OrientedPoints
from ppmc.charge.figures.pictures import View, draw_cut, draw_in_tool, draw_top_view, space_of
from ppmc.charge.orient import frames_of
from ppmc.charge.orientations.frames import Frames
from ppmc.charge.orientations.from_ct import frames_from_ct
from ppmc.charge.orientations.imported import imported_frames
from ppmc.charge.orientations.surface_normals import distance_of, local_frames, regional_frames
from ppmc.errors import InputFileError, SceneError
from ppmc.files import (
    Claim,
    Provenance,
    check_output,
    is_product,
    one_writer,
    read_particles,
    read_voxels,
    whole_file,
    write_particles,
)
from ppmc.files.storage import is_text_with
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.orientation import orientation_tensor, to_six
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
    generator = np.random.default_rng([scene.seed, STAGE_NUMBER])
    # The digest of a large CT file takes longer than the map from it.
    with ThreadPoolExecutor(1) as beside:
        provenance = beside.submit(Provenance.of, scene, depends)
        if isinstance(section.domain, DrapedDomain):
            lattice, frames = _draped(scene, section, section.domain, generator, inputs)
        else:
            lattice = lattice_of(section, scene.directory)
            frames = _frames(scene, section, lattice, generator, inputs)
    write_particles(
        output, "charge", lattice.positions, _fields(lattice, frames), provenance=provenance.result(),
        extra=summary(lattice, frames),
    )  # fmt: skip
    return output


def _draped(
    scene: Scene, section: ChargeSection, domain: DrapedDomain, generator: np.random.Generator, inputs: list[Path]
) -> tuple[Lattice, Frames]:
    """Return the particles and frames of a sheet laid onto a tool.

    Orientations of the flat sheet turn with it; those about normals are drawn where the particles have come to lie.
    """
    sheet = flat_sheet(domain, section.spacing, section.layers)
    distance = distance_of(domain.tool, scene.tooling, scene.directory, "charge.domain.tool")
    draped = drape(domain, sheet, distance)
    lattice = replace(sheet, positions=draped.positions)
    if isinstance(section.orientation, RegionalOrientation | LocalOrientation):
        frames = _frames(scene, section, lattice, generator, inputs)
        frames.notes.update(draped.notes)
        return lattice, frames
    return lattice, turned(_frames(scene, section, sheet, generator, inputs), draped)


def export(charge: Path, output: Path, *, force: bool = False) -> Path:
    """Write the particles of a charge file for another program; the ending chooses the format.

    Parameters
    ----------
    charge : Path
        Charge file.
    output : Path
        CSV, NPZ, VTU or Abaqus .inp file to write.
    force : bool
        Replace a file that was not exported by ppmc.

    Raises
    ------
    SceneError
        If the ending is not known, or `output` is the charge file.
    InputFileError
        If the charge file is missing or broken.
    StorageError
        If the output cannot be written.
    """
    write = writer_of(output)
    check_output(output, [charge], is_own=is_text_with(EXPORTED[output.suffix.lower()]), force=force)
    particles = read_particles(charge, "charge")
    fields = particles.fields
    points = OrientedPoints(
        particles.positions,
        fields["fibre_direction"],
        fields["platelet_normal"],
        fields["volume"],
        fields["platelet_id"],
    )
    with whole_file(output) as temporary:
        write(temporary, points)
    return output


def draw(scene: Scene, charge: Path, folder: Path) -> list[Path]:
    """Draw a charge: top view, cuts with the tools, and a view in the tool where VTK can draw.

    Parameters
    ----------
    scene : Scene
        For the tools, and the direction from which a draped charge is seen.
    charge : Path
        Charge file.
    folder : Path
        Folder for the pictures.

    Returns
    -------
    list of Path
        The pictures drawn.

    Raises
    ------
    InputFileError
        If the charge file is missing or broken.
    StorageError
        If the folder cannot be written to.
    """
    particles = read_particles(charge, "charge")
    domain = scene.require("charge").domain
    view = View.against(domain.down) if isinstance(domain, DrapedDomain) else View()
    tools = compile_tools(scene.tooling, scene.directory) if scene.tooling else None
    clearance = (lambda points: tools.clearance(points)[0]) if tools is not None else None
    space = space_of(particles, tools)

    pictures = [folder / f"charge_{name}.png" for name in ("top", "cut", "in_tool")]
    for picture in pictures:
        check_output(picture, [charge])
    draw_top_view(particles, pictures[0], view)
    draw_cut(particles, pictures[1], view, clearance, space)
    reason = draw_in_tool(particles, pictures[2], view, clearance, space)
    if reason is not None:
        print(f"no three-dimensional picture of the charge: {reason}", file=sys.stderr)
        return pictures[:2]
    return pictures


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
    scene: Scene, section: ChargeSection, lattice: Lattice, generator: np.random.Generator, inputs: list[Path]
) -> Frames:
    """Return the frames of all particles, from a file or from the scene alone."""
    choice = section.orientation
    if isinstance(choice, RegionalOrientation):
        return regional_frames(choice, lattice.positions, generator)
    if isinstance(choice, LocalOrientation):
        distance = distance_of(choice.tool, scene.tooling, scene.directory, "charge.orientation.tool")
        return local_frames(distance, lattice.positions, generator)
    if isinstance(choice, FileOrientation):
        return imported_frames(choice, read_points(inputs[0]), lattice.positions)
    if not isinstance(choice, CtOrientation):
        return frames_of(choice, lattice, generator)
    with read_voxels(inputs[0], "orientations") as source:
        if len(inputs) == 1:
            return frames_from_ct(choice, source, lattice.positions, lattice.spacing, generator, name=str(inputs[0]))
        with read_voxels(inputs[1], "volume") as truth:
            if "platelet_id" not in truth.names:
                raise InputFileError(
                    f"{inputs[1]}: no dataset 'platelet_id'; charge.orientation.platelet_ids wants a phantom's volume"
                )
            return frames_from_ct(
                choice, source, lattice.positions, lattice.spacing, generator, truth, name=str(inputs[0])
            )


def _fields(lattice: Lattice, frames: Frames) -> dict[str, np.ndarray]:
    """Return the arrays of the charge file."""
    return {
        "fibre_direction": frames.fibre_direction,
        "in_plane_direction": frames.in_plane_direction,
        "platelet_normal": frames.platelet_normal,
        "volume": lattice.volumes,
        "platelet_id": frames.platelet_id,
        "region_id": frames.region_id,
        "confidence": frames.confidence,
        "orientation_source": frames.source,
    }
