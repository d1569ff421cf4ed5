"""ppmc's own volume files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ppmc.ct.volume import Volume
from ppmc.scene.sections.ct import VolumeSource


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a volume file with its place and its mask."""
    from ppmc.files import read_voxels

    with read_voxels(path, "volume") as voxels:
        dtype = np.asarray(voxels.read("grey", (slice(0, 1), slice(0, 1), slice(0, 1)))).dtype
        grid = voxels.grid
        yield Volume(
            path, grid.shape, dtype, lambda box: voxels.read("grey", box), grid.spacing, grid.origin, grid.direction,
            (lambda box: voxels.read("mask", box)) if "mask" in voxels.names else None,
        )  # fmt: skip
