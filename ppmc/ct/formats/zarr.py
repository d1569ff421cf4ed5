"""Zarr arrays, and OME-Zarr images with their axes and voxel size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ppmc.ct.formats.array import Spacing, in_mm, volume_of
from ppmc.ct.formats.axes import choose, leading
from ppmc.ct.volume import Volume
from ppmc.errors import InputFileError
from ppmc.scene.sections.ct import VolumeSource


@contextmanager
def store(path: Path, source: VolumeSource) -> Iterator[Volume]:
    """Open an array, the array that the scene names, or the finest level of an OME-Zarr image."""
    try:
        import zarr
    except ImportError:
        raise InputFileError(f"{path}: reading Zarr needs the package zarr: pip install 'ppmc[zarr]'") from None
    try:
        node: Any = zarr.open(str(path), mode="r")
    except Exception as error:  # stores and codecs raise whatever they meet
        raise InputFileError(f"{path}: cannot be read as a Zarr array ({error})") from None
    axes, spacing, names = None, None, []
    try:
        image = _image(node)
        if image is not None and source.dataset is None:
            level = image["datasets"][0]
            axes = "".join(str(a["name"] if isinstance(a, dict) else a)[0].upper() for a in image["axes"])
            spacing, names = _spacing(image, level), _channels(node)
            node = node[level["path"]]
        elif source.dataset is not None:
            node = node[source.dataset]
        elif not hasattr(node, "shape"):
            arrays = [f"{name} {array.shape}" for name, array in node.arrays()]
            raise InputFileError(
                f"{path}: is a group; name the array with ct: source: dataset:; it holds {', '.join(arrays) or 'none'}"
            )
        shape = tuple(node.shape)
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise InputFileError(f"{path}: has no array there ({error}); name it with ct: source: dataset:") from None
    if len(shape) < 3:
        raise InputFileError(f"{path}: has shape {shape}; a volume has three dimensions (z, y, x)")
    chosen = choose(axes or leading(shape), shape, source, path, names)
    yield volume_of(path, node, chosen, spacing)


def _image(node: Any) -> Any:
    """Return the first image of an OME-Zarr group (versions 0.4 and 0.5), or None."""
    attributes = dict(node.attrs)
    multiscales = attributes.get("ome", attributes).get("multiscales")
    return multiscales[0] if multiscales else None


def _spacing(image: Any, level: Any) -> Spacing | None:
    """Return the voxel size (x, y, z) of a level, mm."""
    scale: list[float] | None = None
    for steps in (level.get("coordinateTransformations", []), image.get("coordinateTransformations", [])):
        for step in steps:
            if step.get("type") == "scale":
                scale = [a * b for a, b in zip(scale or [1.0] * len(step["scale"]), step["scale"], strict=True)]
    named = {a["name"]: k for k, a in enumerate(image["axes"]) if isinstance(a, dict)}
    if scale is None or not {"x", "y", "z"} <= set(named):
        return None
    sizes = tuple(scale[named[a]] for a in "xyz")
    units = tuple(str(image["axes"][named[a]].get("unit", "")) for a in "xyz")
    return in_mm(sizes, units)  # type: ignore[arg-type]


def _channels(node: Any) -> list[str]:
    """Return the labels of the channels."""
    attributes = dict(node.attrs)
    channels = attributes.get("ome", attributes).get("omero", {}).get("channels", [])
    return [str(channel.get("label", "")) for channel in channels]
