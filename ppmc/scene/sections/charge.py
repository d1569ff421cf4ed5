"""Scene section `charge`: where the material lies before moulding, in how many particles, and how its fibres point."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from ppmc.scene.base import Name, Section
from ppmc.scene.sections.tooling import CylinderTool, ExtrusionTool, MeshTool, RevolutionTool, RoundedBoxTool
from ppmc.scene.units import (
    Angle,
    Direction,
    LengthVector,
    NonNegativeAngle,
    PositiveLength,
    PositiveLengthVector,
)


def _same_for_all_axes(value: Any) -> Any:
    """Let one spacing stand for all three axes."""
    return value if isinstance(value, list | tuple) else (value, value, value)


if TYPE_CHECKING:
    Spacing = tuple[float, float, float]
else:
    Spacing = Annotated[
        PositiveLengthVector,
        BeforeValidator(_same_for_all_axes),
        WithJsonSchema({
            "anyOf": [{"type": "number"}, {"type": "string"}, {"type": "array", "minItems": 3, "maxItems": 3}],
            "description": "one length for all axes, or three lengths for x1, x2, x3",
        }),
    ]  # fmt: skip


class BoxDomain(Section):
    """A box with edges along the axes; the other domains are the shapes of `tooling`, taken as solids."""

    shape: Literal["box"] = "box"
    origin: LengthVector = (0.0, 0.0, 0.0)
    """Corner of least x1, x2, x3."""
    size: PositiveLengthVector = Field(examples=[["93.5 mm", "34 mm", "6 mm"]])
    """Edge lengths."""


class DrapedDomain(Section):
    """A flat sheet laid onto a tool: formed as a quasi-isotropic membrane, its lower face on the tool.

    The orientation of a draped charge is that of the flat sheet (x1 along it, x2 across, x3 up) and turns with it.
    """

    shape: Literal["draped"]
    tool: str = Field(examples=["punch"])
    """Name of the tool in the scene's `tooling`, at its drawn position."""
    size: PositiveLengthVector = Field(examples=[["140 mm", "200 mm", "6 mm"]])
    """Length along, width across and thickness of the flat sheet."""
    centre: LengthVector = (0.0, 0.0, 0.0)
    """A point of the line on which the sheet's middle comes down."""
    down: Direction = (0.0, 0.0, -1.0)
    """Direction in which the sheet is laid down."""
    along: Direction = (1.0, 0.0, 0.0)
    """Direction of the sheet's length; its part across `down` counts."""
    poisson_ratio: float = Field(default=0.3, ge=0.0, lt=0.95)
    """Poisson's ratio of the quasi-isotropic sheet in its plane."""

    @model_validator(mode="after")
    def _flat(self) -> DrapedDomain:
        if abs(sum(a * b for a, b in zip(self.along, self.down, strict=True))) > 0.999:
            raise ValueError("`along` must not be parallel to `down`")
        return self


def _shape_only(value: Any) -> Any:
    """Refuse keys that mean something for a tool but nothing for a charge."""
    idle = {"motion", "wall", "inside"} & set(value.model_fields_set)
    if idle:
        raise ValueError(f"`{min(idle)}` belongs to a tool, not to the space that the charge fills; leave it out")
    return value


Domain = Annotated[
    BoxDomain | DrapedDomain | RoundedBoxTool | CylinderTool | ExtrusionTool | RevolutionTool | MeshTool,
    Field(discriminator="shape"),
    AfterValidator(_shape_only),
]


class UniformOrientation(Section):
    """The same direction everywhere: a collimated charge."""

    source: Literal["uniform"] = "uniform"
    fibre_direction: Direction = (1.0, 0.0, 0.0)
    """Fibre direction p."""
    platelet_normal: Direction = (0.0, 0.0, 1.0)
    """Platelet normal r, perpendicular to p."""

    @model_validator(mode="after")
    def _perpendicular(self) -> UniformOrientation:
        along = sum(a * b for a, b in zip(self.fibre_direction, self.platelet_normal, strict=True))
        if abs(along) > 1e-6:
            raise ValueError(
                "fibre_direction and platelet_normal must be perpendicular: fibres lie in the platelet's plane "
                f"(their dot product is {along:.3g}); for fibres along x3 give for example platelet_normal: [1, 0, 0]"
            )
        return self


class PlanarRandomOrientation(Section):
    """A direction for each particle, drawn uniformly in the plane across a normal."""

    source: Literal["planar_random"] = "planar_random"
    normal: Direction = (0.0, 0.0, 1.0)
    """Normal r of the plane that holds the fibres."""


class NearestOrientation(Section):
    """The nearest voxel with data, however far away it is."""

    source: Literal["nearest"] = "nearest"


class Turn(Section):
    """A rotation about an axis through the origin, right-handed."""

    axis: Direction
    """Axis of rotation."""
    angle: Angle
    """Angle of rotation."""


class CtOrientation(Section):
    """Directions of the nearest voxel of an orientations file; never interpolated."""

    source: Literal["ct"] = "ct"
    confidence: float = Field(default=0.0, ge=0.0, le=1.0)
    """Voxels of lower confidence count as having no data."""
    search_radius: PositiveLength | None = None
    """How far the voxel may lie from the particle; the largest lattice spacing if left out."""
    fallback: (
        Annotated[UniformOrientation | PlanarRandomOrientation | NearestOrientation, Field(discriminator="source")]
        | None
    ) = None
    """What particles without data get; if left out, a charge with such particles is refused."""
    rotation: Turn | None = None
    """Turns CT coordinates into the directions of tool coordinates, before the translation."""
    translation: LengthVector = (0.0, 0.0, 0.0)
    """Shift from (turned) CT coordinates to tool coordinates."""
    platelet_ids: Path | None = None
    """Volume file that holds the true `platelet_id` of every voxel (a phantom's), relative to the scene."""


