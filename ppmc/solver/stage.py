"""The stage: charge file in, flow history out. The only place of the solver that names files."""

from pathlib import Path

from ppmc.announce import announce
from ppmc.errors import SceneError
from ppmc.files import Claim, Provenance, check_output, is_product, one_writer, read_particles
from ppmc.files.verdict import verdict_of
from ppmc.scene import Scene
from ppmc.scene.depends import FLOW_SECTIONS, of_flow


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
    from ppmc.geometry.tools.checks import idle_tools
    from ppmc.solver.run.charge_checks import check_charge
    from ppmc.solver.run.setup import check_room, prepare, spacing_of
    from ppmc.solver.run.simulation import Simulation
    from ppmc.solver.step.spread import check_layers

    for section in FLOW_SECTIONS:
        scene.require(section)
    if max_walltime is not None and max_walltime <= 0.0:
        raise SceneError(f"the wall-clock limit must be positive, not {max_walltime} s")
    charge = read_particles(input, "charge")
    depends = of_flow(scene, input)
    check_output(output, [*depends.inputs, scene.file], is_own=is_product("flow"), force=force)
    model, state = prepare(scene, charge)
    check_charge(charge, spacing_of(charge), input)
    check_room(model, charge, input)
    check_layers(model, state, input)
    reach = float(spacing_of(charge).max())
    for line in idle_tools(model.walls.tools, charge.positions, reach, model.settings.end_time):
        print(line)
    provenance = Provenance.of(scene, depends)
    written = Simulation(model, state, output, provenance).run(resume, max_walltime)
    announce(verdict_of(written), written)
    return written
