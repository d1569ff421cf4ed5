"""Parametric parts: cavity, tools with motion, charge, inspection regions and a mesh, all from volume balance."""

from ppmc.geometry.parts.center_gated_disk import CenterGatedDisk
from ppmc.geometry.parts.double_dome import DoubleDome
from ppmc.geometry.parts.part import Part
from ppmc.geometry.parts.pin_bracket import PinBracket
from ppmc.geometry.parts.plaque import Plaque

PARTS: dict[str, type[Part]] = {
    "pin_bracket": PinBracket,
    "double_dome": DoubleDome,
    "center_gated_disk": CenterGatedDisk,
    "plaque": Plaque,
}

__all__ = ["PARTS", "CenterGatedDisk", "DoubleDome", "Part", "PinBracket", "Plaque"]
