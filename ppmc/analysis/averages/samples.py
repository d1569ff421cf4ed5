"""One shape for everything that can be averaged: CT voxels, charge particles, one frame of a flow, phantom truth."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ppmc.errors import InputFileError


@dataclass(frozen=True)
class Samples:
    """Points that carry volume and, where known, directions.

    Parameters
    ----------
    label
        Name of the source as it appears in tables and legends, e.g. ``"flow"`` or ``"CT"``.
    positions : ndarray, shape (n, 3)
        mm, columns x1, x2, x3.
    volume : ndarray, shape (n,)
        mm³; the weight of every average.
    fibre_direction, platelet_normal : ndarray, shape (n, 3), optional
        Unit vectors p and r; ``None`` when the source does not carry them. A row that is zero or not finite is
        "unknown" and is left out of the averages (and counted).
    platelet_id : ndarray, shape (n,), optional
        -1 = none.
    time : float, optional
        s; ``None`` for sources without time.
    fields : dict
        Every other per-point array the source offers, by its name on disk.
    """

    label: str
    positions: np.ndarray
    volume: np.ndarray
    fibre_direction: np.ndarray | None = None
    platelet_normal: np.ndarray | None = None
    platelet_id: np.ndarray | None = None
    time: float | None = None
    fields: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.positions)
        if self.positions.shape != (n, 3):
            raise InputFileError(f"{self.label}: positions have shape {self.positions.shape}, expected (n, 3)")
        for name in ("volume", "fibre_direction", "platelet_normal", "platelet_id"):
            values = getattr(self, name)
            if values is not None and len(values) != n:
                raise InputFileError(f"{self.label}: {name} has {len(values)} rows, positions have {n}")

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def title(self) -> str:
        """Label with the time, as legends and captions show it."""
        return self.label if self.time is None else f"{self.label}, t = {self.time:.4g} s"

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates of the points, mm; NaN when there is none."""
        if not len(self):
            return np.full(3, np.nan), np.full(3, np.nan)
        return self.positions.min(axis=0), self.positions.max(axis=0)

    @property
    def spacing(self) -> float:
        """Typical distance of neighbours: the cube root of the mean volume, mm."""
        return float(np.cbrt(self.volume.mean())) if len(self) else float("nan")

    def select(self, mask: np.ndarray) -> Samples:
        """Return the points where ``mask`` (boolean, or indices) holds."""
        return replace(
            self,
            positions=self.positions[mask],
            volume=self.volume[mask],
            fibre_direction=None if self.fibre_direction is None else self.fibre_direction[mask],
            platelet_normal=None if self.platelet_normal is None else self.platelet_normal[mask],
            platelet_id=None if self.platelet_id is None else self.platelet_id[mask],
            fields={name: values[mask] for name, values in self.fields.items()},
        )

    def rotated(self, rotation: np.ndarray) -> Samples:
        """Return the same material after the rigid rotation ``x -> rotation @ x`` (positions, p and r)."""

        def turn(v: np.ndarray | None) -> np.ndarray | None:
            return None if v is None else v @ rotation.T

        return replace(
            self,
            positions=self.positions @ rotation.T,
            fibre_direction=turn(self.fibre_direction),
            platelet_normal=turn(self.platelet_normal),
        )


def join(parts: list[Samples], label: str | None = None) -> Samples:
    """Concatenate sources; a direction is kept only when every part carries it."""
    if not parts:
        raise InputFileError("nothing to join: no samples given")

    def stack(name: str) -> np.ndarray | None:
        values = [getattr(part, name) for part in parts]
        return None if any(v is None for v in values) else np.concatenate(values)

    shared = set.intersection(*(set(part.fields) for part in parts))
    return Samples(
        label=label or parts[0].label,
        positions=np.concatenate([part.positions for part in parts]),
        volume=np.concatenate([part.volume for part in parts]),
        fibre_direction=stack("fibre_direction"),
        platelet_normal=stack("platelet_normal"),
        platelet_id=stack("platelet_id"),
        time=parts[0].time,
        fields={name: np.concatenate([part.fields[name] for part in parts]) for name in sorted(shared)},
    )
