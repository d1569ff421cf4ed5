"""Where the directions of a charge come from: the sources of a scene's ``charge.orientation`` as small objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ppmc.api.quantities import Quantity, Vector
from ppmc.scene.loader import make_section
from ppmc.scene.sections import charge as sections

if TYPE_CHECKING:
    from ppmc.api.voxels import Voxels
    from ppmc.charge.stage import Sources
    from ppmc.scene.base import Section
    from ppmc.tools import Tool


class Orientation:
    """A source of directions; the classes below are those there are."""

    seed: int = 0

    def section(self) -> Section:
        """Return the source as a scene's section ``charge.orientation``.

        Raises
        ------
        SceneError
            If a value makes no sense.
        """
        raise NotImplementedError

    @property
    def tools(self) -> dict[str, Any]:
        """Tools that the source looks at, by name."""
        return {}

    @property
    def files(self) -> tuple[Path | None, Path | None]:
        """Files of orientations and of platelet ids."""
        return None, None

    @property
    def digests(self) -> dict[str, str]:
        """Digests of what it reads that is in memory."""
        return {}

    @contextmanager
    def opened(self, section: sections.ChargeSection) -> Iterator[Sources]:
        """Open what the source reads."""
        from ppmc.charge.stage import Sources

        yield Sources()

    def _made(self, model: type[Section], **values: Any) -> Any:
        given = {key: value for key, value in values.items() if value is not None}
        return make_section(model, f"ppmc.{type(self).__name__}", given)


@dataclass(frozen=True)
class Collimated(Orientation):
    """The same direction everywhere.

    Attributes
    ----------
    fibre_direction, platelet_normal : three floats
        p and r, perpendicular; scaled to unit length.
    """

    fibre_direction: Vector = (1.0, 0.0, 0.0)
    platelet_normal: Vector = (0.0, 0.0, 1.0)

    def section(self) -> Section:
        """Return the section; see `Orientation.section`."""
        return self._made(
            sections.UniformOrientation, fibre_direction=self.fibre_direction, platelet_normal=self.platelet_normal
        )


@dataclass(frozen=True)
class PlanarRandom(Orientation):
    """A direction for each particle, drawn uniformly in the plane across a normal.

    Attributes
    ----------
    seed : int
        Of the draws; a scene of this seed draws the same.
    normal : three floats
        Normal r of the plane that holds the fibres.
    """

    seed: int = 0
    normal: Vector = (0.0, 0.0, 1.0)

    def section(self) -> Section:
        """Return the section; see `Orientation.section`."""
        return self._made(sections.PlanarRandomOrientation, normal=self.normal)


@dataclass(frozen=True)
class Platelets(Orientation):
    """Platelets laid at random, layer by layer, by the papers' five steps (A, section 4).

    Attributes
    ----------
    length, width : quantity, or mapping
        Along and across the fibres, mm: one size, ``{"mean": …, "deviation": …}`` or ``{"values": …, "shares": …}``.
    thickness : quantity, optional
        mm; a platelet spans as many particle layers as fit it. One layer if left out.
    seed : int
        Of the draws; a scene of this seed draws the same.
    wall_softness : float
        Share of its cells that a platelet may lose beyond a wall: 0 keeps to the walls, 1 ignores them.
    attempts : int
        Failures in a row after which incomplete platelets are allowed.
    pitch, roll : quantity
        Standard deviations of the angles by which fibres leave the layer's plane, and by which platelets turn about
        them, degrees.
    on_edge : mapping, optional
        Platelets that stand on edge at side walls: ``{"share": …, "depth": …}``.
    """

    length: Quantity
    width: Quantity
    thickness: Quantity | None = None
    seed: int = 0
    wall_softness: float = 0.0
    attempts: int = 1000
    pitch: Quantity = 0.0
    roll: Quantity = 0.0
    on_edge: Mapping[str, Any] | None = None

    def section(self) -> Section:
        """Return the section; see `Orientation.section`."""
        return self._made(
            sections.PlateletsOrientation, length=self.length, width=self.width, thickness=self.thickness,
            wall_softness=self.wall_softness, attempts=self.attempts, pitch=self.pitch, roll=self.roll,
            on_edge=self.on_edge,
        )  # fmt: skip


@dataclass(frozen=True)
class Regional(Orientation):
    """Planar random about the normal of the region that a particle is in (D, Fig 5); the nearest if in none.

    Attributes
    ----------
    regions : mapping of str to mapping
        Boxes by name: ``{"min": (x1, x2, x3), "max": …, "normal": …}``, mm; where they overlap the first counts.
    seed : int
        Of the draws.
    """

    regions: Mapping[str, Mapping[str, Any]]
    seed: int = 0

    def section(self) -> Section:
        """Return the section; see `Orientation.section`."""
        return self._made(sections.RegionalOrientation, regions=self.regions)


@dataclass(frozen=True)
class AlongTool(Orientation):
    """Planar random about a tool's normal at the point of it that is nearest to the particle.

    Attributes
    ----------
    tool : Tool
        At its drawn position; see :mod:`ppmc.tools`.
    seed : int
        Of the draws.
    """

    tool: Tool
    seed: int = 0

    def section(self) -> Section:
        """Return the section; see `Orientation.section`."""
        return self._made(sections.LocalOrientation, tool=next(iter(self.tools)))

    @property
    def tools(self) -> dict[str, Any]:
        """The tool, by name."""
        from ppmc.tools import named

        return named([self.tool])


@dataclass(frozen=True)
class FromFile(Orientation):
    """Directions of the nearest point of a file; never interpolated.

    Attributes
    ----------
    file : str or Path
        CSV, NPZ, VTU or Abaqus .inp file in tool coordinates.
    search_radius : quantity, optional
        How far the point may lie from the particle, mm; any distance if left out.
    """

    file: str | Path
    search_radius: Quantity | None = None

    def section(self) -> Section:
        """Return the section; see `Orientation.section`."""
        return self._made(sections.FileOrientation, file=Path(self.file), search_radius=self.search_radius)

    @contextmanager
    def opened(self, section: sections.ChargeSection) -> Iterator[Sources]:
        """Read the points."""
        from ppmc.charge.stage import opened

        with opened(section, [Path(self.file)]) as sources:
            yield sources


@dataclass(frozen=True)
class FromCT(Orientation):
    """Directions of the nearest voxel of a CT measurement; never interpolated (J, section III.B).

    Attributes
    ----------
    orientations : str, Path or Voxels
        Orientations file, or what :func:`ppmc.orient` or :func:`ppmc.read` gave.
    confidence : float
        Voxels of lower confidence count as having no data.
    search_radius : quantity, optional
        How far the voxel may lie from the particle, mm; the largest lattice spacing if left out.
    fallback : Collimated or PlanarRandom, or "nearest", optional
        What particles without data get; a charge with such particles is refused if left out.
    rotation : mapping, optional
        ``{"axis": …, "angle": …}``: turns CT coordinates into tool coordinates, before the translation.
    translation : three quantities
        mm.
    platelet_ids : str, Path or Voxels, optional
        Volume with the true `platelet_id` of every voxel (a phantom's).
    seed : int
        Of the draws of a fallback.
    """

    orientations: str | Path | Voxels
    confidence: float = 0.0
    search_radius: Quantity | None = None
    fallback: Orientation | str | None = None
    rotation: Mapping[str, Any] | None = None
    translation: Vector = (0.0, 0.0, 0.0)
    platelet_ids: str | Path | Voxels | None = None
    seed: int = 0

    def section(self) -> Section:
        """Return the section; see `Orientation.section`."""
        fallback: Any = self.fallback
        if isinstance(fallback, Orientation):
            fallback = fallback.section()
        elif isinstance(fallback, str):
            fallback = {"source": fallback}
        return self._made(
            sections.CtOrientation, confidence=self.confidence, search_radius=self.search_radius, fallback=fallback,
            rotation=self.rotation, translation=self.translation,
        )  # fmt: skip

    @property
    def files(self) -> tuple[Path | None, Path | None]:
        """Files of orientations and of platelet ids, None for what is in memory or not given."""
        return _file_of(self.orientations), _file_of(self.platelet_ids)

    @property
    def digests(self) -> dict[str, str]:
        """Digests of voxels that no file holds."""
        given = {"orientations": self.orientations, "volume": self.platelet_ids}
        return {
            name: voxels.digest()
            for name, voxels in given.items()
            if voxels is not None and not isinstance(voxels, str | Path) and voxels.path is None
        }

    @contextmanager
    def opened(self, section: sections.ChargeSection) -> Iterator[Sources]:
        """Open the voxels."""
        from ppmc.charge.stage import Sources
        from ppmc.files import read_voxels

        with ExitStack() as stack:

            def voxels(given: str | Path | Voxels | None, product: str) -> Any:
                if given is None:
                    return None
                if isinstance(given, str | Path):
                    return stack.enter_context(read_voxels(Path(given), product))
                return stack.enter_context(given.opened())

            first, second = voxels(self.orientations, "orientations"), voxels(self.platelet_ids, "volume")
            name = "orientations" if self.files[0] is None else str(self.files[0])
            yield Sources(first, second, name=name)


def _file_of(given: str | Path | Voxels | None) -> Path | None:
    """Return the file, if something comes from one."""
    if given is None or isinstance(given, str | Path):
        return None if given is None else Path(given)
    return given.path
