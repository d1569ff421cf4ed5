"""The ``analysis:`` section: regions and paths to average over, and what the report shows."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from ppmc.scene.base import Name, Section
from ppmc.scene.units import (
    Angle,
    Direction,
    Length,
    LengthVector,
    PositiveLength,
    PositiveLengthVector,
    PositivePressure,
    Time,
)

AxisName = Literal["x1", "x2", "x3"]


class BoxRegion(Section):
    """A box, by two corners along the axes, or by centre and size and then turned at will."""

    shape: Literal["box"] = "box"

    min: LengthVector | None = None
    """Lowest corner (mm)."""

    max: LengthVector | None = None
    """Highest corner (mm)."""

    centre: LengthVector | None = None
    """Centre of a box given by its size (mm)."""

    size: PositiveLengthVector | None = None
    """Edge lengths along axis_1, axis_2 and their cross product (mm)."""

    axis_1: Direction = (1.0, 0.0, 0.0)
    """Direction of the first edge of a box given by its size."""

    axis_2: Direction = (0.0, 1.0, 0.0)
    """Direction near the second edge; its part normal to axis_1 counts."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        corners = self.min is not None and self.max is not None
        sized = self.centre is not None and self.size is not None
        if corners == sized or (corners and (self.centre or self.size)) or (sized and (self.min or self.max)):
            raise ValueError("a box needs either 'min' and 'max', or 'centre' and 'size'")
        if (
            self.min is not None
            and self.max is not None
            and any(b <= a for a, b in zip(self.min, self.max, strict=True))
        ):
            raise ValueError(f"'max' {self.max} must be above 'min' {self.min} in every direction")
        return self


class SlabRegion(Section):
    """The space between two parallel planes."""

    shape: Literal["slab"]

    normal: Direction = (0.0, 0.0, 1.0)
    """Normal of the planes."""

    min: Length
    """Distance of the first plane from the origin along the normal (mm)."""

    max: Length
    """Distance of the second plane (mm)."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.max <= self.min:
            raise ValueError(f"'max' {self.max} must be above 'min' {self.min}")
        return self


class CylinderRegion(Section):
    """A cylinder, a tube or a sector of one."""

    shape: Literal["cylinder"]

    centre: LengthVector
    """Centre at mid-height (mm)."""

    axis: Direction = (0.0, 0.0, 1.0)
    """Direction of the axis."""

    height: PositiveLength
    """Height along the axis (mm)."""

    radius: PositiveLength
    """Outer radius (mm)."""

    inner_radius: Annotated[Length, Field(ge=0)] = 0.0
    """Inner radius of a tube (mm)."""

    start_angle: Angle = 0.0
    """Start of a sector (degrees), counted right-handed about the axis from the reference direction."""

    end_angle: Angle = 360.0
    """End of a sector (degrees)."""

    reference: Direction | None = None
    """Direction of angle zero; the coordinate axis farthest from the cylinder's axis if left out."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.inner_radius >= self.radius:
            raise ValueError(f"'inner_radius' {self.inner_radius} must be below 'radius' {self.radius}")
        if not 0.0 < self.end_angle - self.start_angle <= 360.0 + 1e-9:
            raise ValueError("'end_angle' must be 0 to 360 degrees above 'start_angle'")
        return self


class SphereRegion(Section):
    """A ball."""

    shape: Literal["sphere"]

    centre: LengthVector
    """Centre (mm)."""

    radius: PositiveLength
    """Radius (mm)."""


def _shape_of(value: Any) -> str:
    """Return the tag of a region; a region without a shape is a box."""
    return value.get("shape", "box") if isinstance(value, dict) else getattr(value, "shape", "box")


RegionSection = Annotated[
    Annotated[BoxRegion, Tag("box")]
    | Annotated[SlabRegion, Tag("slab")]
    | Annotated[CylinderRegion, Tag("cylinder")]
    | Annotated[SphereRegion, Tag("sphere")],
    Discriminator(_shape_of),
]


class StraightPath(Section):
    """Equal slices along one axis, averaged over width and thickness (J Figs 13 and 14)."""

    kind: Literal["straight"] = "straight"

    axis: AxisName = "x1"
    """Axis along which to cut."""

    slices: int = Field(default=50, ge=1, le=10_000)
    """Number of equal slices."""

    min: LengthVector | None = None
    """Lowest corner of the box that is cut (mm); the extent of the material if left out."""

    max: LengthVector | None = None
    """Highest corner of the box that is cut (mm); the extent of the material if left out."""


