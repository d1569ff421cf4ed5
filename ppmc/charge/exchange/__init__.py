"""Orientations to and from other programs: CSV, NPZ, VTU and Abaqus .inp, chosen by the file's ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ppmc.charge.exchange import abaqus, csv, npz, vtu
from ppmc.errors import InputFileError, SceneError
from ppmc.particles import Particles

Reader = Callable[[Path], Particles]
Writer = Callable[[Path, Particles], None]

FORMATS: dict[str, tuple[Reader, Writer]] = {
    ".csv": (csv.read, csv.write),
    ".npz": (npz.read, npz.write),
    ".vtu": (vtu.read, vtu.write),
    ".inp": (abaqus.read, abaqus.write),
}

CSV_HEAD = b"x1,x2,x3,p1,p2,p3,r1,r2,r3,volume,platelet_id"
"""How a CSV file of `write` begins; a table has no place for comments."""


def read_points(path: Path) -> Particles:
    """Read orientations at points.

    Parameters
    ----------
    path : Path
        CSV, NPZ, VTU or Abaqus .inp file.

    Raises
    ------
    InputFileError
        If the file is missing, of no known kind, damaged, or its directions are not usable; naming what is wrong.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise InputFileError(f"{path}: orientations are read from {', '.join(FORMATS)}, not '{path.suffix}'")
    if not path.is_file():
        raise InputFileError(f"{path}: no such file; relative paths start at the scene's folder")
    return FORMATS[path.suffix.lower()][0](path)


def writer_of(path: Path) -> Writer:
    """Return what writes a file of this ending.

    Raises
    ------
    SceneError
        If the ending is not known.
    """
    if path.suffix.lower() not in FORMATS:
        raise SceneError(f"{path}: a charge is exported to {', '.join(FORMATS)}, not '{path.suffix}'")
    return FORMATS[path.suffix.lower()][1]
