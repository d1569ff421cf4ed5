"""The stage: charge file in, flow history out. The only place of the solver that names files."""

from pathlib import Path

from ppmc.errors import SceneError
from ppmc.files import Provenance, check_output, read_particles
from ppmc.scene import Scene

SECTIONS = ("tooling", "material", "solver")


def run(scene: Scene, *, input: Path, output: Path, resume: bool = True, max_walltime: float | None = None) -> Path:
    """Compute the flow of a charge between its tools.

    Parameters
    ----------
    scene : Scene
        With sections `tooling`, `material` and `solver`.
    input : Path
        Charge file.
    output : Path
        Flow history to write; until it is complete, ``<stem>.partial<suffix>``, two checkpoints and the live table
        ``<stem>.steps.csv`` stand beside it.
    resume : bool
        Go on from the last checkpoint of the same scene, input and version, if there is one.
    max_walltime : float, optional
        Wall-clock limit, s; the run then stops with a checkpoint.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    SceneError
        If a section is missing, the charge starts inside a tool, has no room in the closed cavity, or is one layer of
        particles thick.
    InputFileError
        If the charge file is missing or damaged.
    NumericalError
        If the flow stops being finite; the state is dumped beside the output.
    StoppedWithCheckpoint
        On SIGTERM or the wall-clock limit.
    """
    from ppmc.solver.setup import check_room, prepare
    from ppmc.solver.simulation import Simulation
    from ppmc.solver.spread import check_layers

    for section in SECTIONS:
        scene.require(section)
    if max_walltime is not None and max_walltime <= 0.0:
        raise SceneError(f"the wall-clock limit must be positive, not {max_walltime} s")
    charge = read_particles(input, "charge")
    check_output(output, [input])
    model, state = prepare(scene, charge)
    check_room(model, charge, input)
    check_layers(model, state, input)
    provenance = Provenance.collect("ppmc.solver", scene, SECTIONS, [input], scene.seed)
    return Simulation(model, state, output, provenance).run(resume, max_walltime)
