"""The fused kernel against a plain NumPy twin, and against what a block must not change."""

import dataclasses

import numpy as np
import pytest

from ppmc.ct.block import EDGE_VOTE, Reference, TensorStream, edge_votes
from ppmc.ct.settings import settings
from ppmc.scene.sections.ct import CtSection

from ppmc.ct.source import Volume  # isort: skip
from pathlib import Path  # isort: skip

ONE = Reference(0.0, 1.0)


def volume_of(grey, mask=None):
    read_mask = None if mask is None else (lambda box: mask[box])
    return Volume(Path("memory"), grey.shape, grey.dtype, lambda box: grey[box], read_mask=read_mask)


def along(array, taps, axis):
    return np.apply_along_axis(lambda line: np.convolve(line, taps[::-1], "valid"), axis, array)


def twin(grey, mask, chosen):
    """Filter, multiply, window and divide in float64, axis by axis, on the mirrored volume."""
    g, w = chosen.gradient_radius, chosen.window_radius
    halo = [a + b for a, b in zip(g, w, strict=True)]
    padded = np.pad(grey.astype(float), [(r, r) for r in halo[::-1]], mode="symmetric")
    gradient = []
    for axis in range(3):
        part = padded
        for a in range(3):
            taps = chosen.slope[a] if a == axis else chosen.smooth[a]
            part = along(part, taps.astype(float), 2 - a)
        gradient.append(part)
    if mask is None:
        votes = [edge_votes(n, -(-r // 2), -b, n + b).astype(float)
                 for n, r, b in zip(grey.shape, g[::-1], w[::-1], strict=True)]  # fmt: skip
        vote = votes[0][:, None, None] * votes[1][None, :, None] * votes[2][None, None, :]
    else:
        vote = np.pad(mask.astype(float), [(b, b) for b in w[::-1]])
    gx, gy, gz = gradient
    channels = [gx * gx, gy * gy, gz * gz, gx * gy, gy * gz, gx * gz, np.ones_like(gx)]
    out = []
    for channel in channels:
        part = channel * vote
        for a in range(3):
            part = along(part, chosen.window[a].astype(float), 2 - a)
        out.append(part)
    return np.stack([c / out[6] for c in out[:6]], axis=2)


def window(*arguments, batch=5, **options):
    """Return all tensors of a stream (nz, ny, channels, nx), a few planes at a time."""
    stream = TensorStream(*arguments, batch=batch, **options)
    nz, ny, nx = stream.counts
    out = np.empty((nz, stream.channels, ny, stream.pitch), np.float32)
    for first in range(0, nz, batch):
        stream.planes(first, min(first + batch, nz), out.reshape(-1), first)
    return out[..., :nx].transpose(0, 2, 1, 3)


def whole(shape):
    return tuple((0, n) for n in shape)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.5, 0.5, 0.8)])
def test_equals_plain_numpy(spacing):
    grey = np.random.default_rng(0).standard_normal((17, 19, 23)).astype(np.float32)
    chosen = settings(CtSection(fibre_window=(1.2, 0.7, 0.5), normal_window=1.3), spacing, grey.shape, None)
    got = window(volume_of(grey), chosen, ONE, whole(grey.shape), chosen.window)
    want = twin(grey, None, chosen)
    assert np.max(np.abs(got - want)) < 3e-6 * np.abs(want).max()


@pytest.mark.parametrize("axis", range(3))
def test_equals_plain_numpy_with_a_window_longer_than_a_band(axis):
    """Filters take their taps a few at a time; a long one takes many turns, and reads far beyond a row."""
    shape = [11, 12, 13]
    shape[2 - axis] = 130
    grey = np.random.default_rng(0).standard_normal(shape).astype(np.float32)
    chosen = settings(CtSection(sigma=1.7, fibre_window=1.0, normal_window=1.3), (1.0, 1.0, 1.0), grey.shape, None)
    taps = list(chosen.window)
    taps[axis] = np.hanning(143)[1:-1].astype(np.float32)
    chosen = dataclasses.replace(chosen, window=tuple(taps))
    got = window(volume_of(grey), chosen, ONE, whole(grey.shape), chosen.window)
    want = twin(grey, None, chosen)
    assert np.max(np.abs(got - want)) < 1e-5 * np.abs(want).max()


def test_equals_plain_numpy_with_sums_of_cells():
    grey = np.random.default_rng(0).standard_normal((16, 20, 24)).astype(np.float32)
    chosen = settings(CtSection(fibre_window=1.0, normal_window=3.0), (1.0, 1.0, 1.0), grey.shape, None)
    box = ((1, 14), (2, 15), (0, 21))
    flat = tuple(np.array([0.5, 1.0, 0.5], np.float32) for _ in range(3))
    sums = window(volume_of(grey), chosen, ONE, box, flat, stride=(2, 3, 4), averaged=False)
    means = window(volume_of(grey), chosen, ONE, box, flat, stride=(2, 3, 4))
    assert sums.shape == (7, 5, 7, 6)
    inside = np.s_[2:-2, 1:-1, :6, 1:-1]
    assert np.allclose((sums[:, :, :6] / sums[:, :, 6:])[inside], means[inside], rtol=2e-5, atol=1e-6)


def test_stride_picks_the_same_voxels():
    grey = np.random.default_rng(0).standard_normal((17, 18, 19)).astype(np.float32)
    chosen = settings(CtSection(fibre_window=1.5, normal_window=3.0), (1.0, 1.0, 1.0), grey.shape, None)
    full = window(volume_of(grey), chosen, ONE, whole(grey.shape), chosen.window)
    for k in (2, 3, 4):
        some = window(volume_of(grey), chosen, ONE, whole(grey.shape), chosen.window, stride=(k, k, k))
        assert np.allclose(some, full[::k, ::k, :, ::k], rtol=1e-5, atol=1e-6)


def test_gradients_outside_the_mask_have_no_say():
    rng = np.random.default_rng(0)
    grey = rng.standard_normal((20, 20, 20)).astype(np.float32)
    mask = np.zeros(grey.shape, np.uint8)
    mask[4:16, 3:17, 5:20] = 1
    chosen = settings(CtSection(fibre_window=1.5, normal_window=3.0), (1.0, 1.0, 1.0), grey.shape, None)
    first = window(volume_of(grey, mask), chosen, ONE, whole(grey.shape), chosen.window)
    other = np.where(mask > 0, grey, 1e3 * rng.standard_normal(grey.shape)).astype(np.float32)
    second = window(volume_of(other, mask), chosen, ONE, whole(grey.shape), chosen.window)
    assert np.array_equal(first, second)


def test_mask_of_everything_is_no_mask():
    grey = np.random.default_rng(0).standard_normal((20, 21, 22)).astype(np.float32)
    chosen = settings(CtSection(fibre_window=1.5, normal_window=3.0), (1.0, 1.0, 1.0), grey.shape, None)
    mask = np.ones(grey.shape, np.uint8)
    masked = window(volume_of(grey, mask), chosen, ONE, whole(grey.shape), chosen.window)
    plain = window(volume_of(grey), chosen, ONE, whole(grey.shape), chosen.window)
    inside = np.s_[6:-6, 6:-6, :6, 6:-6]
    assert np.allclose(masked[inside], plain[inside], rtol=1e-4, atol=1e-6)


def test_edge_votes_count_the_distance_from_either_end():
    assert np.allclose(edge_votes(6, 2, -1, 7), [0, EDGE_VOTE, EDGE_VOTE, 1, 1, EDGE_VOTE, EDGE_VOTE, 0])
