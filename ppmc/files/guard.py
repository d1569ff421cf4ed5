"""Open files of others with care: nothing is read that is not there, not ours, not sound, or not inside the file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError
from ppmc.files.fields import MADE_BY, SCHEMA_VERSION, Field
from ppmc.files.text import attribute

UNIT_TOLERANCE = 1e-3
ORTHOGONAL_TOLERANCE = 5e-3
MOST_COMPRESSION = 1100  # deflate cannot shrink further than about 1030 : 1
SMALL_BYTES = 16 * 2**20


@contextmanager
def open_guarded(path: Path, product: str | None) -> Iterator[h5py.File]:
    """Open a ppmc file for reading.

    Parameters
    ----------
    path : Path
        The file.
    product : str or None
        The contract it must meet; None takes any.

    Raises
    ------
    InputFileError
        If the file is missing, no HDF5, truncated, another product or of a newer schema.
    """
    path = Path(path)
    if not path.exists():
        hint = f"; make it with '{MADE_BY[product]}'" if product in MADE_BY else ""
        raise InputFileError(f"{path}: no such file{hint}")
    if path.is_dir():
        raise InputFileError(f"{path}: is a folder, not a file")
    try:
        file = h5py.File(path, "r", locking=False)
    except OSError as error:
        why = "truncated" if "truncated" in str(error) else "not an HDF5 file, or damaged"
        raise InputFileError(f"{path}: cannot be opened: {why}") from None
    with file:
        try:
            _check_schema(file, path, product)
            yield file
        except (OSError, RuntimeError, KeyError, UnicodeDecodeError, json.JSONDecodeError) as error:
            # HDF5 reports damage inside a file only when the damaged part is read; h5py turns some of these reports
            # into KeyError, which is a fault of the program if it says anything else.
            if isinstance(error, KeyError) and "Unable to" not in str(error):
                raise
            raise InputFileError(f"{path}: is damaged: {str(error).splitlines()[0]}") from None


def product_of(path: Path) -> str:
    """Return the product that a ppmc file holds, such as ``"flow"``.

    Raises
    ------
    InputFileError
        If the file is missing, damaged or not of ppmc.
    """
    with open_guarded(path, None) as file:
        return attribute(file["ppmc"], "schema", "unknown")


def _check_schema(file: h5py.File, path: Path, product: str | None) -> None:
    """Refuse other products and newer contracts."""
    group = _member(file, "ppmc", path) if "ppmc" in file else None
    if group is None:
        if product in (None, "checkpoint"):
            raise InputFileError(f"{path}: is HDF5, but no ppmc file (it has no group /ppmc)")
        return  # another program's file may still meet the contract; the fields decide
    schema = attribute(group, "schema")
    if product is not None and schema != product:
        raise InputFileError(
            f"{path}: holds '{schema}', but '{product}' is needed here; make one with '{MADE_BY.get(product, product)}'"
        )
    version = tuple(int(v) for v in np.atleast_1d(group.attrs.get("schema_version", (0,))))
    if version[0] != SCHEMA_VERSION[0]:
        raise InputFileError(
            f"{path}: /ppmc@schema_version is {version}, this ppmc reads {SCHEMA_VERSION}; install a matching ppmc"
        )


def _member(parent: h5py.Group, name: str, path: Path) -> Any:
    """Return a member of a group, every link on the way checked to stay inside the file."""
    here: Any = parent
    for part in name.strip("/").split("/"):
        link = here.get(part, getlink=True) if isinstance(here, h5py.Group) else None
        if link is None:
            raise InputFileError(f"{path}: {here.name.rstrip('/')}/{part} is missing")
        if not isinstance(link, h5py.HardLink):
            raise InputFileError(
                f"{path}: {here.name.rstrip('/')}/{part} is a link ({type(link).__name__}); "
                "ppmc reads only what the file itself holds: copy the data in (h5repack, or h5py's copy)"
            )
        here = here[part]
    return here


def group_of(file: h5py.File, name: str, path: Path) -> h5py.Group:
    """Return a group.

    Raises
    ------
    InputFileError
        If it is missing, a link, or a dataset.
    """
    group = _member(file, name, path)
    if not isinstance(group, h5py.Group):
        raise InputFileError(f"{path}: {group.name} must be a group")
    return group


def dataset_of(file: h5py.File, name: str, path: Path) -> h5py.Dataset:
    """Return a dataset whose data lies in the file and whose size is believable.

    Raises
    ------
    InputFileError
        If it is missing, a link, stored outside the file, virtual, or declared far larger than its data.
    """
    data = _member(file, name, path)
    if not isinstance(data, h5py.Dataset):
        raise InputFileError(f"{path}: {data.name} must be a dataset, it is a group")
    if data.external or data.is_virtual:
        raise InputFileError(f"{path}: {data.name} keeps its data in other files; ppmc reads only what the file holds")
    if data.dtype.kind in "iufb":
        stored = data.id.get_storage_size()
        if data.nbytes > MOST_COMPRESSION * stored + SMALL_BYTES:
            raise InputFileError(
                f"{path}: {data.name} declares {data.nbytes:,} bytes, but the file holds {stored:,} for it; "
                "it was not written to the end"
            )
    return data


def check_layout(data: h5py.Dataset, spec: Field, lead: tuple[int, ...] | None, path: Path) -> None:
    """Verify a dataset's shape and kind of number against its contract.

    Parameters
    ----------
    data : h5py.Dataset
        What the file has.
    spec : Field
        What the contract asks.
    lead : tuple of int or None
        The shape without the components; None takes any.

    Raises
    ------
    InputFileError
        Naming the dataset, what it is and what it must be.
    """
    tail = () if spec.components == 1 else (spec.components,)
    want = f"{'(...)' if lead is None else lead} + {tail}"
    fits = data.shape == (*lead, *tail) if lead is not None else data.shape[data.ndim - len(tail) :] == tail
    if not fits:
        raise InputFileError(f"{path}: {data.name} has shape {data.shape}, must be {want} ({spec.doc})")
    kinds = "iu" if spec.dtype[0] in "iu" else "iuf"
    if data.dtype.kind not in kinds:
        raise InputFileError(f"{path}: {data.name} holds {data.dtype}, must hold {spec.dtype} ({spec.doc})")


def check_values(values: NDArray[Any], spec: Field, name: str, path: Path) -> None:
    """Verify values against their contract: finite, positive, of unit length.

    Raises
    ------
    InputFileError
        Naming the dataset, the first offending entry and its value, and how many there are.
    """
    if spec.check == "any" or values.dtype.kind in "iub":
        return
    bad = ~np.isfinite(values)
    if spec.components > 1:
        bad = bad.any(axis=-1)
    _refuse(bad, values, "is not finite", name, path)
    if spec.check == "positive":
        _refuse(values <= 0, values, "must be positive", name, path)
    elif spec.check in ("unit", "unit_or_zero"):
        length = np.sqrt(np.einsum("...i,...i->...", values, values, dtype=np.float64))
        bad = np.abs(length - 1.0) > UNIT_TOLERANCE
        if spec.check == "unit_or_zero":
            bad &= length != 0.0
        _refuse(bad, values, "must have unit length (scale the vectors)", name, path)


def check_orthogonal(a: NDArray[Any], b: NDArray[Any], names: tuple[str, str], path: Path) -> None:
    """Verify that two fields of unit vectors, shape (..., 3), are orthogonal.

    Raises
    ------
    InputFileError
        Naming both datasets and the first offending entry.
    """
    dot = np.abs(np.einsum("...i,...i->...", a, b, dtype=np.float64))
    _refuse(
        dot > ORTHOGONAL_TOLERANCE,
        dot,
        f"must be orthogonal to {names[1]} (their dot product is not 0)",
        names[0],
        path,
    )


def _refuse(bad: NDArray[np.bool_], values: NDArray[Any], why: str, name: str, path: Path) -> None:
    """Raise on the first entry that is marked bad."""
    if bad.any():
        index = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), bad.shape))
        shown = np.array2string(np.asarray(values[index]), precision=6)
        raise InputFileError(f"{path}: {name}{list(index)} = {shown} {why}; {int(bad.sum()):,} of {bad.size:,} entries")
