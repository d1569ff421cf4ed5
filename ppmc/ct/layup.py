"""Which platelet fills which part of which layer of the phantom.

A layer is a sheet of one platelet thickness, laid out on a raster of its own two coordinates. Platelets are thrown at
random until the layer is covered; what an earlier one covers, a later one leaves. Each layer draws from a seed of its
own, so that layers can be made again in any order and need not all be kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ppmc.compile_cache import njit
from ppmc.scene.sections.phantom import PhantomSection

STAGE = 101
PROBES = 256
MOST_PLATELETS = 32000
COLUMNS = 8
"""Columns of a platelet's record: centre x, y; cosine, sine; half length, half width; mean grey; texture offset."""


@njit
def _throw(owner, cell, x0, y0, number, record):  # type: ignore[no-untyped-def]
    """Give free raster cells under a platelet to it; return how many."""
    cx, cy, c, s = record[0], record[1], record[2], record[3]
    half_length, half_width = record[4], record[5]
    reach_x = abs(c) * half_length + abs(s) * half_width
    reach_y = abs(s) * half_length + abs(c) * half_width
    ny, nx = owner.shape
    i0 = max(0, int(np.floor((cx - reach_x - x0) / cell)))
    i1 = min(nx, int(np.ceil((cx + reach_x - x0) / cell)) + 1)
    j0 = max(0, int(np.floor((cy - reach_y - y0) / cell)))
    j1 = min(ny, int(np.ceil((cy + reach_y - y0) / cell)) + 1)
    taken = 0
    for j in range(j0, j1):
        dy = y0 + (j + 0.5) * cell - cy
        for i in range(i0, i1):
            dx = x0 + (i + 0.5) * cell - cx
            inside = abs(c * dx + s * dy) <= half_length and abs(c * dy - s * dx) <= half_width
            if inside and owner[j, i] < 0:
                owner[j, i] = number
                taken += 1
    return taken


@dataclass(frozen=True)
class Layer:
    """One layer: for each raster cell the row of its platelet in ``records``, or -1 for resin."""

    owner: NDArray[np.int16]
    records: NDArray[np.float64]


@dataclass
class Layup:
    """All layers of a phantom, made when asked for.

    Attributes
    ----------
    section : PhantomSection
        What to make.
    seed : int
        The scene's seed.
    lower, upper : tuple of float
        Extent (x, y) of the layers, mm.
    count, below : int
        Number of layers, and how many of them lie under the cavity's floor.
    """

    section: PhantomSection
    seed: int
    lower: tuple[float, float]
    upper: tuple[float, float]
    count: int
    below: int = 0
    _kept: dict[int, Layer] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.cell = min(self.section.spacing[:2])
        self.shape = tuple(
            int(np.ceil((b - a) / self.cell - 1e-9)) for a, b in zip(self.lower[::-1], self.upper[::-1], strict=True)
        )
        sizes = [len(self._make(i).records) for i in range(self.count)]
        self.first_id = np.concatenate([[0], np.cumsum(sizes)])

    def layers(self, first: int, last: int) -> list[Layer]:
        """Return the layers ``first`` to ``last`` inclusive; those below ``first`` are forgotten."""
        self._kept = {i: layer for i, layer in self._kept.items() if i >= first}
        for i in range(first, last + 1):
            if i not in self._kept:
                self._kept[i] = self._make(i)
        return [self._kept[i] for i in range(first, last + 1)]

    def _make(self, index: int) -> Layer:
        rng = np.random.default_rng([self.seed, STAGE, index])
        if self.section.layup == "plies":
            return Layer(
                np.zeros(self.shape, np.int16), self._record(rng, (0.0, 0.0), self._ply_angle(index, rng))[None]
            )
        owner = np.full(self.shape, -1, np.int16)
        free = owner.size
        records: list[NDArray[np.float64]] = []
        while free > (1.0 - self.section.coverage) * owner.size and len(records) < MOST_PLATELETS:
            probe = rng.random((PROBES, 2)) * self.shape
            open_ = np.flatnonzero(owner[probe[:, 0].astype(int), probe[:, 1].astype(int)] < 0)
            if open_.size == 0:
                break
            y, x = probe[open_[0]] * self.cell
            # A free spot lies anywhere under the platelet, not always under its middle.
            angle = self._angle(rng)
            along, across = (rng.random(2) - 0.5) * (self.section.platelet.length, self.section.platelet.width)
            c, s = np.cos(angle), np.sin(angle)
            centre = (self.lower[0] + x + c * along - s * across, self.lower[1] + y + s * along + c * across)
            record = self._record(rng, centre, angle)
            taken = _throw(owner, self.cell, *self.lower, len(records), record)
            if taken:
                free -= taken
                records.append(record)
        return Layer(owner, np.array(records))

    def _angle(self, rng: np.random.Generator) -> float:
        if self.section.angles == "uniform":
            return float(rng.uniform(0.0, np.pi))
        return float(np.radians(rng.choice(self.section.angles) + self.section.angle_spread * rng.standard_normal()))

    def _ply_angle(self, index: int, rng: np.random.Generator) -> float:
        angles = self.section.angles
        assert not isinstance(angles, str)
        angle = angles[(index - self.below) % len(angles)]
        return float(np.radians(angle + self.section.angle_spread * rng.standard_normal()))

    def _record(self, rng: np.random.Generator, centre: tuple[float, float], angle: float) -> NDArray[np.float64]:
        shape = self.section.platelet
        half = (np.inf, np.inf) if self.section.layup == "plies" else (shape.length / 2, shape.width / 2)
        grey = self.section.platelet_contrast * rng.standard_normal()
        return np.array([*centre, np.cos(angle), np.sin(angle), *half, grey, rng.random()])
