"""A flat plaque: a rectangular frame closed by a plate, the charge covering a part of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from pydantic import model_validator

from ppmc.geometry.parts.part import Part
from ppmc.scene.units import NonNegativeLength, PositiveLength, PositiveVelocity

if TYPE_CHECKING:
    from ppmc.geometry.parts.meshes.hexahedra import HexMesh


class Plaque(Part):
    """Rectangular plaque; its thickness follows from the charge, unless it is a short shot."""

    part: Literal["plaque"] = "plaque"
    length: PositiveLength = 100.0
    """Length along x1."""
    width: PositiveLength = 60.0
    """Width along x2."""
    charge_length: PositiveLength = 50.0
    """Length of the charge."""
    charge_width: PositiveLength = 60.0
    """Width of the charge."""
    charge_height: PositiveLength = 6.0
    """Height of the charge."""
    charge_x1: NonNegativeLength | None = None
    """Distance of the charge from the frame at low x1; centred if left out."""
    charge_x2: NonNegativeLength | None = None
    """Distance of the charge from the frame at low x2; centred if left out."""
    short_shot_height: PositiveLength | None = None
    """Height at which the press stops before the frame is full; fills it if left out."""
    closing_speed: PositiveVelocity = 3.0
    """Speed of the upper plate, along -x3."""

    @model_validator(mode="after")
    def _possible(self) -> Plaque:
        x1, x2 = self.charge_origin
        if x1 + self.charge_length > self.length * (1 + 1e-12) or x2 + self.charge_width > self.width * (1 + 1e-12):
            raise ValueError("the charge does not fit into the frame; make it smaller or move it")
        if self.short_shot_height is not None and not self.thickness <= self.short_shot_height < self.charge_height:
            raise ValueError(
                f"short_shot_height must lie between {self.thickness:.4g} mm (full) and the charge's height"
            )
        if self.thickness >= self.charge_height:
            raise ValueError("the charge covers the whole plaque: there is nothing to fill")
        return self

    @property
    def charge_origin(self) -> tuple[float, float]:
        """Lowest x1 and x2 of the charge, mm."""
        x1 = (self.length - self.charge_length) / 2.0 if self.charge_x1 is None else self.charge_x1
        x2 = (self.width - self.charge_width) / 2.0 if self.charge_x2 is None else self.charge_x2
        return x1, x2

    @property
    def charge_volume(self) -> float:
        """Volume of the charge, mm^3."""
        return self.charge_length * self.charge_width * self.charge_height

    @property
    def thickness(self) -> float:
        """Height of the full plaque, mm, from volume balance."""
        return self.charge_volume / (self.length * self.width)

    @property
    def cavity_volume(self) -> float:
        """Volume between frame and plates when the press stops, mm^3."""
        return self.length * self.width * (self.charge_height - self.stroke)

    @property
    def stroke(self) -> float:
        """Travel of the upper plate, mm."""
        return self.charge_height - (self.short_shot_height or self.thickness)

    def tooling(self) -> dict[str, dict[str, Any]]:
        """Return lower plate, frame and moving upper plate."""
        tall = 4.0 * self.charge_height
        return {
            "lower": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]},
            "frame": {
                "shape": "box",
                "center": [self.length / 2.0, self.width / 2.0, self.charge_height / 2.0],
                "size": [self.length, self.width, tall],
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
        """Return the charge, a box."""
        x1, x2 = self.charge_origin
        size = [self.charge_length, self.charge_width, self.charge_height]
        return {"shape": "box", "origin": [x1, x2, 0.0], "size": size}

    def regions(self) -> dict[str, dict[str, Any]]:
        """Return the place of the charge and the two ends that flow fills."""
        x1, x2 = self.charge_origin
        top, end = self.charge_height, x1 + self.charge_length
        out: dict[str, dict[str, Any]] = {
            "charge": {"min": [x1, x2, 0.0], "max": [end, x2 + self.charge_width, top]},
        }
        if x1 > 0:
            out["end_minus"] = {"min": [0.0, 0.0, 0.0], "max": [x1, self.width, top]}
        if end < self.length:
            out["end_plus"] = {"min": [end, 0.0, 0.0], "max": [self.length, self.width, top]}
        return out

    def paths(self) -> dict[str, dict[str, Any]]:
        """Return slices along x1."""
        return {"length": {"kind": "straight", "axis": "x1", "slices": 50}}

    def mesh(self, size: float) -> HexMesh:
        """Return a structural mesh of the full plaque."""
        import numpy as np

        from ppmc.geometry.parts.meshes.hexahedra import divided, grid_quads, swept_bricks

        x, y = divided(0.0, self.length, size=size), divided(0.0, self.width, size=size)
        flat = np.stack([*(g.ravel() for g in np.meshgrid(x, y, indexing="xy"))], axis=1)
        heights = divided(0.0, self.thickness, size=size)
        sections = np.stack([np.column_stack([flat, np.full(len(flat), z)]) for z in heights])
        return swept_bricks(sections, grid_quads(len(y), len(x)))
