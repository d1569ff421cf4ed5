"""What cards of element axes have in common: numbers on lines, axes in a part's own frame, elements in tens."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from ppmc.analysis.mesh.mapping import MappedElements
from ppmc.analysis.mesh.mesh import MeshPart
from ppmc.files import whole_file
from ppmc.files.beside import mark

NUMBERS_A_LINE = 16


def write_text(path: Path, lines: Iterable[str]) -> None:
    """Write lines to a file, whole or not at all; decks are told to be ours by how they begin."""
    with whole_file(path) as temporary:
        with temporary.open("w", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in lines)
        if path.suffix == ".msh":
            mark(temporary, path.suffix)


def in_lines(words: Iterable[object], per_line: int = NUMBERS_A_LINE) -> Iterator[str]:
    """Yield words joined by commas, so many a line, a comma behind all lines but the last."""
    texts = [str(word) for word in words]
    chunks = [", ".join(texts[k : k + per_line]) for k in range(0, len(texts), per_line)]
    for k, chunk in enumerate(chunks):
        yield f"{chunk}," if k < len(chunks) - 1 else chunk


def frames_of(elements: MappedElements, part: MeshPart) -> np.ndarray:
    """Return p, q, r of the elements of a part in the part's own axes, shape (n, 3, 3), NaN where unknown.

    A solver turns what stands in a part with its instance. Fibres have no sign: p and q keep the one that leaves p
    nearest to the model's.
    """
    index = slice(part.start, part.stop)
    frames = np.stack(
        [elements.fibre_direction[index], elements.in_plane_direction[index], elements.platelet_normal[index]], axis=1
    )
    turned = frames @ part.rotation
    flip = np.einsum("ni,ni->n", turned[:, 0], frames[:, 0]) < 0.0
    turned[flip, :2] *= -1.0
    return np.asarray(turned)
