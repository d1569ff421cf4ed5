"""VTU: all element data, for ParaView and everything that VTK reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ppmc.analysis.mesh.structural import MappedMesh
from ppmc.files import whole_file
from ppmc.files.beside import mark


def write(mapped: MappedMesh, folder: Path, name: str) -> None:
    """Write ``<name>.vtu``; NaN in elements that received nothing."""
    import meshio

    mesh = mapped.mesh
    ends = np.cumsum([len(cells) for _, cells in mesh.blocks])[:-1]
    data = {key: np.split(values, ends) for key, values in mapped.cell_data().items()}
    solid = meshio.Mesh(mesh.points, mesh.blocks, cell_data=data)
    with whole_file(folder / f"{name}.vtu") as temporary:
        meshio.write(temporary, solid, file_format="vtu")
        mark(temporary, ".vtu")
