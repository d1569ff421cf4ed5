"""Structural meshes from Gmsh files: meshio reads nodes and elements, their numbers are read here.

meshio drops element and node numbers of both versions of the format in use, 2.2 and 4.1.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.analysis.mesh.mesh import StructuralMesh, family, mappable, nodes_of, structural, through_meshio
from ppmc.errors import InputFileError

Labels = NDArray[np.int64]


def gmsh_mesh(path: Path) -> StructuralMesh:
    """Read a Gmsh mesh with its element numbers, node numbers and physical groups.

    Raises
    ------
    InputFileError
        If it cannot be read, or numbers and elements do not fit.
    """
    mesh = through_meshio(path)
    points = nodes_of(mesh, path)
    every = [(b.type, np.asarray(b.data)) for b in mesh.cells]
    kept = mappable(path, [block for block in every if len(block[1])])
    families = {family(kind) for kind, _ in kept}
    chosen = [k for k, (kind, cells) in enumerate(every) if family(kind) in families and len(cells)]
    node_numbers, numbers = _numbers(path)
    ends = np.cumsum([0, *(len(cells) for _, cells in every)])
    if len(node_numbers) != len(points) or len(numbers) != ends[-1]:
        raise InputFileError(
            f"{path}: holds {ends[-1]:,} elements but {len(numbers):,} numbers; save it again with Gmsh"
        )
    index = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in chosen])
    tags = {}
    for name in ("physical", "geometrical"):
        data = mesh.cell_data.get(f"gmsh:{name}")
        if data is not None and len(data) == len(every):
            tags[name] = np.concatenate([np.asarray(data[k], dtype=np.int64) for k in chosen])
    tag_names = {name: (int(values[0]), int(values[1])) for name, values in mesh.field_data.items()}
    groups = {}
    if "physical" in tags and len(tags["physical"]) == len(index):
        dimension = 3 if families & {"tetra", "hexahedron", "wedge", "pyramid"} else 2
        for name, (tag, dim) in tag_names.items():
            found = np.flatnonzero(tags["physical"] == tag)
            if dim == dimension and len(found):
                groups[name] = found
    return structural(
        path, points, kept, numbers=numbers[index], node_numbers=node_numbers, groups=groups,
        tags={name: values for name, values in tags.items() if len(values) == len(index)}, tag_names=tag_names,
    )  # fmt: skip


@dataclass
class _Cursor:
    """Numbers one after the other, as text or binary."""

    data: bytes
    at: int
    words: list[bytes] | None

    def take(self, count: int, code: str) -> list[int]:
        """Return the next integers; `code` is struct's, for binary files."""
        if self.words is not None:
            found = self.words[self.at : self.at + count]
            self.at += count
            return [int(word) for word in found]
        size = struct.calcsize(f"={code}")
        found_here = np.frombuffer(self.data, np.dtype(f"={code.lower() if code != 'Q' else 'u8'}"), count, self.at)
        self.at += size * count
        return [int(value) for value in found_here]

    def skip(self, count: int, size: int) -> None:
        """Pass over numbers."""
        self.at += count if self.words is not None else count * size


def _numbers(path: Path) -> tuple[Labels, Labels]:
    """Return node numbers and element numbers in the order of the file."""
    data = path.read_bytes()
    try:
        head = data[data.index(b"$MeshFormat") :].split(b"\n", 2)[1].split()
        version, binary = float(head[0]), int(head[1]) == 1
        nodes, elements = (_section(data, name, binary) for name in (b"Nodes", b"Elements"))
        if version >= 4.0:
            return np.array(_nodes_4(nodes), np.int64), np.array(_elements_4(elements), np.int64)
        return np.array(_nodes_2(nodes), np.int64), np.array(_elements_2(elements, binary), np.int64)
    except (ValueError, IndexError, KeyError) as error:
        raise InputFileError(f"{path}: its element numbers cannot be read ({error}); save it again with Gmsh") from None


def _section(data: bytes, name: bytes, binary: bool) -> _Cursor:
    """Return a cursor at the first number of a section."""
    start = data.index(b"\n", data.index(b"$" + name)) + 1
    if binary:
        return _Cursor(data, start, None)
    return _Cursor(data, 0, data[start : data.index(b"$End" + name, start)].split())


def _nodes_4(cursor: _Cursor) -> list[int]:
    blocks = cursor.take(4, "Q")[0]
    out: list[int] = []
    for _ in range(blocks):
        parametric = cursor.take(3, "i")[2]
        count = cursor.take(1, "Q")[0]
        if parametric:
            raise ValueError("parametric nodes")
        out += cursor.take(count, "Q")
        cursor.skip(3 * count, 8)
    return out


def _elements_4(cursor: _Cursor) -> list[int]:
    blocks = cursor.take(4, "Q")[0]
    out: list[int] = []
    for _ in range(blocks):
        kind = cursor.take(3, "i")[2]
        count = cursor.take(1, "Q")[0]
        width = 1 + _node_count(kind)
        out += cursor.take(count * width, "Q")[::width]
    return out


def _line_count(cursor: _Cursor) -> int:
    """Return the count that version 2 writes as text in both of its forms."""
    if cursor.words is not None:
        return cursor.take(1, "i")[0]
    end = cursor.data.index(b"\n", cursor.at)
    count = int(cursor.data[cursor.at : end])
    cursor.at = end + 1
    return count


def _nodes_2(cursor: _Cursor) -> list[int]:
    out: list[int] = []
    for _ in range(_line_count(cursor)):
        out += cursor.take(1, "i")
        cursor.skip(3, 8)
    return out


def _elements_2(cursor: _Cursor, binary: bool) -> list[int]:
    total, out = _line_count(cursor), list[int]()
    while len(out) < total:
        if binary:
            kind, count, tags = cursor.take(3, "i")
            width = 1 + tags + _node_count(kind)
            out += cursor.take(count * width, "i")[::width]
        else:
            number, kind, tags = cursor.take(3, "i")
            cursor.skip(tags + _node_count(kind), 4)
            out.append(number)
    return out


def _node_count(kind: int) -> int:
    """Return the number of nodes of a Gmsh element type."""
    from meshio._mesh import num_nodes_per_cell
    from meshio.gmsh.common import _gmsh_to_meshio_type

    return int(num_nodes_per_cell[_gmsh_to_meshio_type[kind]])
