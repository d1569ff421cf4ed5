"""Checkpoints: the exact arrays of a computation, sealed, with a digest of each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.files.digests import put_digest
from ppmc.files.guard import check_unchanged, group_of, open_guarded, read_whole
from ppmc.files.hdf5_output import new_hdf5
from ppmc.files.provenance import Provenance
from ppmc.files.text import put_json, read_json


def write_state(
    path: Path, arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any], *, provenance: Provenance
) -> None:
    """Write arrays bit for bit, and attributes that JSON can hold.

    Raises
    ------
    StorageError
        If the file cannot be written.
    """
    with new_hdf5(path) as new:
        provenance.store(new.file, "checkpoint")
        group = new.file.create_group("state")
        for name, values in arrays.items():
            stored = np.ascontiguousarray(values)
            put_digest(group.create_dataset(name, data=stored), stored)
        put_json(new.file, "attributes", dict(attributes))


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
            arrays[name] = read_whole(file, f"state/{name}", path)
        check_unchanged(file, path)
        attributes = read_json(file, "attributes")
        return arrays, attributes, Provenance.load(file)
