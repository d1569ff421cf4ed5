"""The section ``tooling``: rigid tools by name, each with a shape, a motion and a wall law.

A tool is a solid; material stays outside it. ``inside: true`` turns a shape round: the material is then kept inside
the shape, which is a cavity or a hole. The drawn position is the position at time zero.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from ppmc.scene.base import Section
from ppmc.scene.units import (
    Angle,
    Direction,
    Length,
    LengthVector,
    NonNegativeLength,
    NonNegativeTime,
    PositiveForce,
    PositiveLength,
    PositiveLengthVector,
    PositiveVelocity,
    Time,
    VelocityVector,
)
from ppmc.walls import Wall
from ppmc.walls.slip import Slip


class FixedMotion(Section):
    """A tool that stays where it is drawn."""

    fixed: Literal[True] = True
    """The tool does not move."""


class VelocityMotion(Section):
    """A tool that moves at a constant velocity, from a start time until it has travelled far enough."""

    velocity: VelocityVector = Field(examples=[["0 mm/s", "0 mm/s", "-3.55 mm/s"]])
    """Velocity, mm/s."""
    start: NonNegativeTime = Field(default=0.0, examples=["0.5 s"])
    """Time at which the tool begins to move, s."""
    travel: PositiveLength | None = Field(default=None, examples=["3.55 mm"])
    """Distance after which the tool stops, mm; without it the tool never stops."""

    @model_validator(mode="after")
    def _moves(self) -> VelocityMotion:
        if self.travel is not None and not any(self.velocity):
            raise ValueError("`travel` asks for a distance but the velocity is zero; drop `travel` or set `velocity`")
        return self


class TableMotion(Section):
    """A tool whose displacement is given at times and runs linearly between them; it rests before and after."""

    times: tuple[Time, ...] = Field(min_length=2, examples=[["0 s", "1 s", "2 s"]])
    """Times in ascending order, s."""
    displacements: tuple[LengthVector, ...] = Field(min_length=2, examples=[[[0, 0, 0], [0, 0, -3], [0, 0, -3.55]]])
    """Displacement from the drawn position at each time, mm."""

    @model_validator(mode="after")
    def _table(self) -> TableMotion:
        if len(self.times) != len(self.displacements):
            raise ValueError(
                f"`times` has {len(self.times)} entries and `displacements` {len(self.displacements)}; give one each"
            )
        for earlier, later in zip(self.times, self.times[1:], strict=False):
            if later <= earlier:
                raise ValueError(f"`times` must ascend, but {later:g} s follows {earlier:g} s")
        return self


class ForceMotion(Section):
    """A tool pushed by a force along a direction, as fast as the material lets it but not faster than `max_speed`."""

    force: PositiveForce = Field(examples=["500 N"])
    """Magnitude of the force on the tool, uN inside (Pa mm^2); write it with a unit."""
    direction: Direction = Field(examples=[[0, 0, -1]])
    """Direction in which the tool is pushed and may move."""
    max_speed: PositiveVelocity = Field(examples=["5 mm/s"])
    """Speed the tool never exceeds, mm/s."""
    travel: PositiveLength | None = Field(default=None, examples=["3.55 mm"])
    """Distance after which the tool meets its stop, mm; without it there is no stop."""


MOTION_KEYS = (("velocity", "velocity"), ("times", "table"), ("displacements", "table"), ("force", "force"))


def _motion_kind(value: Any) -> str | None:
    """Return which motion is meant, from the key that only this motion has."""
    keys = value if isinstance(value, dict) else getattr(value, "__pydantic_fields__", {})
    for key, kind in MOTION_KEYS:
        if key in keys:
            return kind
    # A misspelt key still tells which motion is meant; the message is then about that key.
    for name in map(str, keys):
        for key, kind in MOTION_KEYS:
            if difflib.get_close_matches(name, [key], n=1):
                return kind
    return "fixed"


Motion = Annotated[
    Annotated[FixedMotion, Tag("fixed")]
    | Annotated[VelocityMotion, Tag("velocity")]
    | Annotated[TableMotion, Tag("table")]
    | Annotated[ForceMotion, Tag("force")],
    Discriminator(_motion_kind),
]


class Rotation(Section):
    """A turn about an axis through the tool's own centre or origin."""

    axis: Direction = Field(examples=[[0, 1, 0]])
    """Axis of the turn."""
    angle: Angle = Field(examples=["30 deg"])
    """Angle of the turn, right-handed, degrees."""


