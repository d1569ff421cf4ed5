"""Volume balance of parts whose tools have closed, and width, length and volume of draped charges.

    python pipelines/benchmarks/charge_shapes.py closure
    python pipelines/benchmarks/charge_shapes.py drape

`closure` measures the space that the closed tools leave by their signed distances on a grid and compares it to the
charge; nothing of the part's own formulas enters but its tools. `drape` measures lattice lines of the formed sheet, and
adds up the volumes of the hexahedra between its particles.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from ppmc.charge.domains.drape import drape, flat_sheet
from ppmc.charge.orientations.surface_normals import distance_of
from ppmc.geometry.cavity.cavity import cavity_volume
from ppmc.geometry.parts import CenterGatedDisk, DoubleDome, Part, PinBracket, Plaque
from ppmc.geometry.parts.meshes.hexahedra import HexMesh, grid_quads
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.sections.charge import DrapedDomain
from ppmc.scene.sections.tooling import Tool

TOOLING = TypeAdapter(dict[str, Tool])
PARTS: dict[type[Part], list[dict[str, Any]]] = {
    PinBracket: [
        {},
        {"hole_diameter": 9.525},
        {"flange_thickness": 4},
        {"flange_thickness": 6, "top": "square"},
        {"flanges": "minus", "flange_thickness": 10, "entry_radius": 2},
        {"entry_radius": 1.5, "base_height": 2, "length": 80, "inset": 20},
        {"width": 25, "charge_height": 5, "base_height": 3, "hole_diameter": 8},
    ],
    DoubleDome: [
        {},
        {"thickness": 2, "draft": 30, "depth": 40},
        {"shoulder_radius": 10, "foot_radius": 3},
        {"thickness": 4, "volume": 287_335},
        {"half_width": 40, "depth": 30, "flange": 10, "volume": 120_000, "charge_length": 60},
    ],
    CenterGatedDisk: [{}, {"radius": 80, "charge_height": 12}],
    Plaque: [{}, {"charge_x1": 0, "charge_width": 40}],
}
SHEETS: list[dict[str, Any]] = [
    {},
    {"charge_width": 200},
    {"charge": "axial"},
    {"charge": "axial", "charge_width": 150},
    {"charge": "axial", "charge_width": 220, "charge_length": 250},
    {"charge": "axial", "draft": 40, "depth": 40},
]


def named(keys: dict[str, Any]) -> str:
    """Return the dimensions that are not the default."""
    return ", ".join(f"{k} {v}" for k, v in keys.items()) or "default"


def closure() -> None:
    """Compare the free space between closed tools to the charge."""
    for kind, sets in PARTS.items():
        for keys in sets:
            part = kind.model_validate(keys)
            tools = compile_tools(TOOLING.validate_python(part.tooling()))
            cavity = cavity_volume(tools, part.mesh(6.0).centres(), part.closing_time)
            off = cavity.volume / part.charge_volume - 1.0
            print(
                f"{kind.__name__}, {named(keys)}: charge {part.charge_volume:.1f} mm^3, "
                f"cavity {cavity.volume:.1f} mm^3, {off:+.4%}{'' if cavity.closed else ', OPEN'}",
                flush=True,
            )


def formed(part: DoubleDome) -> str:
    """Return the figures of one draped charge."""
    domain = DrapedDomain.model_validate(part.charge_domain())
    distance = distance_of("punch", TOOLING.validate_python(part.tooling()), Path(), "charge.domain.tool")
    sheet = flat_sheet(domain, (2.0, 2.0, 1.0), None)
    draped = drape(domain, sheet, distance)
    n3, n2, n1 = sheet.shape
    places = draped.positions.reshape(n3, n2, n1, 3)
    width, length, _ = part.sheet
    widths = np.linalg.norm(np.diff(places, axis=1), axis=-1).sum(axis=1).mean(axis=0) / (width * (n2 - 1) / n2)
    lengths = np.linalg.norm(np.diff(places, axis=2), axis=-1).sum(axis=2).mean(axis=0) / (length * (n1 - 1) / n1)
    quads = grid_quads(n2, n1)
    layers = np.arange(n3 - 1)[:, None, None] * n1 * n2
    bricks = np.concatenate([quads + layers, quads + layers + n1 * n2], axis=2).reshape(-1, 8)
    flat = np.prod([size * (n - 1) / n for size, n in zip(domain.size, (n1, n2, n3), strict=True)])
    volume = HexMesh(draped.positions, bricks).volumes().sum() / flat
    return (
        f"width {widths.mean():.4f} (middle {widths[n1 // 2]:.4f}, from {widths.min():.3f} to {widths.max():.3f}), "
        f"length {lengths.mean():.4f}, volume {volume:.4f}, "
        f"area of the middle {draped.notes['least_areal_stretch']:.2f} to {draped.notes['largest_areal_stretch']:.2f}"
    )


def draped_sheets() -> None:
    """Measure draped charges of double domes, over the flat sheets."""
    for keys in SHEETS:
        print(f"{named(keys)}: {formed(DoubleDome.model_validate(keys))}", flush=True)


if __name__ == "__main__":
    questions = {"closure": closure, "drape": draped_sheets}
    for question in sys.argv[1:] or questions:
        questions[question]()
