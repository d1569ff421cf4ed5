"""The scene: one validated description of a whole chain, a section for each stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, PrivateAttr

from ppmc.errors import SceneError
from ppmc.materials import MaterialSection
from ppmc.scene.base import Name, Section
from ppmc.scene.sections.analysis import AnalysisSection
from ppmc.scene.sections.charge import ChargeSection
from ppmc.scene.sections.ct import CtSection
from ppmc.scene.sections.phantom import PhantomSection
from ppmc.scene.sections.solver import SolverSection
from ppmc.scene.sections.tooling import Tool


class Scene(Section):
    """Everything that a chain of stages needs to know; absent sections are stages the scene does not use."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)
    """Name of the scene: letters, digits, dots, dashes; names the folder of its results."""

    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of every random draw; the same seed gives the same files."""

    description: str = ""
    """What the scene is for, shown in the report."""

    phantom: PhantomSection | None = None
    """Synthetic CT volume with known orientations."""

    ct: CtSection | None = None
    """Orientations from a CT volume."""

    charge: ChargeSection | None = None
    """Particles and their initial orientations."""

    tooling: dict[Name, Tool] | None = None
    """Tools by name: shape, motion and wall law."""

    material: MaterialSection | None = None
    """Viscosity of the charge."""

    solver: SolverSection | None = None
    """Time, accuracy and output of the flow simulation."""

    analysis: AnalysisSection | None = None
    """Regions, paths and figures."""

    _directory: Path = PrivateAttr(default_factory=Path)
    _file: Path | None = PrivateAttr(default=None)

    @property
    def directory(self) -> Path:
        """Folder of the scene file, to which relative paths in the scene refer."""
        return self._directory

    def locate(self, path: str | Path) -> Path:
        """Return a path of the scene as seen from the working directory."""
        return Path(path) if Path(path).is_absolute() else self._directory / path

    @property
    def file(self) -> Path | None:
        """The scene file, None if the scene came as text."""
        return self._file

    def named_files(self, *sections: str) -> list[Path]:
        """Return every file that sections name, as seen from the working directory, each once.

        Parameters
        ----------
        *sections : str
            Names of sections, such as ``"tooling"``; those that the scene does not have name nothing.
        """
        found = [path for section in sections for path in _paths_in(getattr(self, section, None))]
        return list(dict.fromkeys(self.locate(path) for path in found))

    def every_named_file(self) -> list[Path]:
        """Return every file that the scene names, and the scene's own: none of them may be replaced."""
        own = [self.file] if self.file is not None else []
        return [*self.named_files(*type(self).model_fields), *own]

    def require(self, section: str) -> Any:
        """Return a section.

        Parameters
        ----------
        section : str
            Name of the section, such as ``"ct"``.

        Raises
        ------
        SceneError
            If the scene does not have it.
        """
        value = getattr(self, section)
        if value is None:
            raise SceneError(f"scene '{self.name}': this stage needs a section '{section}:', and the scene has none")
        return value

    def resolved(self) -> dict[str, Any]:
        """Return the scene with every default written out and every quantity in mm, s, g, Pa, ready for JSON."""
        return self.model_dump(mode="json")


def _paths_in(value: Any) -> Iterator[Path]:
    """Yield the paths in a section, however deep: a new key that names a file is found without being listed here."""
    if isinstance(value, Path):
        yield value
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _paths_in(getattr(value, name))
    elif isinstance(value, Mapping):
        for inner in value.values():
            yield from _paths_in(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _paths_in(inner)
