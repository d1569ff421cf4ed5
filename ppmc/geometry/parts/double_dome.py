"""The double dome: a drafted dome of stadium plan with a flange round its foot.

The papers give no drawing; the shape is inferred from the numbers of particles, the length of the inspection strip
and the alignment reached (A_aa = 0.7). Axes as in D: x1 across, x2 up (closing direction), x3 along the axis, the
middle of the dome over the origin, the punch's flange at x2 = 0.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, model_validator

from ppmc.geometry.parts.part import Part
from ppmc.scene.units import Angle, NonNegativeLength, PositiveLength, PositiveVelocity

if TYPE_CHECKING:
    from ppmc.geometry.parts.meshes.hexahedra import HexMesh

# Depth of punch and die below the flange, out of reach of the charge.
BELOW = 40.0


# A sheet laid over the round ends is pressed together there and gets thicker, by at most about this factor.
SWELLING = 1.5


class DoubleDome(Part):
    """Punch below, die above; the cavity is `thickness` wide everywhere, measured along the normal, at closure."""

    part: Literal["double_dome"] = "double_dome"
    thickness: PositiveLength = 3.0
    """Thickness of the closed cavity."""
    half_width: PositiveLength = 60.0
    """Distance of the wall's foot from the spine, on the punch."""
    depth: PositiveLength = 60.0
    """Height of the dome on the punch."""
    draft: Angle = Field(default=20.0, gt=0.0, lt=60.0)
    """Angle of the wall from the closing direction."""
    flange: PositiveLength = 20.0
    """Width of the flange round the foot."""
    shoulder_radius: NonNegativeLength = 6.0
    """Fillet of the punch between wall and top."""
    foot_radius: NonNegativeLength = 6.0
    """Fillet of the die between wall and flange; the punch's is larger by the thickness."""
    volume: PositiveLength = 221_076.0
    """Volume of the charge, mm^3; the length of the straight part follows from it."""
    charge: Literal["transverse", "axial"] = "transverse"
    """Charge laid across the middle over the full width, or along the axis over the ends too."""
    charge_length: PositiveLength | None = None
    """Length of the charge's sheet along x3; 140 mm (transverse) or 60 mm over both ends of the spine if left out."""
    charge_width: PositiveLength | None = None
    """Width of the charge's sheet; all of the punch's developed width (transverse) or 0.8 of it if left out."""
    closing_speed: PositiveVelocity = 5.0
    """Speed of the die, along -x2."""

    @model_validator(mode="after")
    def _possible(self) -> DoubleDome:
        if self.top_half_width <= 0:
            raise ValueError("the walls meet before they reach the top; take a smaller draft or depth")
        if self.spine <= 0:
            raise ValueError(
                f"the round ends alone take more than the volume of {self.volume:g} mm^3; give a larger volume"
            )
        if self.charge == "transverse" and self.sheet[1] > self.spine:
            raise ValueError(
                f"charge_length {self.sheet[1]:g} mm reaches beyond the straight part of {self.spine:.4g} mm; "
                "shorten it or give `charge: axial`"
            )
        return self

    @property
    def top_half_width(self) -> float:
        """Half width of the flat top of the punch before filleting, mm."""
        return self.half_width - self.depth * math.tan(math.radians(self.draft))

    @property
    def rim(self) -> float:
        """Distance of the flange's edge from the spine, mm."""
        return self.half_width + self.flange

    def surface_profile(self, offset: float) -> tuple[list[list[float]], list[float]]:
        """Return the section of all that lies below the surface `offset` mm above the punch, normal to it.

        Returns
        -------
        corners : list of [distance from the spine, height], mm
        radii : list of float
            Fillet radius at each corner, mm; fillets of all offsets share their centres.
        """
        sine, cosine = math.sin(math.radians(self.draft)), math.cos(math.radians(self.draft))
        wider = offset * (1.0 - sine) / cosine
        corners = [
            [0.0, -BELOW], [self.rim, -BELOW], [self.rim, offset], [self.half_width + wider, offset],
            [self.top_half_width + wider, self.depth + offset], [0.0, self.depth + offset],
        ]  # fmt: skip
        foot = max(self.foot_radius + self.thickness - offset, 0.0) if self.foot_radius else 0.0
        shoulder = self.shoulder_radius + offset if self.shoulder_radius else 0.0
        return corners, [0.0, 0.0, 0.0, foot, shoulder, 0.0]

    @property
    def _section(self) -> tuple[float, float]:
        """Area of half the cavity's section, mm^2, and its moment about the spine, mm^3."""
        from ppmc.geometry.tools.outline import outline_integrals, outline_segments

        upper = outline_integrals(outline_segments(*self.surface_profile(self.thickness)))
        lower = outline_integrals(outline_segments(*self.surface_profile(0.0)))
        return upper[0] - lower[0], upper[1] - lower[1]

    @property
    def spine(self) -> float:
        """Length of the straight part, mm, from volume balance."""
        area, moment = self._section
        return (self.volume - 2.0 * math.pi * moment) / (2.0 * area)

    @property
    def charge_volume(self) -> float:
        """Volume of the charge, mm^3."""
        return self.volume

    @property
    def cavity_volume(self) -> float:
        """Volume of the closed cavity, mm^3 (Pappus for the ends)."""
        area, moment = self._section
        return 2.0 * area * self.spine + 2.0 * math.pi * moment

    @property
    def developed_width(self) -> float:
        """Width of the punch's surface across the straight part, laid flat, mm."""
        from ppmc.geometry.parts.profile import Profile

        return 2.0 * Profile.of(self, 0.0).length

    @property
    def sheet(self) -> tuple[float, float, float]:
        """Width, length and thickness of the charge laid flat, mm; its thickness holds the volume."""
        across = self.charge == "transverse"
        width = self.charge_width or self.developed_width * (1.0 if across else 0.8)
        length = self.charge_length or (140.0 if across else self.spine + 120.0)
        return width, length, self.volume / (width * length)

    @property
    def stroke(self) -> float:
        """Travel of the die, mm: opened so far that the charge fits between walls and between flats."""
        swollen = self.sheet[2] * (1.0 if self.charge == "transverse" else SWELLING)
        excess = max(swollen - self.thickness, 0.0)
        return max(excess, excess / math.sin(math.radians(self.draft)))

    def tooling(self) -> dict[str, dict[str, Any]]:
        """Return punch and die; the die's edge closes the rim of the flange."""
        place = {"origin": [0.0, 0.0, 0.0], "axis": [0.0, 1.0, 0.0], "spine": self.spine, "spine_axis": [0.0, 0.0, 1.0]}
        punch, punch_radii = self.surface_profile(0.0)
        die, die_radii = self.surface_profile(self.thickness)
        return {
            "punch": {"shape": "revolution", "profile": punch, "corner_radii": punch_radii, **place},
            "die": {
                "shape": "revolution",
                "profile": die,
                "corner_radii": die_radii,
                **place,
                "origin": [0.0, self.stroke, 0.0],
                "inside": True,
                "motion": {"velocity": [0.0, -self.closing_speed, 0.0], "travel": self.stroke},
            },
        }

    def charge_domain(self) -> dict[str, Any]:
        """Return the charge: a flat sheet draped over the punch."""
        width, length, thickness = self.sheet
        return {
            "shape": "draped",
            "tool": "punch",
            "centre": [0.0, 0.0, 0.0],
            "down": [0.0, -1.0, 0.0],
            "along": [0.0, 0.0, 1.0],
            "size": [length, width, thickness],
        }

    def regions(self) -> dict[str, dict[str, Any]]:
        """Return top, walls and flanges of the straight part (the papers' five regions), and the two ends."""
        half, top, t = self.spine / 2.0, self.top_half_width, self.thickness
        foot = self.half_width
        high = self.depth + 2.0 * t
        out: dict[str, dict[str, Any]] = {
            "top": {"min": [-top, self.depth - t, -half], "max": [top, high, half]},
            "end_minus": {"min": [-self.rim, -t, -half - self.rim], "max": [self.rim, high, -half]},
            "end_plus": {"min": [-self.rim, -t, half], "max": [self.rim, high, half + self.rim]},
        }
        for name, sign in (("minus", -1.0), ("plus", 1.0)):
            wall, flange = sorted([sign * top, sign * (foot + 2 * t)]), sorted([sign * (foot + 2 * t), sign * self.rim])
            out[f"wall_{name}"] = {"min": [wall[0], t, -half], "max": [wall[1], self.depth, half]}
            out[f"flange_{name}"] = {"min": [flange[0], -t, -half], "max": [flange[1], 2.0 * t, half]}
        return out

    def paths(self) -> dict[str, dict[str, Any]]:
        """Return D's strip of 150 mm along the axis, swept across (D Figs 9 to 11)."""
        strip = {"along": "x3", "sweep": "x1", "length": min(150.0, self.spine), "width": 2.5}
        return {"across": {"kind": "swept", **strip, "start": -self.rim, "stop": self.rim, "points": 64}}

    def material(self) -> dict[str, Any]:
        """Return D's material: anisotropy ratio 116."""
        return {**super().material(), "anisotropy_ratio": 116.0}

    def orientation(self) -> dict[str, Any]:
        """Return planar random orientations about the normals of D's five regions (D, Fig 5).

        The axial charge covers the round ends too, where five normals are too few: it takes the punch's local normals.
        """
        if self.charge == "axial":
            return {"source": "local", "tool": "punch"}
        cosine, sine = math.cos(math.radians(self.draft)), math.sin(math.radians(self.draft))
        normals = {
            "top": [0.0, 1.0, 0.0],
            "wall_minus": [-cosine, sine, 0.0],
            "wall_plus": [cosine, sine, 0.0],
            "flange_minus": [0.0, 1.0, 0.0],
            "flange_plus": [0.0, 1.0, 0.0],
        }
        # Widened from the inspection regions of the closed part to hold all of the charge before closure.
        high, thick, out = self.depth + 2.0 * self.sheet[2], 2.0 * self.sheet[2], self.half_width + 2.0 * self.thickness
        half, top, rim = self.spine / 2.0, self.top_half_width, self.rim
        spans = {
            "top": ((-top, top), (self.depth - self.thickness, high)),
            "wall_minus": ((-out, -top), (0.0, high)),
            "wall_plus": ((top, out), (0.0, high)),
            "flange_minus": ((-rim, -out), (0.0, thick)),
            "flange_plus": ((out, rim), (0.0, thick)),
        }
        regions = {
            name: {"min": [x[0], y[0], -half], "max": [x[1], y[1], half], "normal": normals[name]}
            for name, (x, y) in spans.items()
        }
        return {"source": "regional", "regions": regions}

    def mesh(self, size: float) -> HexMesh:
        """Return a structural mesh of the closed part."""
        from ppmc.geometry.parts.meshes.double_dome import dome_mesh

        return dome_mesh(self, size)
