"""The stage: charge file in, flow history out. The only place of the solver that names files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ppmc.announce import announce
from ppmc.errors import SceneError
from ppmc.files import Claim, ParticleFile, Provenance, check_output, is_product, one_writer, read_particles
from ppmc.files.storage import is_text_with
from ppmc.files.verdict import verdict_of
from ppmc.notices import tell
from ppmc.scene import Scene
from ppmc.scene.depends import FLOW_SECTIONS, of_flow

if TYPE_CHECKING:
    from ppmc.solver.run.records import Record


@one_writer(lambda given: [Claim(given["output"])])
def run(
    scene: Scene,
    *,
    input: Path,
    output: Path,
    resume: bool = True,
    max_walltime: float | None = None,
    force: bool = False,
) -> Path:
    """Compute the flow of a charge between its tools, and say whether the result kept its limits.

    Parameters
    ----------
    scene : Scene
        With sections `tooling`, `material` and `solver`.
    input : Path
        Charge file.
    output : Path
        Flow history to write; until it is complete, the folder ``<stem>.partial`` of frames, two checkpoints and the
        live table ``<stem>.steps.csv`` stand beside it.
    resume : bool
        Go on from the last checkpoint, if there is one; a run of another scene, input or version is refused then.
    max_walltime : float, optional
        Wall-clock limit, s; the run then stops with a checkpoint.
    force : bool
        Replace an output that is no flow of ppmc.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    SceneError
        If a section is missing, an unfinished run at `output` is another one, the charge starts inside a tool, has no
        room in the closed cavity, or is one layer of particles thick.
    InputFileError
        If the charge file is missing or damaged.
    NumericalError
        If the flow stops being finite, or the charge lets go of tools that close on it; the state is dumped beside the
        output.
    StorageError
        If another process is writing the output, or it cannot be written.
    StoppedWithCheckpoint
        On SIGTERM or the wall-clock limit.
    """
    for section in FLOW_SECTIONS:
        scene.require(section)
    if max_walltime is not None and max_walltime <= 0.0:
        raise SceneError(f"the wall-clock limit must be positive, not {max_walltime} s")
    charge = read_particles(input, "charge")
    write(scene, charge, output=output, source=input, resume=resume, max_walltime=max_walltime, force=force)
    announce(verdict_of(output), output)
    return output


def write(
    scene: Scene,
    charge: ParticleFile,
    *,
    output: Path,
    source: Path | None = None,
    resume: bool = True,
    max_walltime: float | None = None,
    force: bool = False,
) -> Path:
    """Compute the flow of a charge and write it; the caller holds the lock of the output, and tells the verdict.

    Parameters
    ----------
    scene, output, resume, max_walltime, force
        As of `run`.
    charge : ParticleFile
        The particles.
    source : Path, optional
        File that `charge` was read from; the flow then carries its digest, else that of the particles.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    PpmcError
        As `run`.
    """
    from ppmc.solver.run.checkpoint import checkpoint_paths, crash_path
    from ppmc.solver.run.history import FIRST_COLUMNS, table_path
    from ppmc.solver.run.records import FileRecord

    kept = [*of_flow(scene, source).inputs, scene.file]
    check_output(output, kept, is_own=is_product("flow"), force=force)
    for path in (*checkpoint_paths(output), crash_path(output)):
        check_output(path, kept, is_own=is_product("checkpoint"), force=force)
    check_output(table_path(output), kept, is_own=is_text_with(FIRST_COLUMNS), force=force)
    record = FileRecord(output, flow_origin(scene, charge, source))
    solve(scene, charge, record, source=str(source or "charge"), resume=resume, max_walltime=max_walltime)
    return output


def flow_origin(scene: Scene, charge: ParticleFile, source: Path | None = None) -> Provenance:
    """Return the origin of the flow of a charge that was read from `source`, or made in memory."""
    made_here = {"charge": charge.digest()} if source is None else {}
    return Provenance.of(scene, of_flow(scene, source), made_here)


def solve(
    scene: Scene,
    charge: ParticleFile,
    record: Record,
    *,
    source: str = "charge",
    resume: bool = False,
    max_walltime: float | None = None,
) -> None:
    """Compute the flow of a charge between its tools, and leave it with a record, in files or in memory.

    Parameters
    ----------
    scene : Scene
        With sections `tooling`, `material` and `solver`.
    charge : ParticleFile
        The particles.
    record : Record
        Takes frames, table of steps and verdict.
    source : str
        Where the charge came from, as messages name it.
    resume, max_walltime
        As of `run`.

    Raises
    ------
    PpmcError
        As `run`.
    """
    from ppmc.geometry.tools.checks import idle_tools
    from ppmc.solver.run.charge_checks import check_charge
    from ppmc.solver.run.setup import check_room, prepare, spacing_of
    from ppmc.solver.run.simulation import Simulation
    from ppmc.solver.step.spread import check_layers

    for section in FLOW_SECTIONS:
        scene.require(section)
    if max_walltime is not None and max_walltime <= 0.0:
        raise SceneError(f"the wall-clock limit must be positive, not {max_walltime} s")
    model, state = prepare(scene, charge)
    check_charge(charge, spacing_of(charge), source)
    check_room(model, charge, source)
    check_layers(model, state, source)
    reach = float(spacing_of(charge).max())
    for line in idle_tools(model.walls.tools, charge.positions, reach, model.settings.end_time):
        tell(line)
    for line in model.material.remarks(charge.positions):
        tell(line)
    Simulation(model, state, record).run(resume, max_walltime)
