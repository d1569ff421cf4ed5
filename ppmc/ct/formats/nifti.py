"""NIfTI: .nii, .nii.gz and .hdr/.img pairs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ppmc.ct.formats.array import in_mm, reader
from ppmc.ct.formats.axes import choose
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.notices import notice
from ppmc.scene.sections.ct import VolumeSource


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a NIfTI file; its array is indexed x, y, z, time; the header's scaling is applied."""
    try:
        import nibabel
    except ImportError:
        raise InputFileError(f"{path}: reading NIfTI needs the package nibabel: pip install 'ppmc[volumes]'") from None
    try:
        image: Any = nibabel.load(path)
        data = image.dataobj
        dtype = np.asarray(data[(slice(0, 1),) * len(data.shape)]).dtype
    except Exception as error:  # nibabel passes on whatever parsers and codecs raise
        raise InputFileError(f"{path}: cannot be read as NIfTI: {error}") from None
    if len(data.shape) < 3:
        raise InputFileError(f"{path}: has shape {data.shape}; a volume has three dimensions")
    axes = "XYZTQPON"[: len(data.shape)]
    chosen = choose(axes, data.shape, source, path)
    unit = image.header.get_xyzt_units()[0]
    zooms = image.header.get_zooms()
    turned = np.asarray(image.affine)[:3, :3]
    if not np.allclose(turned, np.diag(np.diag(turned))) or (np.diag(turned) < 0).any():
        notice(f"{path}: its grid is turned in space, which is not followed: x, y, z are those of the voxels")
    spacing = in_mm((zooms[0], zooms[1], zooms[2]), ("mm" if unit == "unknown" else unit,) * 3)
    yield Volume(path, chosen.shape, dtype, reader(data, chosen), spacing)
