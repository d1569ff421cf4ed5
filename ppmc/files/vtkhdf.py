"""The VTKHDF layout (version 2.2) inside ppmc files, so that ParaView and pyvista open them as they are."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.files.digests import put_digest
from ppmc.files.fields import Field
from ppmc.files.grid import VoxelGrid
from ppmc.files.text import put_ascii, put_attribute

VERSION = (2, 2)  # the lowest that allows groups of one's own beside /VTKHDF

# What VTK shows first: the attribute "Attribute" of a dataset makes it the active array of that kind.
ACTIVE = {"fibre_direction": "Vectors", "principal_fibre_direction": "Vectors", "grey": "Scalars"}


def begin(file: h5py.File, kind: str) -> h5py.Group:
    """Return the new group ``/VTKHDF`` of a dataset type such as ``"PolyData"``."""
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = VERSION
    put_ascii(root, "Type", kind)
    return root


def image_header(root: h5py.Group, grid: VoxelGrid) -> h5py.Group:
    """Write the extent of an image whose points are the voxels' centres; return its point data."""
    nz, ny, nx = grid.shape
    root.attrs["WholeExtent"] = np.array([0, nx - 1, 0, ny - 1, 0, nz - 1], dtype=np.int64)
    root.attrs["Origin"] = np.array(grid.origin, dtype=np.float64)
    root.attrs["Spacing"] = np.array(grid.spacing, dtype=np.float64)
    root.attrs["Direction"] = grid.rotation.ravel()
    return root.create_group("PointData")


def points_header(root: h5py.Group, n: int) -> h5py.Group:
    """Write the cells of a cloud of `n` points, a vertex each, the same at all times; return its point data."""
    root["NumberOfPoints"] = np.array([n], dtype=np.int64)
    for name in ("Vertices", "Lines", "Polygons", "Strips"):
        count = n if name == "Vertices" else 0
        cells = root.create_group(name)
        cells["NumberOfCells"] = np.array([count], dtype=np.int64)
        cells["NumberOfConnectivityIds"] = np.array([count], dtype=np.int64)
        cells["Offsets"] = np.arange(count + 1, dtype=np.int64)
        cells["Connectivity"] = np.arange(count, dtype=np.int64)
    return root.create_group("PointData")


def describe(dataset: h5py.Dataset, spec: Field, creator: str) -> None:
    """Attach unit, meaning and origin to a dataset."""
    put_attribute(dataset, "unit", spec.unit)
    put_attribute(dataset, "description", spec.doc)
    put_attribute(dataset, "creator", creator)
    if spec.name in ACTIVE:
        put_ascii(dataset, "Attribute", ACTIVE[spec.name])


def as_stored(values: NDArray[Any], spec: Field, lead: tuple[int, ...]) -> NDArray[Any]:
    """Return values in the shape and type of their contract.

    Raises
    ------
    ValueError
        If they do not have its shape: a fault of the caller, not of a user's file.
    """
    values = np.asarray(values)
    shape = lead if spec.components == 1 else (*lead, spec.components)
    if values.shape != shape and values.size == int(np.prod(shape)) and spec.components == 9:
        values = values.reshape(shape)
    if values.shape != shape:
        raise ValueError(f"field '{spec.name}' has shape {values.shape}, the contract asks {shape}")
    return np.ascontiguousarray(values, dtype=stored_dtype(spec, values.dtype))


def stored_dtype(spec: Field, given: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type on disk; grey values keep uint8 and uint16 and are float32 otherwise."""
    if spec.dtype != "grey":
        return np.dtype(spec.dtype)
    return given if given in (np.uint8, np.uint16) else np.dtype(np.float32)


def put(group: h5py.Group, spec: Field, values: NDArray[Any], lead: tuple[int, ...], creator: str) -> None:
    """Write one whole field with its description and digest."""
    stored = as_stored(values, spec, lead)
    dataset = group.create_dataset(spec.name, data=stored)
    describe(dataset, spec, creator)
    put_digest(dataset, stored)
