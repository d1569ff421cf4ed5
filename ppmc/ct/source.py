"""Grey-value volumes of any common kind, read in blocks; `formats` has a file for each kind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from ppmc.ct.formats import opener_of
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.scene.sections.ct import VolumeSource

__all__ = ["Volume", "open_volume"]


@contextmanager
def open_volume(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a volume.

    Parameters
    ----------
    path : Path
        File or folder of slices; the ending, or what the folder holds, tells the kind.
    source : VolumeSource
        What the scene says about files that do not describe themselves, and what it chooses.

    Raises
    ------
    InputFileError
        If the file is missing, damaged, of no known kind, or does not have the shape it should.
    SceneError
        If the scene lacks what a raw file needs.
    """
    path = Path(path)
    if not path.exists():
        raise InputFileError(f"{path}: no such file or folder; give the CT volume with --input or ct: source: path:")
    with ExitStack() as stack:
        volume = stack.enter_context(opener_of(path, source)(path, source))
        if volume.dtype.kind not in "uif":
            raise InputFileError(f"{path}: holds {volume.dtype}; grey values must be integer or floating-point numbers")
        if min(volume.shape) < 1:
            raise InputFileError(f"{path}: has shape {volume.shape}; there are no voxels in it")
        if source.no_data != "refuse":
            volume = replace(volume, leave_out=True, fill_value=None if source.no_data == "mask" else source.no_data)
            volume = volume.within(volume.read_mask)
        yield volume
