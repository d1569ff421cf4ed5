"""Files beside products, for people and for other programs: marked as ppmc's own, so that only such are replaced.

The mark stands at the end of the file, as a comment of its format; readers pass over it.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ppmc.files.storage import check_output, whole_file

MARK = b"Written by ppmc"
WITHIN = 4096
COMMENTS = {
    ".inp": b"** %b\n",
    ".msh": b"$Comments\n%b\n$EndComments\n",
    ".vtu": b"<!-- %b -->\n",
}
PNG_END = 12  # bytes of the chunk that ends a PNG
MARKED = (*COMMENTS, ".gif", ".npz", ".png")


def mark(path: Path, kind: str) -> None:
    """Put the mark at the end of a finished file.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        Its ending in the end, one of `MARKED`.
    """
    if kind == ".npz":
        with zipfile.ZipFile(path, "a") as archive:
            archive.comment = MARK
        return
    with path.open("r+b") as file:
        if kind == ".png":
            text = b"tEXtSoftware\0" + MARK
            file.seek(-PNG_END, 2)
            end = file.read()
            file.seek(-PNG_END, 2)
            file.write(struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text)) + end)
        elif kind == ".gif":
            file.seek(-1, 2)
            file.write(b"\x21\xfe" + bytes([len(MARK)]) + MARK + b"\0;")
        else:
            file.seek(0, 2)
            file.write(COMMENTS[kind] % MARK)


def is_marked(path: Path) -> str:
    """Return what an existing file is, in words, if it does not carry the mark; empty if it does, or is empty."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - WITHIN))
        end = file.read()
    return "" if not end or MARK in end else "was not written by ppmc"


@contextmanager
def marked_file(path: Path, inputs: Iterable[Path | None] = (), *, force: bool = False) -> Iterator[Path]:
    """Yield a temporary path; what is written there gets the mark and the name, whole or not at all.

    Parameters
    ----------
    path : Path
        The file, its ending one of `MARKED`.
    inputs : iterable of Path
        Files that it must not replace.
    force : bool
        Replace files of other programs too.

    Raises
    ------
    SceneError
        If an input or another program's file has the name.
    StorageError
        If it cannot be written.
    """
    check_output(path, inputs, is_own=is_marked, force=force)
    with whole_file(path) as temporary:
        yield temporary
        mark(temporary, path.suffix.lower())
