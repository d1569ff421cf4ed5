"""The synthetic CT volume of a platelet preform whose fibre directions and normals are known."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ppmc.scene.base import Section
from ppmc.scene.units import (
    Angle,
    LengthVector,
    NonNegativeAngle,
    NonNegativeLength,
    PositiveLength,
    PositiveLengthVector,
)

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class PlateletShape(Section):
    """Size of a platelet."""

    length: PositiveLength
    """Length along the fibres, mm."""

    width: PositiveLength
    """Width across the fibres, mm."""

    thickness: PositiveLength
    """Thickness, mm."""

    @model_validator(mode="after")
    def _is_flat(self) -> Self:
        if self.thickness > min(self.length, self.width):
            raise ValueError("a platelet's thickness must not exceed its length or width")
        return self


class PhantomSection(Section):
    """Synthetic CT of platelets lying in layers in a cavity, for judging the chain against known orientations."""

    cavity: PositiveLengthVector = Field(examples=[["24 mm", "16 mm", "6 mm"]])
    """Edge lengths of the cavity (x, y, z), mm; platelets lie nearly in the x-y plane."""

    origin: LengthVector = (0.0, 0.0, 0.0)
    """Lower corner of the cavity in tool coordinates, mm."""

    voxel_size: PositiveLength | PositiveLengthVector = Field(examples=["0.1 mm"])
    """Edge length of a voxel, mm, one for all axes or one for each (x, y, z)."""

    platelet: PlateletShape
    """Size of the platelets."""

    angles: Literal["uniform"] | list[Angle] = "uniform"
    """In-plane angles of the platelets from the x axis: uniform at random, or drawn from this list, degrees."""

    angle_spread: NonNegativeAngle = 0.0
    """Standard deviation about an angle of the list, degrees."""

    layup: Literal["platelets", "plies"] = "platelets"
    """Platelets thrown at random into each layer, or continuous plies that take the angles of the list in turn."""

    waviness: NonNegativeAngle = 0.0
    """Root mean square slope of the layers out of the x-y plane, degrees; platelets bend along."""

    waviness_length: PositiveLength | None = None
    """Wavelength of the waviness, mm; three platelet lengths unless given."""

    tilt: tuple[Angle, Angle] = (0.0, 0.0)
    """Rotation of the whole stack about x, then about y, degrees."""

    streak_wavelength: PositiveLength | None = None
    """Typical distance between fibre streaks, mm; five voxels unless given."""

    streak_flatness: float = Field(default=1.5, ge=1.0, le=10.0)
    """How many times finer the streaks are through the thickness than in the plane."""

    streak_contrast: float = Field(default=1.0, ge=0.0, le=10.0)
    """Standard deviation of the streaks, in units of the texture that noise is measured against."""

    platelet_contrast: float = Field(default=0.5, ge=0.0, le=10.0)
    """Standard deviation of the mean grey value from platelet to platelet, in the same unit."""

    resin_thickness: NonNegativeLength | None = None
    """Thickness of the resin-rich film between layers, mm; one voxel unless given."""

    resin_contrast: float = Field(default=2.0, ge=0.0, le=10.0)
    """How much darker resin is than the platelets, in the same unit."""

    coverage: float = Field(default=0.99, gt=0.0, le=1.0)
    """Share of each layer that platelets cover; the rest is resin."""

    void_fraction: float = Field(default=0.005, ge=0.0, le=0.2)
    """Share of the volume in voids, flat ellipsoids between layers."""

    void_diameter: PositiveLength | None = None
    """In-plane diameter of a void, mm; twice the platelet thickness unless given. A third as high."""

    void_contrast: float = Field(default=4.0, ge=0.0, le=20.0)
    """How much darker air is than the platelets, in the same unit."""

    blur: NonNegativeLength | None = None
    """Standard deviation of the scanner's blur, mm; 0.6 voxels unless given."""

    noise: float = Field(default=0.3, ge=0.0, le=10.0)
    """Standard deviation of the noise, in the same unit."""

    margin: NonNegativeLength = 0.0
    """Width of the air around the cavity, mm; the mask excludes it."""

    grey_type: Literal["uint8", "uint16", "float32"] = "uint8"
    """Number type of the grey values."""

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Voxel size (x, y, z), mm."""
        h = self.voxel_size
        return h if isinstance(h, tuple) else (h, h, h)

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        for axis, edge, h in zip("xyz", self.cavity, self.spacing, strict=True):
            if edge < 4.0 * h:
                raise ValueError(f"the cavity is only {edge / h:.3g} voxels wide along {axis}; at least 4 are needed")
        if self.layup == "plies" and self.angles == "uniform":
            raise ValueError("layup 'plies' needs a list of angles, for example angles: [0, 45, 90, -45]")
        if isinstance(self.angles, list) and not self.angles:
            raise ValueError("the list of angles is empty; write 'uniform' for random angles")
        return self