class CirclePath(Section):
    """Sectors around an axis, in cylindrical components r, θ, axis (J Figs 11 and 12: around the hole)."""

    kind: Literal["circle"]

    centre: LengthVector
    """Centre of the circle (mm)."""

    axis: Direction = (1.0, 0.0, 0.0)
    """Axis of the hole."""

    zero: Direction = (0.0, 0.0, -1.0)
    """Direction of θ = 0; below the hole in the bracket."""

    inner_radius: Annotated[Length, Field(ge=0)]
    """Inner radius of the inspected ring (mm)."""

    outer_radius: PositiveLength
    """Outer radius of the inspected ring (mm)."""

    height: PositiveLength
    """Extent along the axis (mm)."""

    points: int = Field(default=72, ge=3, le=3600)
    """Number of inspection regions around."""

    width: Angle | None = Field(default=None, gt=0, le=360)
    """Angle each region spans (degrees); regions just touch if left out, overlap if wider."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.inner_radius >= self.outer_radius:
            raise ValueError(f"'inner_radius' {self.inner_radius} must be below 'outer_radius' {self.outer_radius}")
        return self


class SweptPath(Section):
    """A thin rectangle swept sideways through the whole thickness (D Figs 9 to 11)."""

    kind: Literal["swept"]

    along: AxisName = "x3"
    """Direction of the rectangle's length."""

    sweep: AxisName = "x1"
    """Direction in which it is swept."""

    length: PositiveLength
    """Length of the rectangle (mm), such as 150 mm."""

    width: PositiveLength
    """Width of the rectangle along the sweep (mm)."""

    centre: Length = 0.0
    """Middle of the rectangle in the direction of its length (mm)."""

    start: Length | None = None
    """Where the sweep starts (mm); the extent of the material if left out."""

    stop: Length | None = None
    """Where the sweep ends (mm); the extent of the material if left out."""

    points: int = Field(default=60, ge=2, le=10_000)
    """Number of positions."""

    local: bool = True
    """Show the tensor in local axes a, t, n too, with the surface normal n of each position (D6)."""


class LinePath(Section):
    """Balls or boxes along any line of points, in local axes: along, across, normal."""

    kind: Literal["line"]

    points: list[LengthVector] = Field(min_length=2)
    """Corners of the line (mm)."""

    radius: PositiveLength
    """Radius of the inspection balls (mm)."""

    steps: int = Field(default=50, ge=2, le=10_000)
    """Number of inspection regions, equally spaced along the line."""

    up: Direction = (0.0, 0.0, 1.0)
    """Direction near the local normal, to settle the turn of the local axes about the line."""


def _kind_of(value: Any) -> str:
    """Return the tag of a path; a path without a kind is straight."""
    return value.get("kind", "straight") if isinstance(value, dict) else getattr(value, "kind", "straight")


PathSection = Annotated[
    Annotated[StraightPath, Tag("straight")]
    | Annotated[CirclePath, Tag("circle")]
    | Annotated[SweptPath, Tag("swept")]
    | Annotated[LinePath, Tag("line")],
    Discriminator(_kind_of),
]

View = Literal[
    "fibre_direction",
    "platelet_normal",
    "dominant_direction",
    "iso_surface",
    "platelets",
    "maps",
    "fill_time",
    "knit_line",
    "difference",
]


class CutSection(Section):
    """A plane that opens the part to view; what lies on the normal's side is left out (A Fig 4.4)."""

    point: LengthVector
    """A point of the plane (mm)."""

    normal: Direction
    """Towards the viewer."""


class LaminaSection(Section):
    """Elastic constants of a unidirectional platelet, axis 1 along the fibres."""

    axial_modulus: PositivePressure
    """E1 (Pa)."""

    transverse_modulus: PositivePressure
    """E2 = E3 (Pa)."""

    axial_poisson_ratio: float = Field(gt=-1, lt=1)
    """ν12."""

    transverse_poisson_ratio: float = Field(gt=-1, lt=1)
    """ν23."""

    shear_modulus: PositivePressure
    """G12 = G13 (Pa)."""


