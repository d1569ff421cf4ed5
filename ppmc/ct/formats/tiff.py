"""TIFF: files of many pages, ImageJ and OME hyperstacks, and folders of any of them.

What a file holds is tifffile's understanding of it (its series and their axes). Data that lie in one piece, as those of
ImageJ's stacks above 4 GB, whose pages have no directory of their own, are read where they lie.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.formats.array import Spacing, in_mm, volume_of
from ppmc.ct.formats.axes import Chosen, choose
from ppmc.ct.formats.slices import in_order
from ppmc.ct.volume import Box, Volume
from ppmc.errors import InputFileError
from ppmc.scene.sections.ct import VolumeSource

ENDINGS = {".tif", ".tiff"}


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open one file."""
    with _opened(path) as tiff:
        series = _series(tiff, path, source)
        chosen = choose(series.axes, series.shape, source, path, _channel_names(tiff))
        yield _volume(tiff, series, chosen, path)


@contextmanager
def folder(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open a folder of slices or of stacks, one after the other in the order of the numbers in their names."""
    files = in_order(path, ENDINGS)
    with ExitStack() as stack:
        first = stack.enter_context(_opened(files[0]))
        series = _series(first, files[0], source)
        if len({page.parent.filename for page in series.pages if page is not None}) > 1:
            # The files of one OME set know each other.
            chosen = choose(series.axes, series.shape, source, path, _channel_names(first))
            yield _volume(first, series, chosen, path)
            return
        heads = [_part(f, source) for f in files]
        for head in heads[1:]:
            if (head.shape[1:], head.dtype) != (heads[0].shape[1:], heads[0].dtype):
                raise InputFileError(
                    f"{head.path}: is {head.shape[1:]} {head.dtype}, but {heads[0].path.name} is {heads[0].shape[1:]} "
                    f"{heads[0].dtype}; all slices of a stack must be alike"
                )
        ends = np.cumsum([0, *(head.shape[0] for head in heads)])

        def read(box: Box) -> NDArray[Any]:
            start, stop, _ = box[0].indices(int(ends[-1]))
            planes = []
            for k in range(int(np.searchsorted(ends, start, "right")) - 1, len(heads)):
                if ends[k] >= stop:
                    break
                z = slice(max(start - int(ends[k]), 0), min(stop - int(ends[k]), heads[k].shape[0]))
                with _opened(files[k]) as tiff:
                    part = _of_file(tiff, files[k], source)
                    planes.append(part.read((z, *box[1:])))
            return np.concatenate(planes)

        ny, nx = heads[0].shape[1:]
        yield Volume(path, (int(ends[-1]), ny, nx), heads[0].dtype, read, heads[0].spacing)


@dataclass(frozen=True)
class _Head:
    """What is known of one file of a folder without reading its pixels."""

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    spacing: Spacing | None


def _part(path: Path, source: VolumeSource) -> _Head:
    with _opened(path) as tiff:
        volume = _of_file(tiff, path, source)
        return _Head(path, volume.shape, volume.dtype, volume.spacing)


def _of_file(tiff: Any, path: Path, source: VolumeSource) -> Volume:
    """Return what one file of a folder holds: a slice, or a stack of them."""
    series = _series(tiff, path, source)
    axes, shape = series.axes, series.shape
    if not any(n > 1 for a, n in zip(axes, shape, strict=True) if a not in "YXS"):
        # One slice: give it the axis that a stack of them has.
        axes, shape = f"Z{axes.replace('Z', 'Q')}", (1, *shape)
    chosen = choose(axes, shape, source, path, _channel_names(tiff))
    if len(axes) > len(series.axes):
        data = _page_array(series, path)[None]
        return volume_of(path, data, chosen, _spacing(tiff, series))
    return _volume(tiff, series, chosen, path)


def _page_array(series: Any, path: Path) -> NDArray[Any]:
    """Return the only image of a series, with all its axes."""
    return _image(series, 0, path).reshape(series.shape)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a TIFF file; tifffile's faults become ours.

    Files to which tifffile wrote slices one at a time hold a series for each, which make one stack if they are alike.
    """
    import tifffile

    try:
        tiff = tifffile.TiffFile(path)
        if tiff.is_shaped and len({(s.axes, s.shape, s.dtype) for s in tiff.series}) == 1 < len(tiff.series):
            tiff.close()
            tiff = tifffile.TiffFile(path, is_shaped=False)
    except (tifffile.TiffFileError, OSError, ValueError, IndexError) as error:
        raise InputFileError(f"{path}: cannot be read as TIFF: {error}") from None
    with tiff:
        yield tiff


def _series(tiff: Any, path: Path, source: VolumeSource) -> Any:
    """Return the series that the scene chooses, or the only one."""
    try:
        every = list(tiff.series)
    except Exception as error:  # metadata of others
        raise InputFileError(f"{path}: its pages cannot be understood as images: {error}") from None
    if not every:
        raise InputFileError(f"{path}: is a TIFF file without images")
    if source.series is not None:
        if source.series >= len(every):
            raise InputFileError(f"{path}: ct: source: series: {source.series} does not exist; there are {len(every)}")
        return every[source.series]
    if len(every) > 1:
        listing = ", ".join(f"{k}: {s.axes} {tuple(s.shape)} {s.dtype}" for k, s in enumerate(every[:6]))
        raise InputFileError(
            f"{path}: its images are not alike and form {len(every)} series ({listing}); all slices of a stack must "
            "be alike, or choose one with ct: source: series: 0"
        )
    promised = int((tiff.imagej_metadata or {}).get("images", 1)) if tiff.is_imagej else 1
    held = int(np.prod([n for a, n in zip(every[0].axes, every[0].shape, strict=True) if a not in "YXS"]))
    if held < promised:
        raise InputFileError(
            f"{path}: says that it holds {promised} images, but {held} are there; the file is truncated"
        )
    return every[0]


def _volume(tiff: Any, series: Any, chosen: Chosen, path: Path) -> Volume:
    """Return the chosen volume of a series."""
    spacing = _spacing(tiff, series)
    size = path.stat().st_size if path.is_file() else None
    if series.dataoffset is not None and path.is_file():
        dtype = np.dtype(series.dtype).newbyteorder(tiff.byteorder)
        need = series.dataoffset + int(np.prod(series.shape, dtype=np.int64)) * dtype.itemsize
        if size is not None and need > size:
            raise InputFileError(
                f"{path}: its images end at byte {need:,} beyond the file's {size:,} bytes; the file is truncated"
            )
        _page(series, len(series.pages) - 1, path)
        return volume_of(path, np.memmap(path, dtype, "r", series.dataoffset, series.shape), chosen, spacing)
    # Axes of a page come last in the series; the others count pages.
    inner = len(series.keyframe.shape)
    counts = series.shape[: len(series.shape) - inner]
    turn = threading.Lock()

    class Pages:
        """Pages as an array: outer axes count pages, inner ones lie in them."""

        dtype = series.dtype
        shape = series.shape

        def __getitem__(self, index: tuple[slice | int, ...]) -> NDArray[Any]:
            outer, rest = index[: len(counts)], index[len(counts) :]
            spans = [range(*i.indices(n)) if isinstance(i, slice) else [i] for i, n in zip(outer, counts, strict=True)]
            grid: list[tuple[int, ...]] = list(product(*spans))
            # All threads read through one file handle, and a page is a seek followed by a read.
            with turn:
                found = [
                    _image(series, int(np.ravel_multi_index(k, counts)) if counts else 0, path)[rest] for k in grid
                ]
            kept = [len(s) for i, s in zip(outer, spans, strict=True) if isinstance(i, slice)]
            return np.stack(found).reshape(*kept, *found[0].shape)

    return volume_of(path, Pages(), chosen, spacing)


def _page(series: Any, number: int, path: Path) -> Any:
    """Return a page of a series.

    Raises
    ------
    InputFileError
        If it is missing, or the file ends before it.
    """
    try:
        page = series.pages[number]
    except Exception as error:  # tifffile's own errors and those of parsing what is not there
        raise InputFileError(f"{path}: page {number} cannot be read ({error}); the file is truncated") from None
    if page is None:
        raise InputFileError(f"{path}: image {number} of its series is missing")
    return page


def _image(series: Any, number: int, path: Path) -> NDArray[Any]:
    """Return the image of a page; tifffile fills what a truncated file lacks with zeros, so that is checked here."""
    page = _page(series, number, path)
    source = Path(page.parent.filehandle.path)
    size = source.stat().st_size
    if any(a + n > size for a, n in zip(page.dataoffsets, page.databytecounts, strict=True)):
        raise InputFileError(f"{path}: page {page.index} ends beyond the file's {size:,} bytes; the file is truncated")
    try:
        return np.asarray(page.asarray())
    except Exception as error:  # tifffile's decoders raise whatever they meet
        hint = "; pip install 'ppmc[codecs]'" if "imagecodecs" in str(error) else ""
        raise InputFileError(f"{path}: page {page.index} is damaged or cannot be decoded: {error}{hint}") from None


def _channel_names(tiff: Any) -> list[str]:
    """Return the names of the channels that OME or ImageJ gives."""
    if tiff.is_ome:
        import tifffile

        pixels = _ome_pixels(tifffile, tiff)
        channels = pixels.get("Channel", []) if pixels else []
        channels = channels if isinstance(channels, list) else [channels]
        return [str(channel.get("Name", "")) for channel in channels]
    labels = (tiff.imagej_metadata or {}).get("Labels") if tiff.is_imagej else None
    return [str(label) for label in labels] if isinstance(labels, list) else []


def _ome_pixels(tifffile: Any, tiff: Any) -> dict[str, Any] | None:
    """Return the description of the first OME image."""
    try:
        image = tifffile.xml2dict(tiff.ome_metadata)["OME"]["Image"]
        image = image[0] if isinstance(image, list) else image
        return dict(image["Pixels"])
    except (KeyError, TypeError, ValueError, SyntaxError, IndexError):
        return None


def _spacing(tiff: Any, series: Any) -> Spacing | None:
    """Return the voxel size (x, y, z) in mm that ImageJ or OME states; resolutions of plain TIFF are for printers."""
    if tiff.is_ome:
        import tifffile

        pixels = _ome_pixels(tifffile, tiff) or {}
        sizes = tuple(pixels.get(f"PhysicalSize{a}") for a in "XYZ")
        units = tuple(str(pixels.get(f"PhysicalSize{a}Unit", "µm")) for a in "XYZ")
        return in_mm(sizes, units)  # type: ignore[arg-type]
    if not tiff.is_imagej:
        return None
    metadata = tiff.imagej_metadata or {}
    tags = series.keyframe.tags
    per_unit = []
    for name in ("XResolution", "YResolution"):
        value = tags[name].value if name in tags else None
        per_unit.append(value[1] / value[0] if isinstance(value, tuple) and value[0] else None)
    unit = str(metadata.get("unit", ""))
    return in_mm((per_unit[0], per_unit[1], metadata.get("spacing")), (unit, unit, unit))
