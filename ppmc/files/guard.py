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
from ppmc.files.digests import DIGESTS, LENGTH, MANIFEST, BlockCheck, digest, manifest
from ppmc.files.fields import FIELDS, MADE_BY, SCHEMA_VERSION, Field
from ppmc.files.text import attribute, numbers

UNIT_TOLERANCE = 1e-3
ORTHOGONAL_TOLERANCE = 5e-3
LEAST_SINE = 1e-3
MOST_COMPRESSION = 1100  # deflate cannot shrink further than about 1030 : 1
SMALL_BYTES = 16 * 2**20
SPARSE_BYTES = 2**36
MOST_OBJECTS = 20_000
OWN_GROUPS = ("ppmc", "VTKHDF", "state")
# A frame of a growing product leaves to its header what all frames share.
FRAME_LINKS = tuple(
    f"/VTKHDF/{name}"
    for name in (
        *("NumberOfPoints", "Vertices", "Lines", "Polygons", "Strips"),
        *(f"PointData/{f.name}" for fields in FIELDS.values() for f in fields if f.static),
    )
)
UNLIKE = "does not match its digest; the file was changed or damaged after it was written"


@contextmanager
def open_guarded(path: Path, product: str | None) -> Iterator[h5py.File]:
    """Open a ppmc file for reading; what it says about itself is made sure of by `check_unchanged`.

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
    with _opened(path, product) as file:
        for name in OWN_GROUPS if "ppmc" in file else ():
            if name in file:
                _check_tree(file, name, path)
        yield file


def check_unchanged(file: h5py.File, path: Path) -> None:
    """Refuse a file whose names, types, shapes, attributes or digests are not those that were written.

    Asked last, when nothing more telling has been found: a field under another's name has a digest that fits.

    Raises
    ------
    InputFileError
        If something differs.
    """
    written = attribute(file["ppmc"], MANIFEST) if "ppmc" in file else ""
    if written and written != manifest(file):
        raise InputFileError(
            f"{path}: names, shapes or attributes were changed after the file was written; make it anew"
        )


@contextmanager
def _opened(path: Path, product: str | None) -> Iterator[h5py.File]:
    """Open a file of a product, and say in one message what HDF5 finds wrong with it from then on."""
    if not path.exists():
        hint = f"; make it with '{MADE_BY[product]}'" if product in MADE_BY else ""
        growing = path.with_name(f"{path.stem}.partial")
        if product == "flow" and growing.is_dir():
            hint = f"; its run is not complete, the frames so far are in {growing}"
        raise InputFileError(f"{path}: no such file{hint}")
    if not path.is_file():
        raise InputFileError(f"{path}: is {'a folder' if path.is_dir() else 'a device or the like'}, not a file")
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


def _check_tree(file: h5py.File, name: str, path: Path) -> None:
    """Refuse links, foreign storage, implausible sizes and unknown types anywhere in a group."""
    allowed = FRAME_LINKS if attribute(file["ppmc"], "schema") == "frame" else ()
    waiting, seen = [_member(file, name, path)], 0
    known: set[Any] = set()
    while waiting:
        here = waiting.pop()
        seen += 1
        if seen > MOST_OBJECTS:
            raise InputFileError(f"{path}: holds more than {MOST_OBJECTS:,} groups and datasets; it is not ppmc's")
        if isinstance(here, h5py.Dataset):
            dataset_of(file, here.name, path)
            continue
        address = h5py.h5o.get_info(here.id).addr
        if address in known:
            raise InputFileError(f"{path}: {here.name} is in the file twice; ppmc's files hold everything once")
        known.add(address)
        for part in here:
            if f"{here.name}/{part}" in allowed:
                continue
            waiting.append(_member(here, part, path))


def product_of(path: Path) -> str:
    """Return the product that a ppmc file says it holds, such as ``"flow"``, sound or not.

    Raises
    ------
    InputFileError
        If the file is missing, cannot be opened or is not of ppmc.
    """
    path = Path(path)
    growing = path / "header.vtkhdf"  # a folder in which a product grows
    with _opened(growing if growing.is_file() else path, None) as file:
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
    version = tuple(numbers(group, "schema_version").tolist())
    if version[0] != SCHEMA_VERSION[0]:
        raise InputFileError(
            f"{path}: /ppmc.schema_version is {version}, this ppmc reads {SCHEMA_VERSION}; install a matching ppmc"
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
    if data.dtype.kind not in "iufbS":
        raise InputFileError(f"{path}: {data.name} holds {data.dtype}; ppmc reads numbers and text of fixed length")
    if data.size:
        stored = data.id.get_storage_size()
        # A file with holes declares bytes that no disk holds; some file systems count fresh blocks late.
        hollow = data.nbytes > SPARSE_BYTES and data.nbytes > MOST_COMPRESSION * path.stat().st_blocks * 512
        if hollow or data.nbytes > MOST_COMPRESSION * stored + SMALL_BYTES:
            raise InputFileError(
                f"{path}: {data.name} declares {data.nbytes:,} bytes, but the file holds {stored:,} for it; "
                "it was not written to the end"
            )
    return data


def read_whole(file: h5py.File, name: str, path: Path) -> Any:
    """Return all values of a dataset, compared with its digest if it has one.

    Raises
    ------
    InputFileError
        If it is no dataset that may be read, or its values are not those that were written.
    """
    data = dataset_of(file, name, path)
    values = data[()]
    compare_whole(data, values, path)
    return values


def compare_whole(data: h5py.Dataset, values: NDArray[Any], path: Path) -> None:
    """Refuse values of a whole dataset that are not those that were written.

    Raises
    ------
    InputFileError
        Naming the dataset.
    """
    noted = attribute(data, "sha256")
    if noted and noted != digest(np.asarray(values)):
        raise InputFileError(f"{path}: {data.name} {UNLIKE}")


def block_check(file: h5py.File, name: str, path: Path) -> BlockCheck:
    """Return the comparison of a dataset with the digests of its blocks, to be asked before a part is read.

    Raises
    ------
    InputFileError
        If it is no dataset that may be read, or its digests are not sound.
    """
    data = dataset_of(file, name, path)
    if f"{DIGESTS}/{name}" not in file:
        return BlockCheck(data, None, data.shape)
    where = f"{DIGESTS}/{name}"
    found = read_whole(file, where, path)
    block = tuple(int(b) for b in numbers(file[where], "block"))
    fits = len(block) == data.ndim and min(block, default=0) > 0 and found.dtype == np.uint8
    if not fits or found.shape != (*(-(-n // b) for n, b in zip(data.shape, block, strict=True)), LENGTH):
        raise InputFileError(f"{path}: /{where} does not fit {data.name}; {UNLIKE}")
    return BlockCheck(data, found, block)


def compare_block(check: BlockCheck, index: tuple[slice, ...], path: Path) -> None:
    """Refuse a part of a dataset whose blocks are not those that were written.

    Raises
    ------
    InputFileError
        Naming the dataset and the first block.
    """
    unlike = check.first_unlike(index)
    if unlike is not None:
        where = ", ".join(f"{s.start}:{s.stop}" for s in unlike)
        raise InputFileError(f"{path}: {check.dataset.name}[{where}] {UNLIKE}")


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


def check_not_parallel(a: NDArray[Any], b: NDArray[Any], names: tuple[str, str], path: Path) -> None:
    """Verify that two fields of unit vectors, shape (n, 3), span a plane everywhere.

    Raises
    ------
    InputFileError
        Naming both datasets and the first offending entry.
    """
    sine = np.linalg.norm(np.cross(np.asarray(a, np.float64), np.asarray(b, np.float64)), axis=-1)
    _refuse(
        sine < LEAST_SINE, sine, f"is parallel to {names[1]} (sine of their angle); they span no plane", names[0], path
    )


def _refuse(bad: NDArray[np.bool_], values: NDArray[Any], why: str, name: str, path: Path) -> None:
    """Raise on the first entry that is marked bad."""
    if bad.any():
        index = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), bad.shape))
        shown = np.array2string(np.asarray(values[index]), precision=6)
        raise InputFileError(f"{path}: {name}{list(index)} = {shown} {why}; {int(bad.sum()):,} of {bad.size:,} entries")
