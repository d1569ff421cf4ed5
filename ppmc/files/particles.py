"""Particle products without time: the charge."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.files import vtkhdf
from ppmc.files.digests import digest, put_digest
from ppmc.files.fields import FIELDS, Field
from ppmc.files.fields import field as spec_of
from ppmc.files.guard import (
    check_layout,
    check_not_parallel,
    check_orthogonal,
    check_unchanged,
    check_values,
    compare_whole,
    dataset_of,
    group_of,
    open_guarded,
)
from ppmc.files.hdf5_output import new_hdf5
from ppmc.files.provenance import Provenance
from ppmc.files.text import put_attribute, put_json, read_json

POSITION = Field("position", "f8", 3, "mm", "position", "particle")


@dataclass(frozen=True)
class ParticleFile:
    """A particle product, read whole and verified.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        Positions, mm.
    fields : dict of str to ndarray, shape (n[, components])
        The fields of the contract that the file has.
    extra : dict
        Further facts about the whole, such as the lattice spacing.
    provenance : Provenance
        Origin of the file.
    """

    positions: NDArray[np.float64]
    fields: dict[str, NDArray[Any]]
    extra: dict[str, Any] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=lambda: Provenance("unknown"))

    def digest(self) -> str:
        """Return a digest of positions, fields and facts, for those that no file holds."""
        parts = [digest(self.positions), *(f"{name} {digest(self.fields[name])}" for name in sorted(self.fields))]
        return hashlib.sha256("\n".join([*parts, json.dumps(self.extra, sort_keys=True)]).encode()).hexdigest()


def write_particles(
    path: Path,
    product: str,
    positions: NDArray[np.floating],
    fields: Mapping[str, NDArray[Any]],
    *,
    provenance: Provenance,
    extra: Mapping[str, Any] | None = None,
) -> None:
    """Write a particle product.

    Parameters
    ----------
    path : Path
        The file to make.
    product : str
        ``"charge"``.
    positions : ndarray, shape (n, 3)
        Positions, mm.
    fields : mapping of str to ndarray, shape (n[, components])
        The fields of the product's contract; required ones must be there.
    provenance : Provenance
        Origin of the file.
    extra : mapping, optional
        Further facts, anything that JSON can hold.

    Raises
    ------
    StorageError
        If the file cannot be written.
    ValueError
        If a required field is missing or has the wrong shape.
    """
    missing = [f.name for f in FIELDS[product] if f.required and f.name not in fields]
    if missing:
        raise ValueError(f"product '{product}' needs {', '.join(missing)}")
    n = len(positions)
    with new_hdf5(path) as new:
        file = new.file
        root = vtkhdf.begin(file, "PolyData")
        data = vtkhdf.points_header(root, n)
        points = vtkhdf.as_stored(positions, POSITION, (n,))
        put_digest(root.create_dataset("Points", data=points), points)
        put_attribute(root["Points"], "unit", "mm")
        for name, values in fields.items():
            vtkhdf.put(data, spec_of(product, name), values, (n,), provenance.creator)
        provenance.store(file, product)
        put_json(file["ppmc"], "extra", dict(extra or {}))


def read_particles(path: Path, product: str) -> ParticleFile:
    """Read a particle product and verify it against its contract.

    Parameters
    ----------
    path : Path
        The file.
    product : str
        ``"charge"``.

    Raises
    ------
    InputFileError
        If the file is missing or damaged, or a field is missing, of the wrong shape or type, not finite, not of unit
        length, or p and r are not orthogonal.
    """
    path = Path(path)
    with open_guarded(path, product) as file:
        group_of(file, "VTKHDF", path)
        points = dataset_of(file, "VTKHDF/Points", path)
        if points.ndim != 2 or points.shape[1] != 3 or points.shape[0] == 0:
            raise InputFileError(f"{path}: /VTKHDF/Points has shape {points.shape}, must be (n, 3) with n > 0")
        n = points.shape[0]
        raw = points[:]
        positions = raw.astype(np.float64)
        check_values(positions, POSITION, points.name, path)
        compare_whole(points, raw, path)
        data = group_of(file, "VTKHDF/PointData", path)
        fields = {}
        for spec in FIELDS[product]:
            if spec.name not in data:
                if spec.required:
                    raise InputFileError(f"{path}: /VTKHDF/PointData/{spec.name} is missing ({spec.doc})")
                continue
            dataset = dataset_of(file, f"VTKHDF/PointData/{spec.name}", path)
            check_layout(dataset, spec, (n,), path)
            raw = dataset[:]
            fields[spec.name] = raw.astype(spec.dtype)
            check_values(fields[spec.name], spec, dataset.name, path)
            compare_whole(dataset, raw, path)
        if "platelet_normal" in fields:
            names = ("/VTKHDF/PointData/fibre_direction", "platelet_normal")
            check_orthogonal(fields["fibre_direction"], fields["platelet_normal"], names, path)
        if product == "charge":
            names = ("/VTKHDF/PointData/in_plane_direction", "fibre_direction")
            check_not_parallel(fields["in_plane_direction"], fields["fibre_direction"], names, path)
        check_unchanged(file, path)
        extra = read_json(file["ppmc"], "extra") if "ppmc" in file else {}
        return ParticleFile(positions, fields, extra, Provenance.load(file))
