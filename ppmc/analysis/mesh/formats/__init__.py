"""A mapped mesh as files that structural solvers and viewers read; one file a format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ppmc.analysis.mesh.formats import abaqus, calculix, gmsh, lsdyna, vtu
from ppmc.analysis.mesh.structural import MappedMesh

FORMATS: dict[str, Callable[[MappedMesh, Path, str], None]] = {
    "vtu": vtu.write,
    "abaqus": abaqus.write,
    "calculix": calculix.write,
    "lsdyna": lsdyna.write,
    "gmsh": gmsh.write,
}


def write_mapped(mapped: MappedMesh, folder: Path, name: str, formats: Sequence[str]) -> None:
    """Write a mapped mesh.

    Parameters
    ----------
    mapped : MappedMesh
    folder : Path
    name : str
        Of the files, without ending.
    formats : sequence of str
        Names in `FORMATS`.

    Raises
    ------
    StorageError
        If a file cannot be written.
    SceneError
        If a format cannot hold the mesh's elements.
    """
    for kind in formats:
        FORMATS[kind](mapped, folder, name)
