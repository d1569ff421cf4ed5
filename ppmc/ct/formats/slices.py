"""Files of a folder that follow one another as slices do."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from itertools import pairwise
from pathlib import Path
from typing import Any

from ppmc.errors import InputFileError


def in_order(folder: Path, endings: Collection[str]) -> list[Path]:
    """Return the slices of a folder in the order of the numbers in their names.

    Raises
    ------
    InputFileError
        If there are none, names are of several kinds, or numbers leave gaps; with the first file at fault.
    """
    files = sorted(
        (f for f in folder.iterdir() if f.suffix.lower() in endings and not f.name.startswith(".")), key=_natural
    )
    if not files:
        raise InputFileError(f"{folder}: folder without {', '.join(sorted(endings))} slices")
    _one_kind(files)
    _no_gaps(files)
    return files


def _natural(file: Path) -> list[Any]:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)]


def _one_kind(files: list[Path]) -> None:
    """Refuse a stray file among numbered slices, such as a preview."""
    kinds = Counter(re.sub(r"\d+", "#", file.stem.lower()) for file in files)
    usual, count = kinds.most_common(1)[0]
    if len(kinds) == 1 or "#" not in usual:
        return
    stray = next(file for file in files if re.sub(r"\d+", "#", file.stem.lower()) != usual)
    raise InputFileError(
        f"{stray}: is not named like the other {count} slices ({usual}); keep other pictures in another folder"
    )


def _no_gaps(files: list[Path]) -> None:
    """Refuse slices whose numbers, the last in each name, do not follow one another evenly."""
    found = [re.findall(r"\d+", file.stem) for file in files]
    if len(files) < 3 or not all(found):
        return
    numbers = [int(parts[-1]) for parts in found]
    steps = [b - a for a, b in pairwise(numbers)]
    usual = sorted(steps)[len(steps) // 2]
    for file, step in zip(files[1:], steps, strict=True):
        if step != usual:
            raise InputFileError(
                f"{file}: its number is {step} above that of the slice before, elsewhere in the folder it is {usual}; "
                "slices are missing or do not belong together"
            )
