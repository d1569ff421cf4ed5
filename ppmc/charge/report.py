"""A few lines that say what a charge file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ppmc.files import read_particles

SOURCES = {0: "default", 1: "CT", 2: "random", 3: "regional", 4: "draped", 5: "given"}


def lines(path: Path) -> list[str]:
    """Return a summary of a charge file: particles, volume, tensors, and every note of how it was made.

    Parameters
    ----------
    path : Path
        Charge file.

    Raises
    ------
    InputFileError
        If it is no readable charge file.
    """
    charge = read_particles(path, "charge")
    extra, n = dict(charge.extra), len(charge.positions)
    spacing = " x ".join(f"{h:.4g}" for h in extra.pop("spacing"))
    shape = [int(v) for v in extra.pop("lattice_shape")]
    A, N = (np.asarray(extra.pop(name)) for name in ("fibre_tensor", "normal_tensor"))
    extra.pop("layers")
    codes, counts = np.unique(charge.fields["orientation_source"], return_counts=True)
    shares = [f"{c / n:.2%} {SOURCES.get(int(k), k)}" for k, c in zip(codes, counts, strict=True)]
    out = [
        f"{path}: {n:,} particles in {shape[0]} layers, spacing {spacing} mm,"
        f" total volume {extra.pop('total_volume'):.6g} mm^3",
        f"  particle volume over cell volume {extra.pop('volume_scale'):.6g}",
        "  A11 A22 A33 = " + " ".join(f"{v:.3f}" for v in A[:3]) + "   N11 N22 N33 = "
        + " ".join(f"{v:.3f}" for v in N[:3]),
        "  orientations: " + ", ".join(shares),
    ]  # fmt: skip
    for name, value in extra.items():
        out.append(f"  {name.replace('_', ' ')}: {_shown(value)}")
    return out


def _shown(value: Any) -> str:
    """Return a note as text, numbers with few digits."""
    if isinstance(value, list):
        return " ".join(_shown(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
