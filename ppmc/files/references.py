"""Files that a file refers to, so that an edit of any of them counts as an edit of the file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py

HDF5_MARK = b"\x89HDF\r\n\x1a\n"
# How text files name others, by their ending. What is named but is no file is passed over, so that these may be wide:
# any keyword of an Abaqus deck takes INPUT=, on its first line or on one that continues it.
NAMES = {
    ".inp": re.compile(r"\bINPUT\s*=\s*([^,\r\n]+)", re.IGNORECASE),
    ".mhd": re.compile(r"^\s*ElementDataFile\s*=\s*(.+?)\s*$", re.IGNORECASE | re.MULTILINE),
    ".nhdr": re.compile(r"^\s*data ?file:\s*(.+?)\s*$", re.IGNORECASE | re.MULTILINE),
}
BESIDE = {".hdr": ".img"}  # headers whose data have the same name
DEEPEST = 16


def referenced_files(path: Path) -> tuple[Path, ...]:
    """Return the existing files that a file refers to, and those that they refer to, each once and in order.

    Followed are ``INPUT=`` of Abaqus decks (as seen from the file and from the deck that was opened), the data files of
    MetaImage, NRRD and NIfTI headers, and external links, external storage and virtual datasets of HDF5 files.
    """
    found: dict[Path, None] = {}
    _follow(Path(path), found, 0, Path(path).parent)
    found.pop(Path(path).resolve(), None)
    return tuple(found)


def _follow(path: Path, found: dict[Path, None], depth: int, first: Path) -> None:
    """Collect what a file refers to, once for files that refer to each other; `first` is the first one's folder."""
    kind = path.suffix.lower()
    if kind in NAMES:
        names = NAMES[kind].findall(path.read_text(encoding="utf-8", errors="replace"))
    elif kind in BESIDE:
        names = [path.with_suffix(BESIDE[kind]).name]
    elif _is_hdf5(path):
        names = _hdf5_names(path)
    else:
        return
    for name in names:
        for folder in dict.fromkeys((path.parent, first)):
            other = (folder / name.strip().strip("\"'")).resolve()
            if other.is_file() and other not in found and depth < DEEPEST:
                found[other] = None
                _follow(other, found, depth + 1, first)


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