class ToolBase(Section):
    """What every tool has besides its shape."""

    motion: Motion = Field(default_factory=FixedMotion, examples=[{"velocity": [0, 0, "-3.55 mm/s"]}])
    """How the tool moves: nothing (fixed), `velocity`, `times` with `displacements`, or `force`."""
    wall: Wall = Field(default_factory=Slip, examples=["slip", {"law": "coulomb", "coefficient": 0.2}])
    """Wall law: `slip` (no traction along the wall), `no_slip`, `{friction: ...}` (Navier), or any by its `law`."""


class PlaneTool(ToolBase):
    """A half-space."""

    shape: Literal["plane"]
    """Kind of tool."""
    point: LengthVector = Field(examples=[[0, 0, "6 mm"]])
    """A point on the plane, mm."""
    normal: Direction = Field(examples=[[0, 0, -1]])
    """Normal that points out of the tool, towards the material."""


class BoxTool(ToolBase):
    """A block, or with ``inside: true`` a box-shaped cavity."""

    shape: Literal["box"]
    """Kind of tool."""
    center: LengthVector = Field(examples=[[0, 0, "3 mm"]])
    """Centre of the box, mm."""
    size: PositiveLengthVector = Field(examples=[["93.5 mm", "34 mm", "6 mm"]])
    """Full side lengths, mm."""
    rotation: Rotation | None = None
    """Turn about the centre."""
    inside: bool = False
    """Keep the material inside the box."""


class RoundedBoxTool(ToolBase):
    """A block with rounded edges and corners, or with ``inside: true`` a cavity with fillets."""

    shape: Literal["rounded_box"]
    """Kind of tool."""
    center: LengthVector = Field(examples=[[0, 0, "3 mm"]])
    """Centre of the box, mm."""
    size: PositiveLengthVector = Field(examples=[["93.5 mm", "34 mm", "6 mm"]])
    """Full side lengths over the flat faces, mm."""
    edge_radius: PositiveLength = Field(examples=["1 mm"])
    """Radius of all edges and corners, mm; at most half the shortest side."""
    rotation: Rotation | None = None
    """Turn about the centre."""
    inside: bool = False
    """Keep the material inside the box."""

    @model_validator(mode="after")
    def _radius_fits(self) -> RoundedBoxTool:
        if self.edge_radius > 0.5 * min(self.size) * (1 + 1e-12):
            raise ValueError(
                f"`edge_radius` {self.edge_radius:g} mm is more than half the shortest side ({min(self.size):g} mm)"
            )
        return self


class CylinderTool(ToolBase):
    """A round pin, or with ``inside: true`` a round hole."""

    shape: Literal["cylinder"]
    """Kind of tool."""
    center: LengthVector = Field(examples=[[0, 0, 0]])
    """Middle of the cylinder's axis, mm."""
    axis: Direction = Field(examples=[[1, 0, 0]])
    """Direction of the axis."""
    radius: PositiveLength = Field(examples=["6.35 mm"])
    """Radius, mm."""
    length: PositiveLength | None = Field(default=None, examples=["20 mm"])
    """Length between the flat ends, mm; without it the cylinder has no ends."""
    edge_radius: NonNegativeLength = Field(default=0.0, examples=["0.5 mm"])
    """Rounding of the two end edges, mm."""
    inside: bool = False
    """Keep the material inside the cylinder."""

    @model_validator(mode="after")
    def _radius_fits(self) -> CylinderTool:
        room = self.radius if self.length is None else min(self.radius, 0.5 * self.length)
        if self.edge_radius > room * (1 + 1e-12):
            raise ValueError(f"`edge_radius` {self.edge_radius:g} mm must not exceed {room:g} mm")
        return self


Point2 = tuple[Length, Length]


class ProfileToolBase(ToolBase):
    """What the tools drawn as an outline share."""

    profile: tuple[Point2, ...] = Field(min_length=3, examples=[[[0, 0], ["20 mm", 0], ["20 mm", "10 mm"]]])
    """Corners of the closed outline (first, second coordinate), mm, in either sense; no corner twice."""
    corner_radii: NonNegativeLength | tuple[NonNegativeLength, ...] = Field(default=0.0, examples=["2 mm"])
    """Fillet radius of all corners, or one for each corner, mm; fillets are exact arcs."""
    inside: bool = False
    """Keep the material inside the shape."""

    @model_validator(mode="after")
    def _outline(self) -> Self:
        for index, corner in enumerate(self.profile):
            if corner == self.profile[index - 1]:
                raise ValueError(
                    f"`profile` corner {index} repeats the one before it; the outline closes by itself, drop one"
                )
        if isinstance(self.corner_radii, tuple) and len(self.corner_radii) != len(self.profile):
            raise ValueError(
                f"`corner_radii` has {len(self.corner_radii)} entries for {len(self.profile)} corners; "
                "give one radius for all corners or one each"
            )
        return self


