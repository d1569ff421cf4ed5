"""Abaqus element types: which shape they have, which nodes count, and which cannot carry fibres."""

from __future__ import annotations

import re
from dataclasses import dataclass

SOLID = {
    4: ("tetra", 4), 5: ("pyramid", 5), 6: ("wedge", 6), 8: ("hexahedron", 8), 10: ("tetra10", 10),
    15: ("wedge15", 15), 20: ("hexahedron20", 20), 27: ("hexahedron27", 27),
}  # fmt: skip
FLAT = {
    3: ("triangle", 3), 4: ("quad", 4), 6: ("triangle6", 6), 8: ("quad8", 8), 9: ("quad9", 9),
}  # fmt: skip
CORNERS = {"tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8, "triangle": 3, "quad": 4, "vertex": 1}
# The rest of a name says how the element integrates and what else it solves for: R, H, T, P, E, S, W, V, M, I, L.
ENDING = "[A-Z]{0,4}[0-9]?[A-Z]?"
SOLIDS = re.compile(rf"(?:C3D|DC3D|DCC3D|AC3D|Q3D|CSS|SC|EMC3D)([0-9]+){ENDING}")
SHELLS = re.compile(rf"(?:S|DS|M3D|SFM3D|STRI)([0-9]+){ENDING}")
PLANES = re.compile(rf"(?:CPE|CPS|CPEG|DC2D|AC2D)([0-9]+){ENDING}")
PASSED_OVER = re.compile(
    r"T2D|T3D|B2[123]|B3[123]|PIPE|ELBOW|FRAME|ROTARYI|MASS|SPRING|DASHPOT|CONN|GAP|ITS|JOINT|R2D|R3D|RB|RAX|SFM|DCOUP"
    r"|HEATCAP|DC1D|SURFACE|COH|ACIN|CIN|F2D|F3D|DRAG|PSI|TRSHR|USA|LS[36]|WARP|EMC2D|AC1D"
)
NO_MAPPING = {
    "CAX": "axisymmetric elements stand for rings, whose directions are not those of a plane",
    "CGAX": "axisymmetric elements stand for rings, whose directions are not those of a plane",
    "SAX": "axisymmetric elements stand for rings, whose directions are not those of a plane",
    "MAX": "axisymmetric elements stand for rings, whose directions are not those of a plane",
    "DCAX": "axisymmetric elements stand for rings, whose directions are not those of a plane",
    "EC3D": "Eulerian elements do not move with the material",
    "GK": "gasket elements have directions of their own",
    "U": "user elements have a shape that only their subroutine knows",
    "Z": "substructures hold no elements",
}
MID_FACE = {"wedge15": 18}
"""Nodes in mid-face that add nothing to the shape of an element."""


@dataclass(frozen=True)
class Shape:
    """What an element type is.

    Attributes
    ----------
    kind : str
        As meshio and VTK order the nodes; ``vertex`` for a particle.
    nodes : int
        Nodes on a data line at least.
    most : int
        Nodes at most, where Abaqus leaves some open.
    family : {"solid", "shell", "plane", "point"}
    """

    kind: str
    nodes: int
    most: int
    family: str

    @property
    def corners(self) -> int:
        """Number of corner nodes, which come first."""
        return CORNERS[self.kind.rstrip("0123456789")]


def shape_of(type_name: str) -> Shape | str | None:
    """Return the shape of an element type, None for one that holds no fibres, or why it cannot be mapped."""
    name = type_name.upper()
    if name == "PC3D":
        return Shape("vertex", 1, 1, "point")
    for pattern, family, shapes in ((SOLIDS, "solid", SOLID), (SHELLS, "shell", FLAT), (PLANES, "plane", FLAT)):
        found = pattern.fullmatch(name)
        # Of STRI65 and S8R5 the last digit counts degrees of freedom.
        number = 6 if name.startswith("STRI65") else int(found.group(1)) if found else 0
        if found and name.startswith("SFM"):
            return None
        if found and number in shapes:
            kind, nodes = shapes[number]
            if kind == "hexahedron27":
                return Shape(kind, 21, 27, family)
            return Shape(kind, nodes, MID_FACE.get(kind, nodes) if name.startswith("C3D15V") else nodes, family)
    if PASSED_OVER.match(name):
        return None
    for beginning, why in NO_MAPPING.items():
        if name.startswith(beginning):
            return why
    return "it is not known here"


# Of a C3D27 the faces come in another order than VTK's, and the middle first.
FACES_27 = (*range(20), 26, 24, 23, 25, 21, 22, 20)


def vtk_nodes(shape: Shape, nodes: tuple[int, ...]) -> tuple[str, tuple[int, ...]]:
    """Return the kind and the nodes of an element in the order of VTK and meshio."""
    if shape.kind == "hexahedron27":
        if len(nodes) < 27:
            return "hexahedron20", nodes[:20]
        return shape.kind, tuple(nodes[k] for k in FACES_27)
    return shape.kind, nodes[: shape.nodes]
