"""Kinds of volumes: one file a kind, chosen by the ending or by what a folder holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from ppmc.ct.formats import dicom, hdf5, metaimage, nifti, nrrd, numpy, own, pictures, raw, tiff, zarr
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.notices import notice
from ppmc.scene.sections.ct import VolumeSource

Opener = Callable[[Path, VolumeSource], AbstractContextManager[Volume]]

FILES: dict[str, Opener] = {
    ".vtkhdf": own.file,
    **dict.fromkeys((".h5", ".hdf5", ".hdf", ".nxs", ".he5"), hdf5.file),
    **dict.fromkeys((".tif", ".tiff", ".btf"), tiff.file),
    ".zarr": zarr.store,
    **dict.fromkeys((".mhd", ".mha"), metaimage.file),
    **dict.fromkeys((".nrrd", ".nhdr"), nrrd.file),
    **dict.fromkeys((".nii", ".nii.gz", ".hdr"), nifti.file),
    **dict.fromkeys((".dcm", ".dicom"), dicom.file),
    **dict.fromkeys((".npy", ".npz"), numpy.file),
    **dict.fromkeys((".raw", ".bin", ".dat", ".vol"), raw.file),
}
FOLDERS: dict[str, Opener] = {
    **dict.fromkeys((".tif", ".tiff"), tiff.folder),
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".bmp"), pictures.folder),
    **dict.fromkeys((".dcm", ".dicom"), dicom.folder),
}


def opener_of(path: Path, source: VolumeSource) -> Opener:
    """Return what opens a file or folder.

    Raises
    ------
    InputFileError
        If its kind is not known.
    """
    if any((path / name).exists() for name in (".zarray", ".zgroup", "zarr.json")):
        return zarr.store
    if path.is_dir() and path.suffix.lower() != ".zarr":
        return _folder(path)
    ending = ".nii.gz" if path.name.lower().endswith(".nii.gz") else path.suffix.lower()
    if ending in FILES:
        return FILES[ending]
    if source.shape is not None:
        return raw.file
    if not path.is_dir() and dicom.is_dicom(path):
        return dicom.file
    raise InputFileError(
        f"{path}: unknown kind of file '{ending}'; known are {', '.join(FILES)}, folders of "
        f"{', '.join(FOLDERS)}, and raw files with ct: source: shape: and dtype:"
    )


def _folder(path: Path) -> Opener:
    """Return what opens the slices that most files of a folder are; others are told."""
    files = sorted(f for f in path.iterdir() if f.is_file() and not f.name.startswith("."))
    kinds: Counter[Opener] = Counter()
    strangers = []
    for f in files:
        opener = FOLDERS.get(f.suffix.lower())
        if opener is None and dicom.is_dicom(f):
            opener = dicom.folder
        if opener is None:
            strangers.append(f.name)
        else:
            kinds[opener] += 1
    if not kinds:
        raise InputFileError(f"{path}: folder without slices; known are {', '.join(FOLDERS)}")
    (opener, count), *others = kinds.most_common()
    if others and others[0][1] > 1:
        raise InputFileError(
            f"{path}: holds slices of more than one kind ({count} and {others[0][1]} files); give each a folder"
        )
    if others or strangers:
        aside = sum(n for _, n in others) + len(strangers)
        shown = f", such as {strangers[0]}" if strangers else ""
        notice(f"{path}: {aside} of {len(files)} files are no slices and are left aside{shown}")
    return opener
