"""The contracts: one table of fields for each product that stages exchange.

A table drives writing, reading, validation, ``ppmc info``, the documentation page and the contract tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Check = Literal["finite", "unit", "unit_or_zero", "positive", "any"]
Where = Literal["voxel", "particle", "region"]

SCHEMA_VERSION = (1, 0)

UNITS = "mm, s, g, Pa (1 Pa = 1 g/(mm s^2)); forces Pa mm^2 = uN"
AXES = (
    "x1, x2, x3 are columns 0, 1, 2 of every vector; voxel arrays are indexed [z, y, x]; "
    "six components of a symmetric tensor are XX, YY, ZZ, XY, YZ, XZ; nine of a full one are row by row"
)


@dataclass(frozen=True)
class Field:
    """One array of a product.

    Attributes
    ----------
    name : str
        Name on disk and in the API.
    dtype : str
        NumPy type on disk; ``"grey"`` stands for uint8, uint16 or float32.
    components : int
        1 for a scalar, 3 for a vector, 6 for a symmetric and 9 for a full second-order tensor.
    unit : str
        Unit, ``"1"`` for none.
    doc : str
        What it is, with the symbol of the papers.
    where : str
        What carries a value: a voxel, a particle or a region.
    check : str
        What a reader verifies: finite values, unit vectors, positive values, or nothing.
    required : bool
        Whether every file of the product has it.
    static : bool
        Whether it has one value for all times.
    """

    name: str
    dtype: str
    components: int
    unit: str
    doc: str
    where: Where
    check: Check = "finite"
    required: bool = True
    static: bool = False


def _voxel(name: str, dtype: str, components: int, unit: str, doc: str, **rest: object) -> Field:
    return Field(name, dtype, components, unit, doc, "voxel", **rest)  # type: ignore[arg-type]


def _particle(name: str, dtype: str, components: int, unit: str, doc: str, **rest: object) -> Field:
    return Field(name, dtype, components, unit, doc, "particle", **rest)  # type: ignore[arg-type]


def _region(name: str, dtype: str, components: int, unit: str, doc: str, **rest: object) -> Field:
    return Field(name, dtype, components, unit, doc, "region", **rest)  # type: ignore[arg-type]


_OPTIONAL: dict[str, object] = {"required": False}
_TRUTH: dict[str, object] = {"check": "unit_or_zero", "required": False}

VOLUME = (
    _voxel("grey", "grey", 1, "1", "grey value of the CT volume"),
    _voxel("mask", "u1", 1, "1", "1 inside the specimen, 0 outside", required=False),
    _voxel("fibre_direction", "f4", 3, "1", "true fibre direction p; zero in resin and voids", **_TRUTH),
    _voxel("platelet_normal", "f4", 3, "1", "true platelet normal r; zero in resin and voids", **_TRUTH),
    _voxel("platelet_id", "i4", 1, "1", "platelet that fills the voxel; -1 in resin and voids", required=False),
)  # fmt: skip

ORIENTATIONS = (
    _voxel("fibre_direction", "f4", 3, "1", "fibre direction p: least grey-value gradient", check="unit"),
    _voxel(
        "platelet_normal", "f4", 3, "1", "platelet normal r: greatest grey-value gradient", check="unit", required=False
    ),
    _voxel("eigenvalues", "f4", 3, "grey^2/mm^2", "eigenvalues of the structure tensor, ascending", required=False),
    _voxel("confidence", "f4", 1, "1", "linearity of p, (l2-l1)/(l2+l1): 1 certain, 0 undefined", required=False),
    _voxel("planarity", "f4", 1, "1", "planarity of r, (l3-l2)/(l3+l2): 1 certain, 0 undefined", required=False),
    _voxel("predicted_error", "f4", 1, "degree", "predicted angular error of p", required=False),
    _voxel("valid", "u1", 1, "1", "1 where the vectors mean something, 0 elsewhere (vectors are then a placeholder)"),
)

CHARGE = (
    _particle("fibre_direction", "f8", 3, "1", "fibre direction p", check="unit"),
    _particle("in_plane_direction", "f8", 3, "1", "in-plane direction q-hat, not parallel to p", check="unit"),
    _particle("platelet_normal", "f8", 3, "1", "platelet normal r = p x q", check="unit"),
    _particle("volume", "f8", 1, "mm^3", "volume of the particle", check="positive"),
    _particle("platelet_id", "i8", 1, "1", "platelet that the particle belongs to; -1 for none"),
    _particle("region_id", "i4", 1, "1", "region that gave the orientation; -1 for none", required=False),
    _particle("confidence", "f8", 1, "1", "confidence of the mapped orientation, 0 to 1", required=False),
    _particle("orientation_source", "i4", 1, "1", "0 default, 1 CT, 2 random, 3 region, 4 drape, 5 given", **_OPTIONAL),
)  # fmt: skip

FLOW = (
    _particle("platelet_id", "i8", 1, "1", "platelet that the particle belongs to; -1 for none", static=True),
    _particle("reference_position", "f8", 3, "mm", "position at the start", static=True),
    _particle("volume", "f8", 1, "mm^3", "volume at the start", check="positive", static=True),
    _particle("fibre_direction", "f8", 3, "1", "fibre direction p", check="unit"),
    _particle("in_plane_direction", "f8", 3, "1", "in-plane direction q-hat", check="unit", required=False),
    _particle("platelet_normal", "f8", 3, "1", "platelet normal r = p x q", check="unit", required=False),
    _particle("shear_angle", "f8", 1, "degree", "platelet shear angle between q-hat and q", required=False),
    _particle("deformation_gradient", "f8", 9, "1", "deformation gradient F since the start"),
    _particle("volume_ratio", "f8", 1, "1", "volume ratio J = det F", check="positive"),
    _particle("packing", "f8", 1, "1", "volume fraction that the particles fill around this one", required=False),
    _particle("velocity", "f8", 3, "mm/s", "velocity"),
    _particle("pressure", "f8", 1, "Pa", "pressure -K(J-1)"),
    _particle("fibre_stress", "f8", 1, "Pa", "deviatoric stress along the fibre, p . tau . p", required=False),
    _particle("strain_rate", "f8", 1, "1/s", "equivalent strain rate sqrt(2/3 D':D')", required=False),
)

ANALYSIS = (
    _region("region_id", "i4", 1, "1", "number of the region, in the order of the scene", static=True),
    _region("fibre_tensor", "f8", 6, "1", "fibre orientation tensor A = <p p>", check="any"),
    _region("normal_tensor", "f8", 6, "1", "normal orientation tensor N = <r r>", check="any"),
    _region("principal_fibre_direction", "f8", 3, "1", "direction of A's largest eigenvalue", check="any"),
    _region("principal_normal_direction", "f8", 3, "1", "direction of N's largest eigenvalue", check="any"),
    _region("particle_count", "i8", 1, "1", "particles in the region"),
    _region("region_volume", "f8", 1, "mm^3", "volume of these particles", check="any"),
)

FIELDS: dict[str, tuple[Field, ...]] = {
    "volume": VOLUME,
    "orientations": ORIENTATIONS,
    "charge": CHARGE,
    "flow": FLOW,
    "analysis": ANALYSIS,
}

MADE_BY = {
    "volume": "ppmc phantom",
    "orientations": "ppmc ct",
    "charge": "ppmc charge",
    "flow": "ppmc solve",
    "analysis": "ppmc analyze",
    "checkpoint": "ppmc solve",
}


def field(product: str, name: str) -> Field:
    """Return the contract of one field.

    Raises
    ------
    KeyError
        If the product has no such field; the message lists those it has.
    """
    for f in FIELDS[product]:
        if f.name == name:
            return f
    raise KeyError(f"product '{product}' has no field '{name}'; it has {', '.join(f.name for f in FIELDS[product])}")
