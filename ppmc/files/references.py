"""Files that a file refers to, so that an edit of any of them counts as an edit of the file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py

HDF5_MARK = b"\x89HDF\r\n\x1a\n"
INCLUDE = re.compile(r"^\*\s*INCLUDE\s*,.*?INPUT\s*=\s*([^,\r\n]+)", re.IGNORECASE | re.MULTILINE)
DEEPEST = 16


def referenced_files(path: Path) -> tuple[Path, ...]:
    """Return the existing files that a file refers to, and those that they refer to, each once and in order.

    Followed are ``*INCLUDE`` lines of Abaqus input files, and external links, external storage and virtual datasets of
    HDF5 files.
    """
    found: dict[Path, None] = {}
    _follow(Path(path), found, 0)
    found.pop(Path(path).resolve(), None)
    return tuple(found)


def _follow(path: Path, found: dict[Path, None], depth: int) -> None:
    """Collect what a file refers to, once for files that refer to each other."""
    if path.suffix.lower() == ".inp":
        names = INCLUDE.findall(path.read_text(encoding="utf-8", errors="replace"))
    elif _is_hdf5(path):
        names = _hdf5_names(path)
    else:
        return
    for name in names:
        other = (path.parent / name.strip().strip("\"'")).resolve()
        if other.is_file() and other not in found and depth < DEEPEST:
            found[other] = None
            _follow(other, found, depth + 1)


def _is_hdf5(path: Path) -> bool:
    """Return whether a file is HDF5 of another program; ppmc's own refer to nothing, and may be large."""
    with path.open("rb") as handle:
        return handle.read(len(HDF5_MARK)) == HDF5_MARK


def _hdf5_names(path: Path) -> list[str]:
    """Return the names of the files in which an HDF5 file keeps data; none if it cannot be read."""
    names: list[str] = []

    def look(_: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            names.append(link.filename)

    def data(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            names.extend(part[0] for part in item.external or ())
            if item.is_virtual:
                names.extend(source.file_name for source in item.virtual_sources() if source.file_name != ".")

    try:
        with h5py.File(path, "r", locking=False) as file:
            if "ppmc" in file:
                return []
            file.visititems_links(look)
            file.visititems(data)
    except (OSError, RuntimeError, KeyError):
        return []  # whoever reads it will say so
    return names
