"""The moulding flow as a function call: a charge, tools and a material in, a flow out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ppmc.api.charge import Charge
from ppmc.api.flow import Flow
from ppmc.api.quantities import Quantity
from ppmc.api.session import session, warn
from ppmc.errors import NumericalError, SceneError, VerdictError
from ppmc.scene.loader import make_section
from ppmc.tools import Tool, named

if TYPE_CHECKING:
    from ppmc.files import ParticleFile, SeriesFile
    from ppmc.scene import Scene
    from ppmc.scene.sections.solver import SolverSection


def solve(
    charge: Charge | str | Path, tools: Mapping[str, Tool] | Iterable[Tool], material: Any, *,
    end_time: Quantity | None = None, settings: SolverSection | None = None, output: str | Path | None = None,
    resume: bool = True, max_walltime: float | None = None, force: bool = False, strict: bool = False,
    progress: bool = False, name: str = "flow", **keys: Any,
) -> Flow:  # fmt: skip
    """Compute the flow of a charge between its tools.

    Parameters
    ----------
    charge : Charge, str or Path
        The charge, or its file.
    tools : mapping of str to Tool, or iterable of Tool
        Of :mod:`ppmc.tools`; names head columns of :attr:`Flow.steps`.
    material : material
        Of :mod:`ppmc.materials`.
    end_time : quantity
        Time at which the run ends, s.
    settings : SolverSection, optional
        All keys of a scene's section ``solver`` at once (:class:`ppmc.SolverSettings`), in place of `end_time` and
        `keys`.
    output : str or Path, optional
        Flow file to write while the run goes on, with checkpoints, as ``ppmc solve`` does; the flow is kept in memory
        (about 240 bytes a particle and frame) if left out.
    resume : bool
        With `output`: go on from the last checkpoint, if there is one.
    max_walltime : float, optional
        With `output`: wall-clock limit, s, after which the run stops with a checkpoint.
    force : bool
        With `output`: replace a file that is no flow of ppmc.
    strict : bool
        Refuse a flow that broke a limit of its verdict; without it such a flow gives a warning.
    progress : bool
        Show how far the run has come.
    name : str
        Name of the scene that the flow carries.
    **keys
        Other keys of a scene's section ``solver``: `output_interval`, `integrator`, `smoothing_ratio` …

    Returns
    -------
    Flow
        The same values, bit for bit, in memory and from the file.

    Raises
    ------
    SceneError
        If a value makes no sense, the charge starts inside a tool, has no room in the closed cavity, or is one layer
        of particles thick; with the key, the value and the remedy.
    InputFileError
        If a file is missing or damaged, or particles of the charge lie upon each other.
    NumericalError
        If the flow stops being finite, or the charge lets go of tools that close on it. Without `output` the frames up
        to then are the error's attribute `flow`.
    VerdictError
        If `strict`, and the flow broke a limit; it is the error's attribute `flow`.
    StorageError, StoppedWithCheckpoint
        With `output`, as ``ppmc solve``.

    Warns
    -----
    PpmcWarning
        What the command tells: limits not kept, tools that touch nothing, a charge that is too small for its cavity.

    Notes
    -----
    The method is that of S. G. Favaloro et al., J. Rheol. 62 (2018), doi:10.1122/1.5044533; see the theory page.

    Examples
    --------
    >>> flow = ppmc.solve(charge, [lower, ram], ppmc.materials.Newtonian(shear_viscosity="1 Pa*s"), end_time="1 s")
    >>> flow[-1].A
    """
    scene = _scene(name, tools, material, end_time, settings, keys)
    contents, source = _contents(charge)
    with session(progress):
        if output is None:
            flow = Flow(_in_memory(scene, contents, source))
        else:
            flow = _in_file(scene, contents, source, Path(output), resume, max_walltime, force)
    _judge(flow, strict)
    return flow


def _scene(
    name: str, tools: Mapping[str, Tool] | Iterable[Tool], material: Any, end_time: Quantity | None,
    settings: SolverSection | None, keys: dict[str, Any],
) -> Scene:  # fmt: skip
    """Return the scene of a call."""
    from ppmc.scene import Scene

    solver: Any = {key: value for key, value in keys.items() if value is not None}
    if end_time is not None:
        solver["end_time"] = end_time
    if settings is not None:
        if solver:
            raise SceneError(f"ppmc.solve: give `settings` or {', '.join(f'`{key}`' for key in solver)}, not both")
        solver = settings
    whole = {"name": name, "tooling": named(tools), "material": material, "solver": solver}
    return make_section(Scene, "ppmc.solve", whole)


def _contents(charge: Charge | str | Path) -> tuple[ParticleFile, Path | None]:
    """Return the particles, and the file that they come from."""
    if isinstance(charge, str | Path):
        charge = Charge.read(charge)
    if not isinstance(charge, Charge):
        raise SceneError(f"ppmc.solve: {charge!r} is no charge; make one with ppmc.Charge, or name a charge file")
    return charge.contents, charge.path


def _in_memory(scene: Scene, charge: ParticleFile, source: Path | None) -> SeriesFile:
    """Compute a flow and keep it in memory."""
    from ppmc.solver import stage
    from ppmc.solver.run.records import MemoryRecord

    record = MemoryRecord(stage.flow_origin(scene, charge, source))
    try:
        stage.solve(scene, charge, record, source=str(source or "charge"))
    except NumericalError as error:
        so_far = record.series()
        error.flow = None if so_far is None else Flow(so_far)
        raise
    done = record.series()
    assert done is not None
    return done


def _in_file(
    scene: Scene, charge: ParticleFile, source: Path | None, output: Path, resume: bool, max_walltime: float | None,
    force: bool,
) -> Flow:  # fmt: skip
    """Compute a flow as the command does, and open its file."""
    from ppmc.files.lock import Claim, locked
    from ppmc.solver import stage

    with locked([Claim(output)]):
        stage.write(
            scene, charge, output=output, source=source, resume=resume, max_walltime=max_walltime, force=force
        )  # fmt: skip
    return Flow.read(output)


def _judge(flow: Flow, strict: bool) -> None:
    """Tell a verdict that was not passed."""
    from ppmc.announce import insist

    verdict = flow.verdict
    if verdict is None or verdict.passed:
        return
    if strict:
        try:
            insist(verdict, flow.series.path)
        except VerdictError as error:
            error.flow = flow
            raise
    warn("verdict " + "\n".join(verdict.lines()))