class NormalSizes(Section):
    """Sizes drawn from a normal distribution, redrawn below a tenth of the mean and above twice the mean."""

    mean: PositiveLength = Field(examples=["12.7 mm"])
    """Mean."""
    deviation: PositiveLength = Field(examples=["1 mm"])
    """Standard deviation."""


class ListedSizes(Section):
    """A mixture of given sizes."""

    values: list[PositiveLength] = Field(min_length=1, max_length=1000, examples=[["12.7 mm", "25.4 mm"]])
    """The sizes."""
    shares: list[Annotated[float, Field(gt=0)]] | None = None
    """Share of the number of platelets that has each size, in any scale; equal if left out."""

    @model_validator(mode="after")
    def _one_share_each(self) -> ListedSizes:
        if self.shares is not None and len(self.shares) != len(self.values):
            raise ValueError(f"`shares` has {len(self.shares)} entries for {len(self.values)} `values`; give one each")
        return self


def _size_kind(value: Any) -> str:
    """Return which way of giving sizes is meant."""
    keys = value if isinstance(value, dict) else getattr(value, "__pydantic_fields__", {})
    return "listed" if "values" in keys or "shares" in keys else "normal" if keys else "fixed"


Sizes = Annotated[
    Annotated[PositiveLength, Tag("fixed")]
    | Annotated[NormalSizes, Tag("normal")]
    | Annotated[ListedSizes, Tag("listed")],
    Discriminator(_size_kind),
]


class OnEdge(Section):
    """Platelets that stand on edge along the side walls, their normals across the wall (seen in J, Figs 7 and 9)."""

    share: float = Field(gt=0.0, le=1.0)
    """Share of the wall layer that they take."""
    depth: PositiveLength | None = None
    """Thickness of the wall layer; one particle if left out."""


class PlateletsOrientation(Section):
    """Platelets laid at random, layer by layer, by the papers' five steps (A, section 4).

    The bracket charge that was measured by CT (J13) is matched by length 12.7 mm, width 6.35 mm, wall_softness 0.38,
    pitch 9.5 deg, roll 19.5 deg and on_edge {share 0.9, depth 0.5 mm}.
    """

    source: Literal["platelets"] = "platelets"
    length: Sizes = Field(examples=["12.7 mm"])
    """Platelet length along the fibres: one length, `{mean, deviation}` or `{values, shares}`."""
    width: Sizes = Field(examples=["12.7 mm"])
    """Platelet width across the fibres, given as the length."""
    thickness: PositiveLength | None = Field(default=None, examples=["0.14 mm"])
    """Platelet thickness; a platelet spans as many particle layers as fit it, one at least. One if left out."""
    wall_softness: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of its cells that a platelet may lose beyond a wall: 0 keeps to the walls, 1 ignores them."""
    attempts: int = Field(default=1000, ge=1, le=10_000_000)
    """Failures in a row after which incomplete platelets are allowed."""
    pitch: NonNegativeAngle = 0.0
    """Standard deviation of the angle by which fibres leave the layer's plane."""
    roll: NonNegativeAngle = 0.0
    """Standard deviation of the angle by which platelets turn about their fibres."""
    on_edge: OnEdge | None = None
    """Platelets standing on edge at the side walls; none if left out."""


class NormalRegion(Section):
    """A box of particles that share a surface normal."""

    min: LengthVector
    """Lowest corner."""
    max: LengthVector
    """Highest corner."""
    normal: Direction
    """Surface normal of the region."""

    @model_validator(mode="after")
    def _ordered(self) -> NormalRegion:
        if any(b <= a for a, b in zip(self.min, self.max, strict=True)):
            raise ValueError(f"`max` {list(self.max)} must be above `min` {list(self.min)} in every direction")
        return self


class RegionalOrientation(Section):
    """Planar random about the normal of the region a particle is in (D, Fig 5); the nearest region if in none."""

    source: Literal["regional"] = "regional"
    regions: dict[Name, NormalRegion] = Field(min_length=1)
    """Regions by name; where they overlap the first counts."""


class LocalOrientation(Section):
    """Planar random about the tool's normal at the point of it that is nearest to the particle."""

    source: Literal["local"] = "local"
    tool: str = Field(examples=["punch"])
    """Name of the tool in the scene's `tooling`, at its drawn position."""


class FileOrientation(Section):
    """Directions of the nearest point of a file; never interpolated."""

    source: Literal["file"] = "file"
    file: Path = Field(examples=["orientations.csv"])
    """CSV, NPZ, VTU or Abaqus .inp file in tool coordinates, relative to the scene."""
    search_radius: PositiveLength | None = None
    """How far the point may lie from the particle; any distance if left out."""


OrientationSource = Annotated[
    CtOrientation
    | UniformOrientation
    | PlanarRandomOrientation
    | PlateletsOrientation
    | RegionalOrientation
    | LocalOrientation
    | FileOrientation,
    Field(discriminator="source"),
]


class ChargeSection(Section):
    """Particles of the charge and their initial orientations."""

    domain: Domain
    """Space that the charge fills before moulding."""
    spacing: Spacing = Field(examples=["0.5 mm"])
    """Distance between particles, one or one per axis; adjusted so that a whole number fits the domain."""
    layers: int | None = Field(default=None, ge=1, le=100_000, examples=[12])
    """Number of particle layers along x3; takes the place of the third spacing."""
    orientation: OrientationSource
    """Where fibre directions and platelet normals come from."""
