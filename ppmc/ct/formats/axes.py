"""Arrays of more than three dimensions: which of their axes are z, y, x, and which entry of the others is meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ppmc.errors import InputFileError
from ppmc.notices import notice
from ppmc.scene.sections.ct import VolumeSource

NAMES = {"C": "channel", "T": "time", "S": "channel"}
"""Axes with a key of their own in the scene; tifffile calls the colours of a pixel S."""


@dataclass(frozen=True)
class Chosen:
    """How to get (z, y, x) out of an array.

    Attributes
    ----------
    index : tuple of (int or None)
        Entry of each axis; None for z, y, x.
    shape : tuple of int
        (nz, ny, nx).
    order : tuple of int
        Axis of z, y and x among those left.
    """

    index: tuple[int | None, ...]
    shape: tuple[int, int, int]
    order: tuple[int, int, int]


def choose(
    axes: str, shape: Sequence[int], source: VolumeSource, path: Path, channel_names: Sequence[str] = ()
) -> Chosen:
    """Choose a volume of an array with named axes.

    Parameters
    ----------
    axes : str
        A letter an axis: Z, Y, X, C (channel), T (time), S (colours of a pixel), others without a name.
    shape : sequence of int
    source : VolumeSource
        With `channel`, `time` and `index`.
    path : Path
        Names the file in messages.
    channel_names : sequence of str
        Names of the channels, where the file has them.

    Raises
    ------
    InputFileError
        If an axis with several entries is neither z, y, x nor chosen, or a choice does not exist.
    """
    if not {"Y", "X"} <= set(axes):
        raise InputFileError(f"{path}: its axes are {axes}; slices with axes Y and X are needed")
    sizes = [f"{a} {n}" for a, n in zip(axes, shape, strict=True)]
    long = [k for k, a in enumerate(axes) if a not in "ZYX" and shape[k] > 1]
    z = axes.find("Z")
    if z < 0 or (shape[z] == 1 and len(long) == 1 and not _is_chosen(axes[long[0]], source)):
        # A stack that calls its slices frames or images has one long axis besides y and x.
        free = [k for k in long if not _is_chosen(axes[k], source) and axes[k] != "S"]
        if len(free) == 1:
            z = free[0]
            if axes[z] in NAMES:
                notice(f"{path}: takes its {shape[z]} {NAMES[axes[z]]}s for slices, as it has no others")
    index: list[int | None] = []
    unnamed = list(source.index or ())
    for k, (axis, n) in enumerate(zip(axes, shape, strict=True)):
        if k == z or axis in "YX":
            index.append(None)
        elif axis in NAMES:
            index.append(_entry(axis, n, source, path, channel_names, sizes))
        elif unnamed:
            index.append(_checked(unnamed.pop(0), n, "index", path))
        elif n == 1:
            index.append(0)
        else:
            raise InputFileError(
                f"{path}: has {len(axes)} dimensions ({', '.join(sizes)}); choose one entry of each axis that is not "
                "z, y or x with ct: source: index: [0]"
            )
    kept = [k for k, i in enumerate(index) if i is None]
    if z < 0:
        one = f"{shape[axes.find('Y')]} x {shape[axes.find('X')]}"
        raise InputFileError(f"{path}: is one image of {one}; grey-value slices are needed")
    order = (kept.index(z), kept.index(axes.find("Y")), kept.index(axes.find("X")))
    return Chosen(tuple(index), (shape[z], shape[axes.find("Y")], shape[axes.find("X")]), order)


def _is_chosen(axis: str, source: VolumeSource) -> bool:
    key = NAMES.get(axis)
    return key is not None and getattr(source, key) is not None


def _entry(
    axis: str, n: int, source: VolumeSource, path: Path, channel_names: Sequence[str], sizes: Sequence[str]
) -> int:
    """Return the chosen channel or time."""
    key = NAMES[axis]
    wanted: int | str | None = getattr(source, key)
    if wanted is None:
        if n == 1:
            return 0
        named = f" (named {', '.join(channel_names)})" if key == "channel" and channel_names else ""
        raise InputFileError(
            f"{path}: has {n} {key}s{named} ({', '.join(sizes)}); choose one with ct: source: {key}: 0, counted from 0"
        )
    if isinstance(wanted, str):
        if wanted in channel_names:
            return list(channel_names).index(wanted)
        raise InputFileError(
            f"{path}: has no channel '{wanted}'; "
            + (f"its channels are {', '.join(channel_names)}" if channel_names else f"give its number, 0 to {n - 1}")
        )
    return _checked(wanted, n, key, path)


def _checked(wanted: int, n: int, key: str, path: Path) -> int:
    if not 0 <= wanted < n:
        raise InputFileError(f"{path}: ct: source: {key}: {wanted} does not exist; there are {n}, counted from 0")
    return wanted


def leading(shape: Sequence[int]) -> str:
    """Return names for the axes of an array without any: the last three are z, y, x, or the only three with length."""
    free = "QPONMLKJIHG"
    long = [k for k, n in enumerate(shape) if n > 1]
    volume = long if len(long) == 3 else list(range(len(shape)))[-3:]
    names = iter(free)
    return "".join("ZYX"[volume.index(k)] if k in volume else next(names) for k in range(len(shape)))
