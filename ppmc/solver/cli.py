"""Command `ppmc solve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ppmc.command import command


@command
def solve(
    scene: Path,
    /,
    *,
    input: Path | None = None,
    output: Path | None = None,
    restart: Annotated[bool, Parameter(negative="")] = False,
    force: Annotated[bool, Parameter(negative="")] = False,
    max_walltime: str | None = None,
    threads: int | None = None,
    strict: bool = False,
) -> None:
    """Compute the flow of the charge between the closing tools.

    Writes the flow history: positions, fibre directions, normals, deformation, pressure and forces over time. Ctrl-C,
    SIGTERM and the wall-clock limit leave a checkpoint, and the same command goes on from it; SIGUSR1 writes one
    without stopping. Scalars of every step appear at once in <output stem>.steps.csv. The run ends with a verdict,
    which the file keeps: passed, or each limit that was not kept, with value, time and place.

    Parameters
    ----------
    scene : Path
        Scene file with sections `tooling`, `material` and `solver`.
    input : Path
        Charge file; default runs/<name>/charge.vtkhdf.
    output : Path
        Flow history to write; default runs/<name>/flow.vtkhdf.
    restart : bool
        Start over where an earlier run was stopped. Without it the run goes on from there, and a run of another scene
        or input is refused; a later end_time, other outputs and another analysis make no other run.
    force : bool
        Replace an output that ppmc did not write as a flow.
    max_walltime : str
        Wall-clock limit, seconds or with a unit such as "30 min"; the run stops in time with a checkpoint (exit code
        75).
    threads : int
        Threads to use; all by default. Results do not depend on it.
    strict : bool
        End with exit code 4 if a limit of the verdict was not kept; the file is complete all the same.

    Examples
    --------
    ppmc solve configs/demo.yaml

    ppmc solve configs/bracket.yaml --input charge.vtkhdf --output flow.vtkhdf --max-walltime "4 h" --threads 8

    ppmc solve configs/squeeze.yaml --strict
    """
    from ppmc.scene import load_scene
    from ppmc.scene.paths import run_paths

    loaded = load_scene(scene)
    paths = run_paths(loaded)
    limit = None if max_walltime is None else _seconds(max_walltime)
    if threads is not None:
        from ppmc.compile_cache import use_threads

        use_threads(threads)
    from ppmc.announce import insist
    from ppmc.files.verdict import verdict_of
    from ppmc.solver.stage import run

    written = run(
        loaded,
        input=input or paths.charge,
        output=output or paths.flow,
        resume=not restart,
        max_walltime=limit,
        force=force,
    )
    print(written)
    if strict:
        insist(verdict_of(written), written)


def _seconds(text: str) -> float:
    from pydantic_core import PydanticCustomError

    from ppmc.errors import SceneError
    from ppmc.scene.units import to_base

    try:
        return to_base(float(text) if text.replace(".", "", 1).isdigit() else text, "s")
    except PydanticCustomError as error:
        raise SceneError(f"--max-walltime: {error.message()}") from None
