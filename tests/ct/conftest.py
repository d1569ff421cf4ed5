"""What the CT tests share: volumes in memory, plane-wave textures, and a call that solves them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ppmc.ct.orientations import Job, grey_reference, orientations
from ppmc.ct.settings import settings
from ppmc.ct.source import Volume
from ppmc.ct.tiles import Tiling
from ppmc.scene.sections.ct import CtSection


def memory_volume(grey: np.ndarray, mask: np.ndarray | None = None) -> Volume:
    read_mask = None if mask is None else (lambda box: mask[box])
    return Volume(Path("memory"), grey.shape, grey.dtype, lambda box: grey[box], read_mask=read_mask)


@pytest.fixture
def in_memory() -> Callable[..., Volume]:
    return memory_volume


@pytest.fixture
def solve() -> Callable[..., dict[str, np.ndarray]]:
    def run(
        grey: np.ndarray,
        *,
        spacing: tuple[float, float, float] = (1.0, 1.0, 1.0),
        thickness: float | None = None,
        mask: np.ndarray | None = None,
        threads: int = 1,
        cut: tuple[int, int, int] | None = None,
        noise: np.ndarray | None = None,
        **section: object,
    ) -> dict[str, np.ndarray]:
        wanted = CtSection(**section)
        volume = memory_volume(grey, mask)
        chosen = settings(wanted, spacing, grey.shape, thickness)
        reference = grey_reference(volume)
        job = Job(volume, spacing, chosen, reference, wanted.stride, wanted.least_confidence, noise)
        tiles = Tiling(job.shape, cut or job.shape)
        result = {}
        for block in orientations(job, threads, tiles):
            place = tuple(slice(a, b) for a, b in block.box)
            for name, values in block.fields.items():
                whole = result.setdefault(name, np.empty((*job.shape, *values.shape[3:]), values.dtype))
                whole[place] = values
        return result

    return run


@pytest.fixture
def texture() -> Callable[..., np.ndarray]:
    """Sum of plane waves whose wave vectors are exactly perpendicular to a direction: streaks along it."""

    def make(
        direction: tuple[float, float, float], n: int = 32, waves: int = 12, seed: int = 0,
        spacing: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ) -> np.ndarray:  # fmt: skip
        rng = np.random.default_rng(seed)
        p = np.array(direction) / np.linalg.norm(direction)
        z, y, x = np.meshgrid(*(np.arange(n) * h for h in spacing[::-1]), indexing="ij")
        grey = np.zeros((n, n, n))
        for _ in range(waves):
            k = rng.standard_normal(3)
            k -= (k @ p) * p
            k *= 2.0 * np.pi / rng.uniform(4.0, 12.0) / np.linalg.norm(k) / max(spacing)
            grey += np.cos(k[0] * x + k[1] * y + k[2] * z + rng.uniform(0, 2 * np.pi))
        return grey.astype(np.float32)

    return make
