"""The pin bracket of the papers: a base with two upright flanges and a hole moulded into each by a pin.

The papers give no drawing; the charge of 93.5 x 34 x 6 mm follows from 12 layers of 12,716 particles, the closed
height of the base of 2.45 mm from the ram's speed and time, and the height of the hole from volume balance.
Axes as in J: x1 along the base, x2 across, x3 up, flanges normal to x1, hole along x1.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

from pydantic import model_validator

from ppmc.geometry.parts.part import Part
from ppmc.scene.units import NonNegativeLength, PositiveLength, PositiveVelocity

if TYPE_CHECKING:
    from ppmc.geometry.parts.meshes.hexahedra import HexMesh

# How far blocks reach beyond the cavity, so that no edge of theirs but the drawn ones shows in it.
BEYOND = 10.0


class PinBracket(Part):
    """Base, flanges and pin; the ram pushes the base up against the mould and the charge into the flanges."""

    part: Literal["pin_bracket"] = "pin_bracket"
    length: PositiveLength = 93.5
    """Length of base and charge along x1."""
    width: PositiveLength = 34.0
    """Width of base, charge and flanges along x2."""
    charge_height: PositiveLength = 6.0
    """Height of the charge."""
    base_height: PositiveLength = 2.45
    """Height of the base at closure."""
    flange_thickness: PositiveLength = 5.0
    """Thickness of a flange along x1."""
    hole_diameter: PositiveLength = 12.7
    """Diameter of the hole."""
    inset: NonNegativeLength = 15.0
    """Distance of a flange's outer face from the end of the base."""
    flanges: Literal["both", "minus", "plus"] = "both"
    """Flanges at both ends, or at the end of low or high x1 only."""
    top: Literal["round", "square"] = "round"
    """Top of the flanges: half round about the hole, or flat."""
    entry_radius: NonNegativeLength = 0.0
    """Radius of the edges where the base runs into a flange."""
    closing_speed: PositiveVelocity = 3.55
    """Speed of the ram, along +x3."""

    @model_validator(mode="after")
    def _possible(self) -> PinBracket:
        if self.base_height >= self.charge_height:
            raise ValueError(
                f"base_height {self.base_height:g} mm must be below charge_height {self.charge_height:g} mm"
            )
        if self.hole_diameter >= self.width:
            raise ValueError(f"a hole of {self.hole_diameter:g} mm does not fit a width of {self.width:g} mm")
        count = 2 if self.flanges == "both" else 1
        if count * (self.inset + self.flange_thickness) + (count - 1) * 2 * self.entry_radius >= self.length:
            raise ValueError("inset and flange_thickness leave no base between the flanges")
        if self.entry_radius and self.entry_radius > self.inset:
            raise ValueError("entry_radius must not exceed inset")
        lowest = self.hole_height - self.hole_diameter / 2
        if lowest <= self.entry_radius:
            raise ValueError(
                f"volume balance puts the hole's centre {self.hole_height:.3g} mm above the base and its lower edge "
                f"at {lowest:.3g} mm; take a larger charge_height, or thinner, fewer or smaller-holed flanges"
            )
        return self

    @property
    def flange_starts(self) -> tuple[float, ...]:
        """The lowest x1 of each flange, mm."""
        both = (self.inset, self.length - self.inset - self.flange_thickness)
        return both if self.flanges == "both" else both[:1] if self.flanges == "minus" else both[1:]

    @property
    def charge_volume(self) -> float:
        """Volume of the charge, mm^3."""
        return self.length * self.width * self.charge_height

    @property
    def flange_area(self) -> float:
        """Area of one flange, hole taken off, mm^2: what volume balance leaves for it."""
        filled = self.length * self.width * self.base_height
        corner = (1.0 - math.pi / 4.0) * self.entry_radius**2 * self.width
        count = len(self.flange_starts)
        return (self.charge_volume - filled - 2 * count * corner) / (count * self.flange_thickness)

    @property
    def hole_height(self) -> float:
        """Height of the hole's centre above the base, mm, from volume balance."""
        hole = math.pi * self.hole_diameter**2 / 4.0
        above = math.pi * self.width**2 / 8.0 if self.top == "round" else self.width**2 / 2.0
        return (self.flange_area + hole - above) / self.width

    @property
    def flange_height(self) -> float:
        """Height of the flanges above the base, mm; the top is half a width above the hole's centre."""
        return self.hole_height + self.width / 2.0

    @property
    def cavity_volume(self) -> float:
        """Volume of the closed cavity from its dimensions, mm^3."""
        straight = self.width * self.hole_height
        top = math.pi * self.width**2 / 8.0 if self.top == "round" else self.width**2 / 2.0
        flange = (straight + top - math.pi * self.hole_diameter**2 / 4.0) * self.flange_thickness
        corners = 2.0 * (1.0 - math.pi / 4.0) * self.entry_radius**2 * self.width
        return self.length * self.width * self.base_height + len(self.flange_starts) * (flange + corners)

    @property
    def stroke(self) -> float:
        """Travel of the ram, mm."""
        return self.charge_height - self.base_height

    def tooling(self) -> dict[str, dict[str, Any]]:
        """Return cavity walls, the blocks beside and between the flanges, the pin, and the ram.

        The cavity is drawn as the inside of one tunnel along x1 whose roof is the flanges' round top; blocks that
        hang from the roof leave the flanges free.
        """
        w, z, top = self.width, self.charge_height, self.charge_height + self.flange_height
        edge = w / 2.0 if self.top == "round" else 0.0
        tools: dict[str, dict[str, Any]] = {
            "mould": {
                "shape": "extrusion",
                "profile": [[0.0, -BEYOND], [w, -BEYOND], [w, top], [0.0, top]],
                "corner_radii": [0.0, 0.0, edge, edge],
                "axis": [1.0, 0.0, 0.0],
                "first_axis": [0.0, 1.0, 0.0],
                "length": self.length,
                "inside": True,
            }
        }
        starts = self.flange_starts
        gaps = [(-BEYOND, starts[0])]
        gaps += [(a + self.flange_thickness, b) for a, b in pairwise(starts)]
        gaps += [(starts[-1] + self.flange_thickness, self.length + BEYOND)]
        for k, (low, high) in enumerate(gaps):
            tools[f"core_{k + 1}"] = self._core(low, high, z, top + BEYOND)
        tools["pin"] = {
            "shape": "cylinder",
            "center": [self.length / 2.0, w / 2.0, z + self.hole_height],
            "axis": [1.0, 0.0, 0.0],
            "radius": self.hole_diameter / 2.0,
        }
        tools["ram"] = {
            "shape": "plane",
            "point": [0.0, 0.0, 0.0],
            "normal": [0.0, 0.0, 1.0],
            "motion": {"velocity": [0.0, 0.0, self.closing_speed], "travel": self.stroke},
        }
        return tools

    def _core(self, low: float, high: float, bottom: float, top: float) -> dict[str, Any]:
        """Return a block of the mould between x1 = low and high, hanging from the roof."""
        centre = [(low + high) / 2.0, self.width / 2.0, (bottom + top) / 2.0]
        size = [high - low, self.width + 2.0 * BEYOND, top - bottom]
        if self.entry_radius == 0.0:
            return {"shape": "box", "center": centre, "size": size}
        return {"shape": "rounded_box", "center": centre, "size": size, "edge_radius": self.entry_radius}

    def charge_domain(self) -> dict[str, Any]:
        """Return the charge: a box on the ram that touches the mould."""
        return {"shape": "box", "origin": [0.0, 0.0, 0.0], "size": [self.length, self.width, self.charge_height]}

    def orientation(self) -> dict[str, Any]:
        """Return random platelets in the state that J measured in the poured charge (J13)."""
        tilt = {"pitch": 9.5, "roll": 19.5, "on_edge": {"share": 0.9, "depth": 0.5}}
        return {**super().orientation(), **tilt}

    def regions(self) -> dict[str, dict[str, Any]]:
        """Return base, flanges, and the strips above (knit line) and below each hole."""
        w, z, t = self.width, self.charge_height, self.flange_thickness
        hole, radius = z + self.hole_height, self.hole_diameter / 2.0
        out: dict[str, dict[str, Any]] = {"base": {"min": [0.0, 0.0, z - self.base_height], "max": [self.length, w, z]}}
        left, right = w / 2.0 - radius / 2.0, w / 2.0 + radius / 2.0
        for name, start in self._named_flanges():
            low, high, top = start, start + t, z + self.flange_height
            out[f"flange_{name}"] = {"min": [low, 0.0, z], "max": [high, w, top]}
            out[f"above_hole_{name}"] = {"min": [low, left, hole + radius], "max": [high, right, top]}
            out[f"below_hole_{name}"] = {"min": [low, left, z], "max": [high, right, hole - radius]}
        return out

    def paths(self) -> dict[str, dict[str, Any]]:
        """Return J's paths: 50 slices of the base (Figs 13, 14) and round each hole (Figs 11, 12)."""
        z = self.charge_height
        base = {"min": [0.0, 0.0, z - self.base_height], "max": [self.length, self.width, z]}
        out: dict[str, dict[str, Any]] = {"base": {"kind": "straight", "axis": "x1", "slices": 50, **base}}
        for name, start in self._named_flanges():
            out[f"hole_{name}"] = {
                "kind": "circle",
                "centre": [start + self.flange_thickness / 2.0, self.width / 2.0, z + self.hole_height],
                "inner_radius": self.hole_diameter / 2.0,
                "outer_radius": self.width / 2.0,
                "height": self.flange_thickness,
            }
        return out

    def _named_flanges(self) -> list[tuple[str, float]]:
        """Return name and lowest x1 of each flange."""
        names = ("minus", "plus") if self.flanges == "both" else (self.flanges,)
        return list(zip(names, self.flange_starts, strict=True))

    def mesh(self, size: float) -> HexMesh:
        """Return a structural mesh of the closed bracket; entry radii are left out of it."""
        from ppmc.geometry.parts.meshes.pin_bracket import bracket_mesh

        return bracket_mesh(self, size)
