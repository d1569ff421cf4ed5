"""CSV: one point a line, columns x1, x2, x3 (mm), p1..p3, r1..r3, volume (mm^3), platelet_id."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ppmc.charge.exchange.points import oriented_points
from ppmc.errors import InputFileError
from ppmc.particles import Particles

POSITION, FIBRE, NORMAL = ("x1", "x2", "x3"), ("p1", "p2", "p3"), ("r1", "r2", "r3")


def write(path: Path, points: Particles) -> None:
    """Write a CSV file with a header line; numbers in full precision."""
    import pandas as pd

    columns = dict(zip(POSITION, points.positions.T, strict=True))
    columns |= dict(zip(FIBRE, points.p.T, strict=True))
    columns |= dict(zip(NORMAL, points.r.T, strict=True))
    columns["volume"] = points.volume
    if points.platelet_id is not None:
        columns["platelet_id"] = points.platelet_id
    pd.DataFrame(columns).to_csv(path, index=False)


def read(path: Path) -> Particles:
    """Read a CSV file; columns in any order, others are passed over.

    Raises
    ------
    InputFileError
        If it is no table, a column is missing, or a value is no number.
    """
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except (ValueError, UnicodeDecodeError, OSError) as error:
        raise InputFileError(f"{path}: not readable as CSV ({error})") from None
    missing = [name for name in (*POSITION, *FIBRE, *NORMAL) if name not in table]
    if missing:
        raise InputFileError(f"{path}: no column {', '.join(missing)}; it has {', '.join(map(str, table.columns))}")

    def columns(*names: str) -> np.ndarray:
        try:
            return table[list(names)].to_numpy(dtype=float)
        except ValueError as error:
            raise InputFileError(
                f"{path}: columns {', '.join(names)} hold something that is no number ({error})"
            ) from None

    return oriented_points(
        str(path),
        columns(*POSITION),
        columns(*FIBRE),
        columns(*NORMAL),
        columns("volume")[:, 0] if "volume" in table else None,
        columns("platelet_id")[:, 0].astype(np.int64) if "platelet_id" in table else None,
    )
