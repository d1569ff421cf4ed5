"""Chunks of voxel files: rounded, compressed, read by every HDF5 library, with digests of what they hold."""

import itertools
import zlib

import h5py
import numpy as np
import pytest

from ppmc.files import Provenance, VoxelGrid, VoxelWriter, read_voxels
from ppmc.files.chunks import deflated, rounded
from ppmc.files.digests import digest
from ppmc.files.fields import field
from ppmc.files.voxels import CHUNK, chunks_of

ORIGIN = Provenance.collect("test")
RNG = np.random.default_rng(0)


def fields_of(shape):
    p = RNG.standard_normal((*shape, 3)).astype(np.float32)
    p /= np.linalg.norm(p, axis=-1, keepdims=True)
    r = np.cross(p, np.roll(p, 1, axis=-1)).astype(np.float32)
    r /= np.linalg.norm(r, axis=-1, keepdims=True)
    values = np.sort(RNG.exponential(100, (*shape, 3)).astype(np.float32), axis=-1)
    some = {name: RNG.random(shape).astype(np.float32) for name in ("confidence", "planarity", "predicted_error")}
    return {"fibre_direction": p, "platelet_normal": r, "eigenvalues": values, **some,
            "valid": (RNG.random(shape) > 0.1).astype(np.uint8)}  # fmt: skip


@pytest.mark.parametrize(
    "raw",
    [
        RNG.integers(0, 256, 200_000),
        np.zeros(300_000),
        RNG.integers(0, 3, 12),
        np.repeat(RNG.integers(0, 256, 100), 999),
    ],
)
@pytest.mark.parametrize("planes", [1, 4])
def test_streams_are_read_by_zlib(raw, planes):
    raw = raw.astype(np.uint8)
    raw = raw[: len(raw) // planes * planes]
    assert zlib.decompress(deflated(raw, planes)) == raw.tobytes()


def test_rounding_is_small_and_done_once():
    values = fields_of((8, 9, 10))
    for name, given in values.items():
        spec = field("orientations", name)
        kept = rounded(given, spec)
        assert np.array_equal(rounded(kept, spec), kept)
        if spec.check == "unit":
            assert np.abs(kept - given).max() <= 2.0**-14
        else:
            assert np.all(np.abs(kept.astype(float) - given) <= given * 2.0**-8)
    assert np.all(np.diff(rounded(values["eigenvalues"], field("orientations", "eigenvalues")), axis=-1) >= 0)
    huge = np.array([np.inf, -np.inf, 0.0, -1.0, np.finfo(np.float32).max], np.float32)
    kept = rounded(huge, field("orientations", "confidence"))
    assert np.array_equal(kept[:4], huge[:4])


@pytest.mark.parametrize("shape", [(33, 65, 70), (32, 64, 64), (7, 5, 3), (100, 150, 20)])
def test_chunks_leave_next_to_nothing_empty(shape):
    chunk = chunks_of(shape)
    assert all(c <= most for c, most in zip(chunk, CHUNK, strict=True))
    held = np.prod([-(-n // c) * c for n, c in zip(shape, chunk, strict=True)])
    assert held <= 1.12 * np.prod(shape)


def written(path, values, shape, cuts=(0, None)):
    """Write fields in slabs; slabs that hold no whole chunks go another way into the file."""
    grid = VoxelGrid(shape, (0.1, 0.1, 0.1))
    with VoxelWriter(path, "orientations", values, grid=grid, provenance=ORIGIN, compact=True) as writer:
        for name, given in values.items():
            for a, b in itertools.pairwise(cuts):
                writer.write(name, a, given[a:b])


@pytest.mark.parametrize("cuts", [(0, None), (0, 10, None), (0, 17, None)])
def test_file_holds_what_was_written_with_its_digests(tmp_path, cuts):
    shape = (33, 65, 70)
    values, path = fields_of(shape), tmp_path / "o.vtkhdf"
    written(path, values, shape, cuts)
    with read_voxels(path, "orientations") as file:
        for name, given in values.items():
            assert np.array_equal(file.read(name), rounded(given, field("orientations", name)))
    with h5py.File(path) as file:
        for name in values:
            data = file[f"VTKHDF/PointData/{name}"]
            noted = file[f"ppmc/digests/VTKHDF/PointData/{name}"]
            last = tuple(slice((n - 1) // c * c, n) for n, c in zip(data.shape, data.chunks, strict=True))
            assert noted[tuple(n - 1 for n in noted.shape[:-1])].tobytes().hex() == digest(data[last])
    assert path.stat().st_size < 26 * np.prod(shape)


def test_vtk_reads_it(tmp_path):
    import pyvista as pv

    shape = (20, 30, 40)
    values = fields_of(shape)
    written(tmp_path / "o.vtkhdf", values, shape)
    got = np.asarray(pv.read(tmp_path / "o.vtkhdf")["fibre_direction"]).reshape(*shape, 3)
    assert np.abs(got - values["fibre_direction"]).max() <= 2.0**-14
