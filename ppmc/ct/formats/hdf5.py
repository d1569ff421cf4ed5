"""HDF5 of other programs: any dataset of three or more dimensions, compressed by any filter that is installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ppmc.ct.formats.array import volume_of
from ppmc.ct.formats.axes import choose, leading
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.scene.sections.ct import VolumeSource

FILTERS = {
    305: "LZO", 307: "bzip2", 32000: "LZF", 32001: "Blosc", 32004: "LZ4", 32008: "bitshuffle", 32013: "ZFP",
    32015: "Zstandard", 32017: "SZ", 32019: "JPEG", 32024: "SZ3", 32026: "Blosc2", 32028: "Blosc2 grok", 32029: "SPERR",
}  # fmt: skip
"""Registered filters that scans come with, by number (HDF Group, registered filter plugins)."""
MOST_LISTED = 12


@contextmanager
def file(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open the dataset that the scene names, or the only one that can be a volume."""
    from ppmc.files.guard import dataset_of, open_guarded

    with open_guarded(path, "volume") as opened:
        data = dataset_of(opened, source.dataset or _only_volume(opened, path), path)
        if data.ndim < 3:
            raise InputFileError(f"{path}: {data.name} has shape {data.shape}; a volume has three dimensions (z, y, x)")
        _need_filters(data, path)
        yield volume_of(path, data, choose(leading(data.shape), data.shape, source, path))


def _only_volume(opened: Any, path: Path) -> str:
    """Return the name of the only dataset of three or more dimensions."""
    import h5py

    found: list[tuple[str, tuple[int, ...]]] = []
    links: list[str] = []

    def look(name: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            links.append(f"{name} -> {link.filename}:{link.path}")
        elif isinstance(link, h5py.HardLink):
            item = opened[name]
            if isinstance(item, h5py.Dataset) and item.ndim >= 3:
                found.append((name, item.shape))

    opened.visititems_links(look)
    volumes = [name for name, shape in found if len(shape) == 3] or [name for name, _ in found]
    if len(volumes) == 1:
        return volumes[0]
    listing = ", ".join(f"{name} {shape}" for name, shape in found[:MOST_LISTED]) or "none"
    message = f"{path}: name the volume with ct: source: dataset:; datasets of three dimensions or more: {listing}"
    if not found and links:
        message = (
            f"{path}: keeps its data in other files ({', '.join(links[:MOST_LISTED])}); open that file, or copy the "
            "data in with h5repack"
        )
    raise InputFileError(message)


def _need_filters(data: Any, path: Path) -> None:
    """Refuse data whose compression cannot be undone here; hdf5plugin brings most filters if it is there."""
    import h5py

    def missing() -> list[int]:
        plist = data.id.get_create_plist()
        codes = [plist.get_filter(k)[0] for k in range(plist.get_nfilters())]
        return [code for code in codes if not h5py.h5z.filter_avail(code)]

    if missing():
        with suppress(ImportError):
            import hdf5plugin  # noqa: F401  (registers its filters when imported)
    if missing():
        code = missing()[0]
        raise InputFileError(
            f"{path}: {data.name} is compressed by a filter that is not installed ({code} "
            f"{FILTERS.get(code, 'of unknown name')}): pip install 'ppmc[hdf5]' (hdf5plugin)"
        )
