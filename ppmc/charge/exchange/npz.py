"""NPZ: NumPy arrays under the names of the charge file, positions as `position`."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ppmc.charge.exchange.points import oriented_points
from ppmc.errors import InputFileError
from ppmc.orientation import in_plane_from_normal
from ppmc.particles import Particles


def write(path: Path, points: Particles) -> None:
    """Write a compressed NPZ file."""
    arrays: dict[str, Any] = {
        "position": points.positions,
        "fibre_direction": points.p,
        "in_plane_direction": in_plane_from_normal(points.p, points.r),
        "platelet_normal": points.r,
    }
    arrays["volume"] = points.volume
    if points.platelet_id is not None:
        arrays["platelet_id"] = points.platelet_id
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read(path: Path) -> Particles:
    """Read an NPZ file; pickled objects are refused.

    Raises
    ------
    InputFileError
        If it is no NPZ file, or an array is missing or no numbers.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            names = ("position", "fibre_direction", "platelet_normal")
            missing = [name for name in names if name not in file]
            if missing:
                raise InputFileError(f"{path}: no array {', '.join(missing)}; it has {', '.join(file.files)}")
            position, p, r = (np.asarray(file[name], dtype=float) for name in names)
            volume = np.asarray(file["volume"], dtype=float) if "volume" in file else None
            ids = np.asarray(file["platelet_id"], dtype=np.int64) if "platelet_id" in file else None
    except (ValueError, OSError, BadZipFile, KeyError) as error:
        raise InputFileError(f"{path}: not readable as NPZ ({error})") from None
    return oriented_points(str(path), position, p, r, volume, ids)
