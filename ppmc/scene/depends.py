"""What each stage's output depends on: sections, files and seed. The stages note it, the chain compares it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ppmc.scene.scene import Scene
from ppmc.scene.sections.charge import CtOrientation, DrapedDomain, LocalOrientation

FLOW_SECTIONS = ("tooling", "material", "solver")


@dataclass(frozen=True)
class Depends:
    """All that decides the content of one output, apart from the version of ppmc.

    Attributes
    ----------
    creator : str
        The stage, such as ``"ppmc.ct"``.
    sections : tuple of str
        Sections of the scene, or single entries such as ``"name"``.
    inputs : tuple of Path
        Files that are read, those that the sections name among them.
    seed : int or None
        Seed, for stages that draw random numbers.
    """

    creator: str
    sections: tuple[str, ...]
    inputs: tuple[Path, ...] = ()
    seed: int | None = None


def of_phantom(scene: Scene) -> Depends:
    """Return what a synthetic volume depends on."""
    return Depends("ppmc.ct", ("phantom",), (), scene.seed)


def of_ct(scene: Scene, volume: Path) -> Depends:
    """Return what orientations depend on; a phantom tells the platelets' thickness if the section does not."""
    section = scene.require("ct")
    mask = section.mask.path if section.mask is not None else None
    sections = ("ct", "phantom") if section.platelet_thickness is None and scene.phantom is not None else ("ct",)
    return Depends("ppmc.ct", sections, _each_once([volume, scene.locate(mask) if mask else None]))


def of_charge(scene: Scene, orientations: Path | None, volume: Path | None) -> Depends:
    """Return what a charge depends on: the tools too, if it is laid on one or takes directions from one."""
    section = scene.require("charge")
    files: list[Path | None] = []
    named = scene.named_files("charge")
    if isinstance(section.orientation, CtOrientation):
        files = [orientations, volume]
        if volume is not None and section.orientation.platelet_ids is not None:
            unread = scene.locate(section.orientation.platelet_ids)  # the volume given takes its place
            named = [path for path in named if path != unread]
    on_tool = isinstance(section.domain, DrapedDomain) or isinstance(section.orientation, LocalOrientation)
    sections = ("charge", "tooling") if on_tool else ("charge",)
    return Depends("ppmc.charge", sections, _each_once([*files, *named, *scene.named_files(*sections[1:])]), scene.seed)


def of_flow(scene: Scene, charge: Path | None) -> Depends:
    """Return what a flow depends on; a charge without a file is known by its digest."""
    return Depends("ppmc.solver", FLOW_SECTIONS, _each_once([charge, *scene.named_files(*FLOW_SECTIONS)]))


def of_analysis(scene: Scene, given: Iterable[Path | None]) -> Depends:
    """Return what an analysis depends on: tools give normals to local axes, name and description head the report."""
    sections = ("name", "description", "analysis", "tooling")
    return Depends("ppmc.analysis", sections, _each_once([*given, *scene.named_files("analysis", "tooling")]))


def _each_once(paths: Iterable[Path | None]) -> tuple[Path, ...]:
    """Return the paths there are, in their order, none twice."""
    return tuple(dict.fromkeys(Path(path) for path in paths if path is not None))