class ExtrusionTool(ProfileToolBase):
    """An outline swept along a straight axis."""

    shape: Literal["extrusion"]
    """Kind of tool."""
    origin: LengthVector = Field(default=(0.0, 0.0, 0.0), examples=[[0, 0, 0]])
    """Where the outline's (0, 0) lies at the start of the sweep, mm."""
    axis: Direction = Field(examples=[[1, 0, 0]])
    """Direction of the sweep."""
    first_axis: Direction = Field(examples=[[0, 1, 0]])
    """Direction of the outline's first coordinate, normal to `axis`; the second is `axis` x `first_axis`."""
    length: PositiveLength | None = Field(default=None, examples=["20 mm"])
    """Length of the sweep from `origin`, mm; without it the sweep has no ends."""

    @model_validator(mode="after")
    def _axes(self) -> Self:
        _check_normal(self.axis, self.first_axis)
        return self


class RevolutionTool(ProfileToolBase):
    """An outline turned about an axis, or swept round a straight spine and both its ends (a stadium plan).

    The outline's first coordinate is the distance from the axis (or spine), its second the height along the axis.
    """

    shape: Literal["revolution"]
    """Kind of tool."""
    origin: LengthVector = Field(default=(0.0, 0.0, 0.0), examples=[[0, 0, 0]])
    """Where the axis meets height zero (middle of the spine), mm."""
    axis: Direction = Field(examples=[[0, 0, 1]])
    """Direction of the outline's second coordinate."""
    spine: NonNegativeLength = Field(default=0.0, examples=["166.6 mm"])
    """Length of the straight spine, mm; 0 is a body of revolution."""
    spine_axis: Direction = Field(default=(1.0, 0.0, 0.0), examples=[[1, 0, 0]])
    """Direction of the spine, normal to `axis`."""

    @model_validator(mode="after")
    def _half_plane(self) -> Self:
        if self.spine > 0:
            _check_normal(self.axis, self.spine_axis)
        if min(corner[0] for corner in self.profile) < 0:
            raise ValueError("`profile` holds a negative first coordinate; it is a distance from the axis")
        return self


class MeshTool(ToolBase):
    """A closed triangle mesh from a file, turned into a signed distance grid."""

    shape: Literal["mesh"]
    """Kind of tool."""
    file: Path = Field(examples=["tools/ram.stl"])
    """STL, OBJ, PLY or VTU file, relative to the scene."""
    unit: Literal["mm", "m", "cm", "um", "inch"] | None = Field(default=None, examples=["mm"])
    """Unit of the file's coordinates; without it mm is taken, and a size that speaks for another unit is told."""
    scale: float = Field(default=1.0, gt=0)
    """Further factor on the coordinates."""
    origin: LengthVector = Field(default=(0.0, 0.0, 0.0), examples=[[0, 0, 0]])
    """Where the file's origin is put, mm."""
    rotation: Rotation | None = None
    """Turn about the file's origin, before it is put at `origin`."""
    grid_spacing: PositiveLength | None = Field(default=None, examples=["0.5 mm"])
    """Spacing of the distance grid, mm; by default 1/150 of the longest side of the mesh."""
    inside: bool = False
    """The mesh bounds the cavity: keep the material inside it."""


def _check_normal(axis: tuple[float, float, float], other: tuple[float, float, float]) -> None:
    """Refuse two unit directions that are not normal to each other."""
    if abs(sum(a * b for a, b in zip(axis, other, strict=True))) > 1e-6:
        raise ValueError(f"{list(other)} is not normal to `axis` {list(axis)}; choose a direction at a right angle")


SolidTool = BoxTool | RoundedBoxTool | CylinderTool | ExtrusionTool | RevolutionTool | MeshTool


def _shape_of(value: Any) -> Any:
    """Return the shape a tool says it has."""
    return value.get("shape") if isinstance(value, dict) else getattr(value, "shape", None)


Tool = Annotated[
    Annotated[PlaneTool, Tag("plane")]
    | Annotated[BoxTool, Tag("box")]
    | Annotated[RoundedBoxTool, Tag("rounded_box")]
    | Annotated[CylinderTool, Tag("cylinder")]
    | Annotated[ExtrusionTool, Tag("extrusion")]
    | Annotated[RevolutionTool, Tag("revolution")]
    | Annotated[MeshTool, Tag("mesh")],
    Discriminator(
        _shape_of,
        custom_error_type="tool_shape",
        custom_error_message="set `shape` to plane, box, rounded_box, cylinder, extrusion, revolution or mesh",
    ),
]