class MeshSection(Section):
    """A structural mesh that receives the directions of the input's last state."""

    path: Path
    """Mesh file: Abaqus .inp, Gmsh .msh, .vtu or another that meshio reads; relative to the scene's folder."""

    scale: float = Field(default=1.0, gt=0)
    """Factor from the file's lengths to mm; 1000 for a mesh in metres."""

    method: Literal["nearest", "average"] = "nearest"
    """Nearest neighbour (no averaging of vectors, as in the papers), or the average over each element.

    The average is conservative: every particle goes to the element it lies in, or to the closest one.
    """

    formats: tuple[Literal["vtu", "abaqus", "calculix", "lsdyna", "gmsh"], ...] = ("vtu", "abaqus")
    """What is written: mapped.vtu; element axes to include in an Abaqus (mapped_axes.inp) or CalculiX
    (mapped_axes_ccx.inp) input; elements with axes for LS-DYNA (mapped_axes.k); mapped.msh for Gmsh.

    With abaqus a mesh that is no Abaqus file goes into mapped.inp too.
    """

    empty: Literal["leave", "nearest"] = "leave"
    """Elements without material: left without directions, or given those of the nearest point."""

    lamina: LaminaSection | None = None
    """With it every element also gets its orientation-averaged stiffness."""


class FrontMask(Section):
    """What the flow front is compared with: a volume's mask, or a picture of the part."""

    path: Path
    """Volume file (.vtkhdf) with the field mask, or a picture (PNG, TIFF, ...); relative to the scene's folder."""

    time: Time | None = None
    """Time of the frame to compare (s), such as that of a short shot; the nearest frame counts, the last if left out.
    """

    origin: tuple[Length, Length] = (0.0, 0.0)
    """Lower left corner of a picture, in the two axes it shows (mm)."""

    pixel: PositiveLength = 1.0
    """Edge of a picture's pixel (mm)."""

    material: Literal["bright", "dark"] = "bright"
    """Whether bright or dark pixels of a picture show material."""


class FrontSection(Section):
    """How the space that the flow fills is compared with that of other runs, the measured part, a mask."""

    axis: AxisName = "x3"
    """Axis along which pictures look. Seen along x3, x1 runs to the right and x2 up; along x2 x1 and x3; x1 x2 and x3.
    """

    mask: FrontMask | None = None
    """Mask of the flow front (D Figs 6 and 7)."""


class AnalysisSection(Section):
    """What ``ppmc analyze`` averages and shows."""

    regions: dict[Name, RegionSection] = Field(
        default_factory=dict, examples=[{"interior": {"min": [2, 2, 1], "max": [22, 14, 5]}}]
    )
    """Regions by name; the whole file is always averaged too."""

    path: PathSection | None = None
    """One path of inspection regions; same as an entry 'path' in paths."""

    paths: dict[Name, PathSection] = Field(default_factory=dict)
    """Paths of inspection regions by name. With neither path nor paths, 20 slices along x1."""

    frames: Literal["ends", "all"] = "ends"
    """Time steps of a flow to average: the first and the last, or all."""

    margin: PositiveLength | None = None
    """Distance that the comparison with the phantom's truth keeps from the specimen's faces (mm).

    A tenth of the specimen's smallest extent if left out.
    """

    front: FrontSection = Field(default_factory=FrontSection)
    """Comparison of the filled space with other runs (--compare), the measured part (--moulded), or a mask."""

    views: tuple[View, ...] = ("fibre_direction", "platelet_normal", "maps", "fill_time", "knit_line", "difference")
    """What is drawn in three dimensions.

    Squares of the components of fibre_direction and platelet_normal at start and end (J Figs 7 to 10); the part split
    by dominant direction, as points (dominant_direction) or as closed surfaces (iso_surface, A Fig 4.5); platelets;
    maps of stretch, shear angle and volume; fill_time; knit_line; difference to each other run of the same particles.
    """

    cuts: dict[Name, CutSection] = Field(default_factory=dict)
    """Planes that open the last state, with the squares of the fibre direction on view (A Fig 4.4)."""

    animation: bool = False
    """Draw the filling as a moving picture too (figures/filling.gif)."""

    interactive: bool = False
    """Write scene.html too: the last state to turn and zoom in a browser, without network."""

    mesh: MeshSection | None = None
    """Structural mesh to map the directions to."""

    view_points: int = Field(default=200_000, ge=1000)
    """Most points drawn in a view; larger files are thinned for the pictures only."""

    @property
    def every_path(self) -> dict[str, StraightPath | CirclePath | SweptPath | LinePath]:
        """All paths by name, the default one if the scene gives none."""
        named = {**({"path": self.path} if self.path is not None else {}), **self.paths}
        return named or {"path": StraightPath(slices=20)}
