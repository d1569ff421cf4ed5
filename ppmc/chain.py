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

from ppmc import __version__
from ppmc.errors import InputFileError, SceneError
from ppmc.scene import RunPaths, Scene, run_paths


@dataclass(frozen=True)
class Link:
    """One stage of a chain.

    Attributes
    ----------
    name : str
        Its command.
    sections : tuple of str
        Sections of the scene that decide its output.
    inputs : tuple of Path
        Files it reads.
    output : Path
        File it writes.
    start : callable
        Runs it.
    seeded : bool
        Whether the scene's seed decides its output too.
    """

    name: str
    sections: tuple[str, ...]
    inputs: tuple[Path, ...]
    output: Path
    start: Callable[[], object]
    seeded: bool = False


def links(scene: Scene, paths: RunPaths) -> Iterator[Link]:
    """Yield the stages that a scene describes, in the order in which they run."""
    if scene.phantom is not None:
        yield Link(
            "phantom",
            ("phantom",),
            (),
            paths.volume,
            lambda: _stage("ct").make_phantom(scene, paths.volume),
            seeded=True,
        )
    if scene.ct is not None:
        given = scene.ct.source.path
        volume = scene.locate(given) if given is not None else paths.volume
        yield Link(
            "ct",
            ("ct",),
            (volume,),
            paths.orientations,
            lambda: _stage("ct").run(scene, input=volume, output=paths.orientations),
        )
    if scene.charge is not None:
        from_ct = scene.charge.orientation.source == "ct"
        voxels_in = paths.orientations if from_ct else None
        numbers = paths.volume if from_ct and scene.phantom is not None else None
        yield Link(
            "charge",
            ("charge",),
            tuple(p for p in (voxels_in, numbers) if p is not None),
            paths.charge,
            lambda: _stage("charge").run(scene, input=voxels_in, output=paths.charge, volume=numbers),
            seeded=True,
        )
    if scene.solver is not None:
        yield Link(
            "solve",
            ("tooling", "material", "solver"),
            (paths.charge,),
            paths.flow,
            lambda: _stage("solver").run(scene, input=paths.charge, output=paths.flow),
        )
    if scene.analysis is not None:
        last = paths.flow if scene.solver is not None else paths.charge if scene.charge is not None else None
        volume_truth = paths.volume if scene.phantom is not None else None
        voxels = paths.orientations if scene.ct is not None else None
        main = last or paths.orientations
        named = (scene.analysis.mesh, scene.analysis.front.mask)
        given_files = (scene.locate(section.path) for section in named if section is not None)
        yield Link(
            "analyze",
            ("analysis",),
            tuple(p for p in (main, volume_truth, voxels, *given_files) if p is not None),
            paths.analysis,
            lambda: _stage("analysis").run(
                scene, input=main, output=paths.analysis, volume=volume_truth, orientations=voxels
            ),
        )


def _stage(name: str) -> Any:
    """Import a stage when it is needed."""
    return import_module(f"ppmc.{name}.stage")


def is_current(link: Link, scene: Scene) -> bool:
    """Return whether a stage's output already is what the stage would make.

    That is so if the file is sound and its own record of version, sections, seed and input digests agrees with the
    present ones.
    """
    from ppmc.files import Provenance, file_digest
    from ppmc.files.guard import open_guarded

    if not link.output.exists():
        return False
    try:
        with open_guarded(link.output, None) as file:
            origin = Provenance.load(file)
    except InputFileError:
        return False
    now = scene.resolved()
    return (
        origin.ppmc_version == __version__
        and all(origin.scene.get(s) == now.get(s) for s in link.sections)
        and (not link.seeded or origin.seed == scene.seed)
        and all(p.exists() and origin.inputs.get(p.name) == file_digest(p) for p in link.inputs)
    )


def run_chain(
    scene: Scene,
    *,
    workdir: Path | None = None,
    force: bool = False,
    until: str | None = None,
    only: str | None = None,
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
    VerdictError
        If `strict`, and the flow broke a limit.
    """
    from ppmc.announce import announce, insist
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
    for link in chain:
        if not force and is_current(link, scene):
            print(f"{link.name}: unchanged, {link.output} is kept", file=sys.stderr)
            if link.name == "solve":
                announce(verdict_of(link.output), link.output)
            # Tools that go by the time of files ask for one stage, and must see that it was looked at.
            if only is not None:
                link.output.touch()
            continue
        print(f"{link.name}: writing {link.output}", file=sys.stderr)
        link.start()
    if strict and any(link.name == "solve" for link in chain):
        insist(verdict_of(paths.flow), paths.flow)
    return paths


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
