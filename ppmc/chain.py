"""The chain of stages: which file feeds which stage, and which stages a scene has to run again.

This is the only module that knows all stages; each is imported when its turn comes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from ppmc.errors import InputFileError, SceneError
from ppmc.scene import RunPaths, Scene, run_paths
from ppmc.scene.depends import Depends, of_analysis, of_charge, of_ct, of_flow, of_phantom


@dataclass(frozen=True)
class Link:
    """One stage of a chain.

    Attributes
    ----------
    name : str
        Its command.
    depends : Depends
        What decides its output.
    output : Path
        File it writes.
    start : callable
        Runs it, with the options `force` and `restart`.
    """

    name: str
    depends: Depends
    output: Path
    start: Callable[[bool, bool], object]

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Files it reads."""
        return self.depends.inputs


def links(scene: Scene, paths: RunPaths) -> Iterator[Link]:
    """Yield the stages that a scene describes, in the order in which they run."""
    if scene.phantom is not None:
        yield Link(
            "phantom",
            of_phantom(scene),
            paths.volume,
            lambda force, _: _stage("ct").make_phantom(scene, paths.volume, force=force),
        )
    if scene.ct is not None:
        given = scene.ct.source.path
        volume = scene.locate(given) if given is not None else paths.volume
        yield Link(
            "ct",
            of_ct(scene, volume),
            paths.orientations,
            lambda force, _: _stage("ct").run(scene, input=volume, output=paths.orientations, force=force),
        )
    if scene.charge is not None:
        from_ct = scene.charge.orientation.source == "ct"
        voxels_in = paths.orientations if from_ct else None
        numbers = paths.volume if from_ct and scene.phantom is not None else None
        yield Link(
            "charge",
            of_charge(scene, voxels_in, numbers),
            paths.charge,
            lambda force, _: _stage("charge").run(
                scene, input=voxels_in, output=paths.charge, volume=numbers, force=force
            ),
        )
    if scene.solver is not None:
        yield Link(
            "solve",
            of_flow(scene, paths.charge),
            paths.flow,
            lambda force, restart: _stage("solver").run(
                scene, input=paths.charge, output=paths.flow, resume=not (force or restart), force=force
            ),
        )
    if scene.analysis is not None:
        last = paths.flow if scene.solver is not None else paths.charge if scene.charge is not None else None
        volume_truth = paths.volume if scene.phantom is not None else None
        voxels = paths.orientations if scene.ct is not None else None
        main = last or paths.orientations
        yield Link(
            "analyze",
            of_analysis(scene, (volume_truth, voxels, main)),
            paths.analysis,
            lambda force, _: _stage("analysis").run(
                scene, input=main, output=paths.analysis, volume=volume_truth, orientations=voxels, force=force
            ),
        )


def _stage(name: str) -> Any:
    """Import a stage when it is needed."""
    return import_module(f"ppmc.{name}.stage")


def is_current(link: Link, scene: Scene) -> bool:
    """Return whether a stage's output already is what the stage would make.

    That is so if everything that decides it, files that the scene names included, has the digest that the output
    notes, and the output itself and what was written with it are still as they were written.
    """
    from ppmc.files import Provenance, file_digest
    from ppmc.files.describe import verify_file
    from ppmc.files.guard import open_guarded
    from ppmc.files.text import read_json

    if not link.output.is_file() or not all(path.exists() for path in link.inputs):
        return False
    try:
        with open_guarded(link.output, None) as file:
            origin = Provenance.load(file)
            beside = read_json(file["ppmc"], "extra").get("files", {})
        if origin.key != Provenance.of(scene, link.depends).key:
            return False
        verify_file(link.output)
    except (InputFileError, OSError):
        return False
    folder = link.output.parent
    return all((folder / name).is_file() and file_digest(folder / name) == noted for name, noted in beside.items())


