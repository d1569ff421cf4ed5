"""Volumes out of anything that is indexed like an array."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.formats.axes import Chosen
from ppmc.ct.volume import Box, Read, Volume

MM = {
    "mm": 1.0, "millimeter": 1.0, "millimetre": 1.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "micron": 1e-3,
    "microns": 1e-3, "micrometer": 1e-3, "micrometre": 1e-3, "nm": 1e-6, "nanometer": 1e-6, "nanometre": 1e-6,
    "cm": 10.0, "centimeter": 10.0, "centimetre": 10.0, "m": 1000.0, "meter": 1000.0, "metre": 1000.0, "inch": 25.4,
    "in": 25.4, "angstrom": 1e-7, "å": 1e-7,
}  # fmt: skip
"""Millimetres of the length units that image files name."""

Spacing = tuple[float, float, float]


def in_mm(sizes: tuple[Any, Any, Any], units: tuple[str, str, str]) -> Spacing | None:
    """Return voxel sizes (x, y, z) in mm; None if one is missing, not positive, or in no unit of length."""
    out = []
    for size, unit in zip(sizes, units, strict=True):
        factor = MM.get(unit.strip().lower().replace("\\u00b5", "µ"))
        if size is None or factor is None or not 0.0 < float(size) < 1e9:
            return None
        out.append(float(size) * factor)
    return out[0], out[1], out[2]


def reader(data: Any, chosen: Chosen) -> Read:
    """Return a function that reads boxes of an array as chosen; the array is indexed as NumPy's are."""

    def read(box: Box) -> NDArray[Any]:
        parts: list[slice | int] = []
        here = dict(zip(chosen.order, box, strict=True))
        kept = 0
        for index in chosen.index:
            if index is None:
                parts.append(here[kept])
                kept += 1
            else:
                parts.append(index)
        return np.asarray(data[tuple(parts)]).transpose(chosen.order)

    return read


def volume_of(path: Path, data: Any, chosen: Chosen, spacing: Spacing | None = None, **place: Any) -> Volume:
    """Return the volume that is chosen of an array."""
    return Volume(path, chosen.shape, np.dtype(data.dtype), reader(data, chosen), spacing, **place)
