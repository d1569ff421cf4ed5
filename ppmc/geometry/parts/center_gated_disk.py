"""The centre-gated disk: a round charge between plates that flows outwards to a rim."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

from pydantic import model_validator

from ppmc.geometry.parts.part import Part
from ppmc.scene.units import PositiveLength, PositiveVelocity

if TYPE_CHECKING:
    from ppmc.geometry.parts.meshes.hexahedra import HexMesh


class CenterGatedDisk(Part):
    """Disk about the x3 axis; its thickness follows from the charge, unless it is a short shot (J, Fig 4)."""

    part: Literal["center_gated_disk"] = "center_gated_disk"
    radius: PositiveLength = 60.0
    """Radius of the rim."""
    charge_radius: PositiveLength = 30.0
    """Radius of the charge."""
    charge_height: PositiveLength = 8.0
    """Height of the charge."""
    short_shot_height: PositiveLength | None = None
    """Height at which the press stops before the rim is reached everywhere; fills the disk if left out."""
    closing_speed: PositiveVelocity = 3.0
    """Speed of the upper plate, along -x3."""

    @model_validator(mode="after")
    def _possible(self) -> CenterGatedDisk:
        if self.charge_radius >= self.radius:
            raise ValueError(f"charge_radius {self.charge_radius:g} mm must be below radius {self.radius:g} mm")
        if self.short_shot_height is not None and not self.thickness <= self.short_shot_height < self.charge_height:
            raise ValueError(
                f"short_shot_height must lie between {self.thickness:.4g} mm (full) and the charge's height"
            )
        return self

    @property
    def charge_volume(self) -> float:
        """Volume of the charge, mm^3."""
        return math.pi * self.charge_radius**2 * self.charge_height

    @property
    def thickness(self) -> float:
        """Height of the full disk, mm, from volume balance."""
        return self.charge_height * (self.charge_radius / self.radius) ** 2

    @property
    def cavity_volume(self) -> float:
        """Volume between plates and rim when the press stops, mm^3."""
        return math.pi * self.radius**2 * (self.charge_height - self.stroke)

    @property
    def stroke(self) -> float:
        """Travel of the upper plate, mm."""
        return self.charge_height - (self.short_shot_height or self.thickness)

    def tooling(self) -> dict[str, dict[str, Any]]:
        """Return lower plate, rim and moving upper plate."""
        return {
            "lower": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]},
            "rim": {
                "shape": "cylinder",
                "center": [0.0, 0.0, 0.0],
                "axis": [0.0, 0.0, 1.0],
                "radius": self.radius,
                "inside": True,
            },
            "ram": {
                "shape": "plane",
                "point": [0.0, 0.0, self.charge_height],
                "normal": [0.0, 0.0, -1.0],
                "motion": {"velocity": [0.0, 0.0, -self.closing_speed], "travel": self.stroke},
            },
        }

    def charge_domain(self) -> dict[str, Any]:
        """Return the charge, an upright cylinder."""
        return {
            "shape": "cylinder",
            "center": [0.0, 0.0, self.charge_height / 2.0],
            "axis": [0.0, 0.0, 1.0],
            "radius": self.charge_radius,
            "length": self.charge_height,
        }

    def orientation(self) -> dict[str, Any]:
        """Return J's collimated charge (Fig 4)."""
        return {"source": "uniform", "fibre_direction": [1.0, 0.0, 0.0], "platelet_normal": [0.0, 0.0, 1.0]}

    def regions(self) -> dict[str, dict[str, Any]]:
        """Return the middle, and sectors of the rest along x1 and x2."""
        base = {"shape": "cylinder", "centre": [0.0, 0.0, self.charge_height / 2.0], "height": self.charge_height}
        ring = {**base, "radius": self.radius, "inner_radius": self.charge_radius}
        return {
            "middle": {**base, "radius": self.charge_radius},
            "along_x1": {**ring, "reference": [1.0, 0.0, 0.0], "start_angle": -22.5, "end_angle": 22.5},
            "along_x2": {**ring, "reference": [1.0, 0.0, 0.0], "start_angle": 67.5, "end_angle": 112.5},
        }

    def paths(self) -> dict[str, dict[str, Any]]:
        """Return slices along x1, and a ring half way out."""
        ring = {
            "inner_radius": 0.4 * self.radius,
            "outer_radius": 0.6 * self.radius,
            "height": 2.0 * self.charge_height,
        }
        return {
            "across": {"kind": "straight", "axis": "x1", "slices": 50},
            "round": {"kind": "circle", "centre": [0, 0, 0], "axis": [0, 0, 1], "zero": [1, 0, 0], **ring},
        }

    def mesh(self, size: float) -> HexMesh:
        """Return a structural mesh of the full disk: a square core and a ring round it."""
        from ppmc.geometry.parts.meshes.disk import disk_mesh

        return disk_mesh(self.radius, self.thickness, size)
