"""DICOM: a folder with the slices of one series, or one file of many frames."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.formats.array import Spacing
from ppmc.ct.volume import Box, Volume
from ppmc.errors import InputFileError
from ppmc.scene.sections.ct import VolumeSource

EVEN = 0.01
"""Relative difference of slice distances from which slices are missing."""


def is_dicom(path: Path) -> bool:
    """Return whether a file says that it is DICOM; many have no ending."""
    with path.open("rb") as opened:
        return opened.read(132)[128:] == b"DICM"


def _library(path: Path) -> Any:
    try:
        import pydicom
    except ImportError:
        raise InputFileError(f"{path}: reading DICOM needs the package pydicom: pip install 'ppmc[volumes]'") from None
    return pydicom


def _read(path: Path, **options: Any) -> Any:
    try:
        return _library(path).dcmread(path, **options)
    except InputFileError:
        raise
    except Exception as error:  # pydicom passes on whatever parsers raise
        raise InputFileError(f"{path}: cannot be read as DICOM: {error}") from None


def _pixels(dataset: Any, path: Path) -> NDArray[Any]:
    """Return the grey values, rescaled as the file says."""
    try:
        values = np.asarray(dataset.pixel_array)
    except Exception as error:  # decoders raise whatever they meet
        raise InputFileError(
            f"{path}: its pixels cannot be decoded ({error}); pip install pylibjpeg, or save them uncompressed"
        ) from None
    slope, intercept = float(dataset.get("RescaleSlope", 1)), float(dataset.get("RescaleIntercept", 0))
    if (slope, intercept) == (1.0, 0.0):
        return values
    return (values * slope + intercept).astype(np.float32)


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open one file of many frames."""
    dataset = _read(path)
    values = _pixels(dataset, path)
    if values.ndim != 3 or int(dataset.get("SamplesPerPixel", 1)) != 1:
        raise InputFileError(f"{path}: holds an array {values.shape}; give the folder with all slices of the series")
    rows = dataset.get("PixelSpacing")
    step = dataset.get("SpacingBetweenSlices", dataset.get("SliceThickness"))
    spacing = (float(rows[1]), float(rows[0]), float(step)) if rows and step else None
    nz, ny, nx = values.shape
    yield Volume(path, (nz, ny, nx), values.dtype, lambda box: values[box], spacing)


@contextmanager
def folder(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a folder of slices, in the order in which they lie along their normal."""
    files = sorted(f for f in path.iterdir() if f.is_file() and not f.name.startswith(".") and is_dicom(f))
    heads = [(f, _read(f, stop_before_pixels=True)) for f in files]
    series = sorted({str(head.get("SeriesInstanceUID", "")) for _, head in heads})
    if len(series) > 1:
        first = {str(head.get("SeriesInstanceUID", "")): f.name for f, head in reversed(heads)}
        raise InputFileError(
            f"{path}: holds {len(series)} series ({', '.join(f'{first[s]}: ...{s[-12:]}' for s in series[:4])}); put "
            "each into its own folder"
        )
    alike = {(int(h.Rows), int(h.Columns), int(h.BitsAllocated), int(h.get("SamplesPerPixel", 1))) for _, h in heads}
    if len(alike) > 1 or next(iter(alike))[3] != 1:
        raise InputFileError(f"{path}: its slices differ or are coloured: {sorted(alike)}")
    ordered, step = _in_order(heads, path)
    sample = _pixels(_read(ordered[0]), ordered[0])
    ny, nx = sample.shape
    rows = heads[0][1].get("PixelSpacing")
    spacing: Spacing | None = (float(rows[1]), float(rows[0]), step) if rows and step else None

    def read(box: Box) -> NDArray[Any]:
        planes = [_pixels(_read(ordered[z]), ordered[z])[box[1:]] for z in range(*box[0].indices(len(ordered)))]
        return np.stack(planes).astype(sample.dtype, copy=False)

    yield Volume(path, (len(ordered), ny, nx), sample.dtype, read, spacing)


def _in_order(heads: list[tuple[Path, Any]], path: Path) -> tuple[list[Path], float | None]:
    """Return the files in the order of their place, and the distance between slices."""
    if all("ImagePositionPatient" in head and "ImageOrientationPatient" in head for _, head in heads):
        cosines = np.array([float(v) for v in heads[0][1].ImageOrientationPatient])
        normal = np.cross(cosines[:3], cosines[3:])
        at = np.array([np.dot([float(v) for v in head.ImagePositionPatient], normal) for _, head in heads])
    else:
        at = np.array([float(head.get("InstanceNumber", k)) for k, (_, head) in enumerate(heads)])
    order = np.argsort(at, kind="stable")
    gaps = np.diff(at[order])
    if len(gaps) and (gaps.min() <= 0 or gaps.max() - gaps.min() > EVEN * gaps.max()):
        k = int(np.argmin(gaps) if gaps.min() <= 0 else np.argmax(gaps))
        raise InputFileError(
            f"{heads[order[k + 1]][0]}: lies {gaps[k]:.4g} above the slice before, the others {np.median(gaps):.4g}; "
            "slices are missing, doubled or do not belong together"
        )
    placed = all("ImagePositionPatient" in head for _, head in heads)
    head = heads[0][1]
    stated = head.get("SpacingBetweenSlices", head.get("SliceThickness"))
    step = float(gaps.mean()) if len(gaps) and placed else float(stated) if stated else None
    return [heads[k][0] for k in order], step
