"""Checkpoints: the exact arrays of a computation, sealed, with a digest of each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.files.guard import dataset_of, group_of, open_guarded
from ppmc.files.provenance import Provenance
from ppmc.files.storage import whole_file
from ppmc.files.text import attribute, put_attribute, put_json, read_json
from ppmc.files.vtkhdf import SEALED, digest


def write_state(
    path: Path, arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any], *, provenance: Provenance
) -> None:
    """Write arrays bit for bit, and attributes that JSON can hold.

    Raises
    ------
    StorageError
        If the file cannot be written.
    """
    with whole_file(path) as temporary, h5py.File(temporary, "w", libver=SEALED) as file:
        provenance.store(file, "checkpoint")
        group = file.create_group("state")
        for name, values in arrays.items():
            stored = np.ascontiguousarray(values)
            put_attribute(group.create_dataset(name, data=stored), "sha256", digest(stored))
        put_json(file, "attributes", dict(attributes))


def read_state(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any], Provenance]:
    """Return the arrays, attributes and origin of a checkpoint.

    Raises
    ------
    InputFileError
        If the file is missing or damaged, or an array does not match its digest.
    """
    path = Path(path)
    with open_guarded(path, "checkpoint") as file:
        arrays = {}
        for name in group_of(file, "state", path):
            dataset = dataset_of(file, f"state/{name}", path)
            arrays[name] = dataset[()]
            if attribute(dataset, "sha256") != digest(arrays[name]):
                raise InputFileError(f"{path}: /state/{name} does not match its digest; the file is damaged")
        attributes = read_json(file, "attributes")
        return arrays, attributes, Provenance.load(file)