def run_chain(
    scene: Scene,
    *,
    workdir: Path | None = None,
    force: bool = False,
    until: str | None = None,
    only: str | None = None,
    restart: bool = False,
    strict: bool = False,
) -> RunPaths:
    """Run every stage that a scene describes, but skip those whose output is current.

    Parameters
    ----------
    scene : Scene
        The scene.
    workdir : Path, optional
        Folder of the results; ``runs/<scene name>`` by default.
    force : bool
        Run all stages anew.
    until : str, optional
        Name of the last stage to run.
    only : str, optional
        Name of the one stage to run; the files it reads must be there.
    restart : bool
        Let an unfinished flow start over instead of going on.
    strict : bool
        Refuse a flow that broke a limit of its verdict, once all is written.

    Returns
    -------
    RunPaths
        The files.

    Raises
    ------
    SceneError
        If the scene has no stage, or none of the name asked for.
    StorageError
        If another process is running the chain in this folder.
    VerdictError
        If `strict`, and the flow broke a limit.
    """
    from ppmc.announce import insist
    from ppmc.files.lock import Claim, locked
    from ppmc.files.verdict import verdict_of

    paths = run_paths(scene, workdir)
    chain = list(links(scene, paths))
    names = [link.name for link in chain]
    if not chain:
        raise SceneError(f"scene '{scene.name}' describes no stage; give it a section such as 'charge:'")
    for asked in (until, only):
        if asked is not None and asked not in names:
            raise SceneError(f"scene '{scene.name}' has no stage '{asked}'; it has {', '.join(names)}")
    if only is not None:
        chain = [link for link in chain if link.name == only]
    elif until is not None:
        chain = chain[: names.index(until) + 1]
    # Jobs of a workflow each run one stage, at the same time if they can; a whole chain wants the folder for itself.
    with locked([Claim(paths.directory / "chain.run", shared=only is not None)]):
        _walk(chain, scene, force=force, restart=restart, touch=only is not None)
    if strict and any(link.name == "solve" for link in chain):
        insist(verdict_of(paths.flow), paths.flow)
    return paths


def _walk(chain: list[Link], scene: Scene, *, force: bool, restart: bool, touch: bool) -> None:
    """Run stages one after the other."""
    from ppmc.announce import announce
    from ppmc.files.lock import Claim, locked
    from ppmc.files.verdict import verdict_of

    for link in chain:
        # Before the stage is loaded, which takes longer than to find that another process is at work on its output.
        beside = [link.output.with_name("report.html")] if link.name == "analyze" else []
        with locked([Claim(path) for path in (link.output, *beside)]):
            if force or not is_current(link, scene):
                print(f"{link.name}: writing {link.output}", file=sys.stderr)
                link.start(force, restart)
                continue
            print(f"{link.name}: unchanged, {link.output} is kept", file=sys.stderr)
            _tidy(link)
            if link.name == "solve":
                announce(verdict_of(link.output), link.output)
            # Tools that go by the time of files ask for one stage, and must see that it was looked at.
            if touch:
                link.output.touch()


def _tidy(link: Link) -> None:
    """Remove what a run needed to go on that was killed between its last two moments: it has come to its end."""
    if link.name in ("solve", "analyze"):
        from ppmc.files.growing import growing_folder, remove_growing

        remove_growing(growing_folder(link.output))
    if link.name == "solve" and any(link.output.parent.glob("*.h5ckpt")):
        import_module("ppmc.solver.run.checkpoint").remove_checkpoints(link.output)


def check_scene(scene: Scene) -> list[str]:
    """Return what a scene would do, stage by stage, and what its physics says; nothing is run or written.

    Each stage that has something to say offers ``ppmc.<stage>.check`` with ``findings(scene)``, a list of lines.

    Raises
    ------
    SceneError
        If a stage finds the scene impossible.
    """
    lines = [f"scene '{scene.name}': valid"]
    packages = {"phantom": None, "ct": "ct", "charge": "charge", "solve": "solver", "analyze": "analysis"}
    for link in links(scene, run_paths(scene)):
        lines.append(f"{link.name}: {', '.join(str(p) for p in link.inputs) or 'scene'} -> {link.output}")
        package = packages[link.name]
        if package is None:
            continue
        try:
            module = import_module(f"ppmc.{package}.check")
        except ModuleNotFoundError as error:
            if error.name != f"ppmc.{package}.check":
                raise
            continue
        lines += [f"  {text}" for text in module.findings(scene)]
    return lines
