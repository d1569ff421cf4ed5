"""Text inside HDF5, always of fixed length.

HDF5 keeps text of variable length in a heap without checksums; a few zeroed bytes there make the library loop for
ever on reading. Text of fixed length lies in checksummed metadata or in the dataset itself.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

MOST_BYTES = 2**16  # of an attribute; HDF5 keeps no more without being asked to


def put_attribute(target: Any, name: str, text: str) -> None:
    """Write a text attribute of a group or dataset."""
    raw = text.encode()
    target.attrs.create(name, raw, dtype=h5py.string_dtype("utf-8", max(1, len(raw))))


def put_ascii(target: Any, name: str, text: str) -> None:
    """Write a text attribute in ASCII, the only kind that VTK's reader takes for its own."""
    target.attrs.create(name, text.encode("ascii"), dtype=h5py.string_dtype("ascii", len(text)))


def attribute(source: Any, name: str, default: str = "") -> str:
    """Return a text attribute, or `default` if there is none.

    Raises
    ------
    InputFileError
        If it is no text of fixed length.
    """
    if name not in source.attrs:
        return default
    kind = source.attrs.get_id(name).dtype
    if kind.kind != "S":
        raise InputFileError(f"{source.file.filename}: {source.name}@{name} must be text of fixed length, it is {kind}")
    return bytes(source.attrs[name]).decode()


def numbers(source: Any, name: str, count: int | None = None) -> NDArray[Any]:
    """Return a numeric attribute, shape (count,).

    Parameters
    ----------
    source : h5py.Group or h5py.Dataset
        Whose attribute it is.
    name : str
        Its name.
    count : int, optional
        How many numbers there must be; any by default.

    Raises
    ------
    InputFileError
        If it is missing, holds no numbers, or not as many.
    """
    where = f"{source.file.filename}: {source.name}@{name}"
    if name not in source.attrs:
        raise InputFileError(f"{where} is missing")
    kind = source.attrs.get_id(name)
    if kind.dtype.kind not in "iuf" or kind.get_storage_size() > MOST_BYTES:
        raise InputFileError(f"{where} must be numbers, it is {kind.dtype} of shape {kind.shape}")
    found = np.atleast_1d(source.attrs[name]).ravel() if kind.shape is not None else np.empty(0)
    if not len(found) or (count is not None and len(found) != count):
        raise InputFileError(f"{where} must be {count or 'some'} numbers, it is {len(found)}")
    return found


def put_json(group: h5py.Group, name: str, value: Any) -> None:
    """Write anything that JSON can hold as a dataset."""
    raw = json.dumps(value, sort_keys=True).encode()
    group.create_dataset(name, data=np.array(raw, dtype=h5py.string_dtype("utf-8", len(raw))))


def read_json(group: h5py.Group, name: str) -> Any:
    """Return what `put_json` wrote; an empty mapping if there is none.

    Raises
    ------
    InputFileError
        If the dataset holds no text of fixed length.
    """
    if name not in group:
        return {}
    if not isinstance(group.get(name, getlink=True), h5py.HardLink) or not isinstance(group[name], h5py.Dataset):
        raise InputFileError(f"{group.file.filename}: {group.name}/{name} must be a dataset of the file itself")
    data = group[name]
    if data.dtype.kind != "S" or data.shape != () or data.external or data.is_virtual:
        raise InputFileError(f"{group.file.filename}: {data.name} must be text of fixed length, it is {data.dtype}")
    raw = data[()]
    noted = attribute(data, "sha256")
    if noted and noted != hashlib.sha256(np.asarray(raw).tobytes()).hexdigest():
        raise InputFileError(f"{group.file.filename}: {data.name} does not match its digest; the file is damaged")
    found = json.loads(bytes(raw).decode())
    if not isinstance(found, dict):
        raise InputFileError(f"{group.file.filename}: {data.name} must be a JSON object, it is {type(found).__name__}")
    return found
