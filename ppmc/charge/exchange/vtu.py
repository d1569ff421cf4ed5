"""VTU: an unstructured grid of vertices, or of any cells with orientations in cell or point data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ppmc.charge.exchange.points import oriented_points
from ppmc.errors import InputFileError
from ppmc.orientation import in_plane_from_normal
from ppmc.particles import Particles


def write(path: Path, points: Particles) -> None:
    """Write a VTU file of vertices with point data; ParaView opens it."""
    import meshio

    data: dict[str, Any] = {
        "fibre_direction": points.p,
        "in_plane_direction": in_plane_from_normal(points.p, points.r),
        "platelet_normal": points.r,
    }
    data["volume"] = points.volume
    if points.platelet_id is not None:
        data["platelet_id"] = points.platelet_id
    cells = [("vertex", np.arange(len(points.positions))[:, None])]
    meshio.Mesh(points.positions, cells, point_data=data).write(path, file_format="vtu")


def read(path: Path) -> Particles:
    """Read a VTU file; orientations of cells are taken at the mean of the cell's points.

    Raises
    ------
    InputFileError
        If it is not readable, or has neither point nor cell data `fibre_direction` and `platelet_normal`.
    """
    import meshio

    try:
        mesh = meshio.read(path)
    except (Exception, SystemExit) as error:
        raise InputFileError(f"{path}: not readable as VTU ({error})") from None
    if "fibre_direction" in mesh.point_data:
        position, data = np.asarray(mesh.points, dtype=float), mesh.point_data
    else:
        centres = [mesh.points[block.data].mean(axis=1) for block in mesh.cells]
        position = np.concatenate(centres) if centres else np.zeros((0, 3))
        data = {name: np.concatenate(parts) for name, parts in mesh.cell_data.items()}
    missing = [name for name in ("fibre_direction", "platelet_normal") if name not in data]
    if missing:
        raise InputFileError(
            f"{path}: no data {', '.join(missing)}; it has {', '.join([*mesh.point_data, *mesh.cell_data]) or 'none'}"
        )
    volume = np.asarray(data["volume"], dtype=float) if "volume" in data else None
    ids = np.asarray(data["platelet_id"]).astype(np.int64) if "platelet_id" in data else None
    p, r = (np.asarray(data[name], dtype=float) for name in ("fibre_direction", "platelet_normal"))
    return oriented_points(str(path), position, p, r, volume, ids)
