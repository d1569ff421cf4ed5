"""Text of others: byte-order marks, encodings and numbers as programs write them."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.errors import InputFileError

MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))


def as_ascii(data: bytes) -> bytes:
    """Return text without its byte-order mark, one byte a character, and lines that end in a line feed."""
    for mark, encoding in MARKS:
        if data.startswith(mark):
            data = data[len(mark) :]
            if encoding != "utf-8":
                data = data.decode(encoding, errors="replace").encode("ascii", errors="replace")
            break
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").rstrip(b"\0\x1a \t\n") + b"\n"


def numbers(words: Sequence[bytes], path: Path, what: str) -> NDArray[np.float64]:
    """Return words as numbers; Fortran's 1.5D+01 is one.

    Raises
    ------
    InputFileError
        If one is none, with the word.
    """
    try:
        return np.array(words, dtype=np.float64)
    except ValueError:
        pass
    out = np.empty(len(words))
    for k, word in enumerate(words):
        try:
            out[k] = float(word.lower().replace(b"d", b"e"))
        except ValueError:
            shown = word.decode("ascii", errors="replace")
            hint = "; numbers have a decimal point" if b"," in word else ""
            raise InputFileError(f"{path}: '{shown}' in {what} is no number{hint}: export the surface again") from None
    return out
