"""NRRD: .nrrd, and .nhdr with its data beside it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ppmc.ct.formats.array import Spacing, in_mm, volume_of
from ppmc.ct.formats.axes import choose, leading
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.notices import notice
from ppmc.scene.sections.ct import VolumeSource


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open an NRRD file; lengths without a unit are mm."""
    try:
        import nrrd
    except ImportError:
        raise InputFileError(f"{path}: reading NRRD needs the package pynrrd: pip install 'ppmc[volumes]'") from None
    try:
        data, header = nrrd.read(str(path), index_order="C")
    except Exception as error:  # pynrrd passes on whatever parsers and codecs raise
        raise InputFileError(f"{path}: cannot be read as NRRD: {error}") from None
    if data.ndim < 3:
        raise InputFileError(f"{path}: has shape {data.shape}; a volume has three dimensions (z, y, x)")
    # In the order of C the file's first axis comes last: a first axis that is no domain is one of channels.
    kinds = [str(k).lower() for k in header.get("kinds", [])][::-1]
    axes = leading(data.shape)
    if len(kinds) == data.ndim > 3 and kinds[-1] not in ("domain", "space"):
        axes = leading(data.shape[:-1]) + "C"
    yield volume_of(path, data, choose(axes, data.shape, source, path), _spacing(header, path))


def _spacing(header: Any, path: Path) -> Spacing | None:
    """Return the voxel size (x, y, z), mm."""
    units = [str(u) for u in header.get("space units", header.get("units", []))]
    directions = header.get("space directions")
    if directions is not None:
        rows = np.array([row for row in np.asarray(directions, dtype=float) if np.isfinite(row).all()])
        if rows.shape != (3, 3):
            return None
        sizes = np.linalg.norm(rows, axis=1)
        if not np.allclose(rows, np.diag(sizes)):
            notice(f"{path}: its grid is turned in space, which is not followed: x, y, z are those of the voxels")
    else:
        sizes = np.asarray(header.get("spacings", []), dtype=float)
        sizes = sizes[np.isfinite(sizes)]
    if len(sizes) != 3:
        return None
    named = [u for u in units if u.strip()][-3:]
    found = named if len(named) == 3 else ["mm"] * 3
    return in_mm((sizes[0], sizes[1], sizes[2]), (found[0], found[1], found[2]))
