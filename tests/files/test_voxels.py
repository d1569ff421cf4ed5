"""Voxel files: whole and slab-wise writing, VTK's view of them, refusal of what breaks the contract."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from ppmc.errors import InputFileError
from ppmc.files import Provenance, VoxelGrid, VoxelWriter, read_voxels, write_voxels

ORIGIN = Provenance.collect("test")
TURN = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
GRID = VoxelGrid((3, 4, 5), (0.1, 0.2, 0.3), (1.0, 2.0, 3.0), TURN)


def fields() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    p = np.zeros((*GRID.shape, 3), np.float32)
    angle = rng.uniform(0, 2 * np.pi, GRID.shape)
    p[..., 0], p[..., 1] = np.cos(angle), np.sin(angle)
    r = np.zeros_like(p)
    r[..., 2] = 1
    return {"fibre_direction": p, "platelet_normal": r, "valid": np.ones(GRID.shape, np.uint8)}


def test_round_trip_in_parts(tmp_path: Path) -> None:
    path = tmp_path / "o.vtkhdf"
    write_voxels(path, "orientations", fields(), grid=GRID, provenance=ORIGIN)
    with read_voxels(path, "orientations") as f:
        assert f.grid == GRID
        assert f.names == ("fibre_direction", "platelet_normal", "valid")
        part = (slice(1, 3), slice(None), slice(2, 4))
        assert np.array_equal(f.read("fibre_direction", part), fields()["fibre_direction"][part])
        p, r = f.read_frames()
        assert np.array_equal(p, fields()["fibre_direction"]) and np.array_equal(r, fields()["platelet_normal"])


def test_points_are_read_and_verified_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # As in a file too large to be verified as it is opened.
    monkeypatch.setattr("ppmc.files.voxels.VERIFIED_WHOLE", 0)
    path = tmp_path / "o.vtkhdf"
    write_voxels(path, "orientations", fields(), grid=GRID, provenance=ORIGIN)
    with h5py.File(path, "r+") as f:
        f["VTKHDF/PointData/fibre_direction"][2, 1, 3] = 7.0
        del f["ppmc/digests"], f["ppmc"].attrs["manifest"]  # as a program writes it that keeps no digests
    part, at = (slice(1, 3), slice(1, 4), slice(None)), np.array([[0, 2, 4], [1, 1, 0]])
    with read_voxels(path, "orientations") as f:
        taken = f.read_points("fibre_direction", part, at)
        assert np.array_equal(taken, fields()["fibre_direction"][[1, 2], [3, 2], [4, 0]])
        with pytest.raises(InputFileError, match=r"fibre_direction\[1\] = .* unit length"):
            f.read_points("fibre_direction", part, np.array([[0, 0, 0], [1, 0, 3]]))


def test_slabs_equal_whole(tmp_path: Path) -> None:
    whole, slabs = tmp_path / "whole.vtkhdf", tmp_path / "slabs.vtkhdf"
    write_voxels(whole, "orientations", fields(), grid=GRID, provenance=ORIGIN)
    with VoxelWriter(slabs, "orientations", fields(), grid=GRID, provenance=ORIGIN) as writer:
        for name, values in fields().items():
            for z in (2, 0, 1):
                for y in (0, 2):
                    writer.write(name, z, values[z : z + 1, y : y + 2], y0=y)
    with read_voxels(whole, "orientations") as a, read_voxels(slabs, "orientations") as b:
        for name in a.names:
            assert np.array_equal(a.read(name), b.read(name))


def test_failure_leaves_nothing(tmp_path: Path) -> None:
    with (
        pytest.raises(ZeroDivisionError),
        VoxelWriter(tmp_path / "o.vtkhdf", "orientations", fields(), grid=GRID, provenance=ORIGIN),
    ):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_vtk_sees_points_where_the_grid_says(tmp_path: Path) -> None:
    import pyvista

    path = tmp_path / "o.vtkhdf"
    write_voxels(path, "orientations", fields(), grid=GRID, provenance=ORIGIN)
    image = pyvista.read(path)
    assert image.dimensions == (5, 4, 3)
    assert image.active_vectors_name == "fibre_direction"
    assert np.array_equal(image["fibre_direction"], fields()["fibre_direction"].reshape(-1, 3))
    index = np.array([[4, 0, 0], [0, 3, 0], [0, 0, 2], [4, 3, 2]], float)
    flat = index @ np.array([1, 5, 20])
    assert np.allclose(image.points[flat.astype(int)], GRID.to_world(index), atol=1e-6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_grey_keeps_its_type(tmp_path: Path, dtype: type) -> None:
    path = tmp_path / "v.vtkhdf"
    grey = np.arange(60, dtype=dtype).reshape(GRID.shape)
    write_voxels(path, "volume", {"grey": grey}, grid=GRID, provenance=ORIGIN)
    with read_voxels(path, "volume") as f:
        got = f.read("grey")
    assert got.dtype == dtype and np.array_equal(got, grey)


def test_grid_maps_there_and_back() -> None:
    index = np.random.default_rng(0).uniform(0, 9, (20, 3))
    assert np.allclose(GRID.to_index(GRID.to_world(index)), index)
    assert np.allclose(GRID.to_world(np.array([[1.0, 0, 0]])), [[1.0, 2.1, 3.0]])
    assert GRID.strided(2).shape == (2, 2, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": (0, 1, 1)}, "positive counts"),
        ({"spacing": (0.1, -0.1, 0.1)}, "spacing must be positive"),
        ({"origin": (np.nan, 0, 0)}, "origin must be finite"),
        ({"direction": ((1.0, 0, 0), (0, 1, 0), (0, 0, -1))}, "rotation"),
    ],
)
def test_grid_refuses(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VoxelGrid(**({"shape": (1, 1, 1), "spacing": (1.0, 1.0, 1.0)} | change))


def broken(path: Path, kind: str) -> None:
    """Write a good file and spoil it."""
    write_voxels(path, "orientations", fields(), grid=GRID, provenance=ORIGIN)
    if kind == "truncated":
        path.write_bytes(path.read_bytes()[:3000])
        return
    if kind == "not hdf5":
        path.write_text("hello")
        return
    secret = path.with_name("secret")
    secret.write_bytes(bytes(4000))
    with h5py.File(path, "r+") as f:
        data = f["VTKHDF/PointData"]
        p = data["fibre_direction"]
        if kind == "nan":
            p[1, 2, 3, 0] = np.nan
        elif kind == "not unit":
            p[1, 2, 3] = [2, 0, 0]
        elif kind == "not orthogonal":
            p[1, 2, 3] = [0, 0, 1]
            del f["ppmc/digests"], f["ppmc"].attrs["manifest"]  # as a program writes it that keeps no digests
        elif kind == "newer schema":
            f["ppmc"].attrs["schema_version"] = (2, 0)
        elif kind == "not an image":
            f["VTKHDF"].attrs["Type"] = np.bytes_("PolyData")
        else:
            del data["fibre_direction"]
            if kind == "wrong shape":
                data["fibre_direction"] = np.zeros((3, 4, 4, 3), np.float32)
            elif kind == "wrong type":
                data["fibre_direction"] = np.full((*GRID.shape, 3), b"x")
            elif kind == "external link":
                data["fibre_direction"] = h5py.ExternalLink("other.h5", "/x")
            elif kind == "soft link":
                data["fibre_direction"] = h5py.SoftLink("/VTKHDF/PointData/platelet_normal")
            elif kind == "external storage":
                data.create_dataset("fibre_direction", (*GRID.shape, 3), "f4", external=[(str(secret), 0, 720)])
            elif kind == "size bomb":
                data.create_dataset("fibre_direction", (10**5, 10**4, 10**3, 3), "f4", chunks=(1, 100, 100, 3))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("truncated", "truncated"),
        ("not hdf5", "not an HDF5 file"),
        ("nan", r"fibre_direction\[1, 2, 3\] = .*nan.* is not finite; 1 of 60"),
        ("not unit", r"fibre_direction\[1, 2, 3\] = .*2.* must have unit length"),
        ("not orthogonal", r"fibre_direction\[1, 2, 3\].* must be orthogonal to platelet_normal"),
        ("newer schema", r"schema_version is \(2, 0\)"),
        ("not an image", "must be 'ImageData'"),
        ("missing", "fibre_direction is missing"),
        ("wrong shape", r"fibre_direction has shape \(3, 4, 4, 3\), must be \(3, 4, 5\) \+ \(3,\)"),
        ("wrong type", "must hold f4"),
        ("external link", r"is a link \(ExternalLink\)"),
        ("soft link", r"is a link \(SoftLink\)"),
        ("external storage", "keeps its data in other files"),
        ("size bomb", "declares 12,000,000,000,000 bytes"),
    ],
)
def test_bad_file_is_refused_by_name(tmp_path: Path, kind: str, message: str) -> None:
    path = tmp_path / "o.vtkhdf"
    broken(path, kind)
    with pytest.raises(InputFileError, match=message) as caught, read_voxels(path, "orientations") as f:
        f.read_frames()
    assert "o.vtkhdf" in str(caught.value)
    assert caught.value.exit_code == 3


def test_missing_and_wrong_product(tmp_path: Path) -> None:
    with (
        pytest.raises(InputFileError, match="no such file; make it with 'ppmc ct'"),
        read_voxels(tmp_path / "x", "orientations"),
    ):
        pass
    path = tmp_path / "o.vtkhdf"
    write_voxels(path, "orientations", fields(), grid=GRID, provenance=ORIGIN)
    with (
        pytest.raises(InputFileError, match="holds 'orientations', but 'volume' is needed"),
        read_voxels(path, "volume"),
    ):
        pass
