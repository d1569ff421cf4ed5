"""Every product notices every bit that was changed; nothing is asked of the memory that the disk does not hold."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ppmc.errors import InputFileError
from ppmc.files import (
    Provenance,
    SeriesWriter,
    VoxelGrid,
    open_series,
    read_particles,
    read_state,
    read_voxels,
    write_particles,
    write_state,
    write_voxels,
)
from ppmc.files.describe import verify_file

N, FLIPS = 30, 60
GRID = VoxelGrid((5, 6, 7), (0.1, 0.1, 0.1), (0.05, 0.05, 0.05))
ORIGIN = Provenance("test", {"name": "x"}, {"a": "b"}, None, "k")


def vectors(shape: tuple[int, ...], axis: int, dtype: str) -> np.ndarray:
    out = np.zeros((*shape, 3), dtype)
    out[..., axis] = 1.0
    return out


def make_volume(path: Path) -> None:
    grey = np.random.default_rng(1).integers(0, 255, GRID.shape).astype(np.uint8)
    write_voxels(path, "volume", {"grey": grey}, grid=GRID, provenance=ORIGIN)


def make_orientations(path: Path) -> None:
    fields = {
        "fibre_direction": vectors(GRID.shape, 0, "f4"),
        "platelet_normal": vectors(GRID.shape, 2, "f4"),
        "valid": np.ones(GRID.shape, np.uint8),
    }
    write_voxels(path, "orientations", fields, grid=GRID, provenance=ORIGIN)


def make_charge(path: Path) -> None:
    names = ("fibre_direction", "in_plane_direction", "platelet_normal")
    fields: dict[str, Any] = {name: vectors((N,), k, "f8") for k, name in enumerate(names)}
    fields |= {"volume": np.ones(N), "platelet_id": np.arange(N)}
    positions = np.random.default_rng(2).normal(size=(N, 3))
    write_particles(path, "charge", positions, fields, provenance=ORIGIN, extra={"spacing": [1.0, 1.0, 1.0]})


def make_flow(path: Path) -> None:
    static = {"platelet_id": np.arange(N), "reference_position": np.ones((N, 3)), "volume": np.ones(N)}
    fields: dict[str, Any] = {
        "fibre_direction": vectors((N,), 0, "f8"),
        "deformation_gradient": np.tile(np.eye(3).ravel(), (N, 1)),
        "volume_ratio": np.ones(N),
        "velocity": np.ones((N, 3)),
        "pressure": np.ones(N),
    }
    writer = SeriesWriter.create(path.with_suffix(".partial"), N, static, fields, ("force",), provenance=ORIGIN)
    for k in range(2):
        writer.append(0.5 * k, np.full((N, 3), float(k)), fields, {"force": 1.0 + k})
    writer.seal(path, {"time": np.arange(4.0), "press_force": np.arange(4.0)}, {"note": "x"})


def make_checkpoint(path: Path) -> None:
    write_state(path, {"a": np.arange(40.0)}, {"time": "0x1p0"}, provenance=ORIGIN)


def read_all_voxels(product: str) -> Callable[[Path], Any]:
    def read(path: Path) -> Any:
        with read_voxels(path, product) as file:
            return {name: file.read(name) for name in file.names}, file.grid.spacing, file.provenance

    return read


def read_flow(path: Path) -> Any:
    with open_series(path, "flow") as file:
        frames = [file.frame(k) for k in range(len(file.times))]
        return frames, file.static, file.scalars, file.history, file.extra, file.provenance, file.times


def read_charge(path: Path) -> Any:
    file = read_particles(path, "charge")
    return file.positions, file.fields, file.extra, file.provenance


PRODUCTS: dict[str, tuple[Callable[[Path], None], Callable[[Path], Any]]] = {
    "volume": (make_volume, read_all_voxels("volume")),
    "orientations": (make_orientations, read_all_voxels("orientations")),
    "charge": (make_charge, read_charge),
    "flow": (make_flow, read_flow),
    "checkpoint": (make_checkpoint, read_state),
}


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, dict):
        return set(a) == set(b) and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return bool(a == b)


@pytest.mark.parametrize("product", PRODUCTS)
def test_no_changed_bit_is_taken_for_data(tmp_path: Path, product: str) -> None:
    make, read = PRODUCTS[product]
    path = tmp_path / f"{product}.vtkhdf"
    make(path)
    assert verify_file(path)
    truth, whole = read(path), path.read_bytes()
    with h5py.File(path) as file:
        names: list[str] = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        bare = [n for n in names if "sha256" not in file[n].attrs and f"ppmc/digests/{n}" not in file]
        assert not bare
    rng = np.random.default_rng(7)
    for at in rng.integers(0, len(whole), FLIPS):
        data = bytearray(whole)
        data[at] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(data)
        try:
            assert same(read(path), truth), at
        except InputFileError:
            with pytest.raises(InputFileError):
                verify_file(path)


@pytest.mark.parametrize("product", PRODUCTS)
def test_an_edit_by_a_program_is_noticed(tmp_path: Path, product: str) -> None:
    make, read = PRODUCTS[product]
    path = tmp_path / f"{product}.vtkhdf"
    make(path)
    with h5py.File(path, "r+") as file:
        file["ppmc"].attrs["seed"] = file["ppmc"].attrs["key"]
    for look in (read, verify_file):
        with pytest.raises(InputFileError, match="attributes were changed"):
            look(path)


def exchanged(file: h5py.File) -> None:
    for old, new in (("velocity", "aside"), ("reference_position", "velocity"), ("aside", "reference_position")):
        file.move(f"VTKHDF/PointData/{old}", f"VTKHDF/PointData/{new}")


def without_digest(file: h5py.File) -> None:
    file["ppmc/history/press_force"][1] = 7.0
    del file["ppmc/history/press_force"].attrs["sha256"]


def later(file: h5py.File) -> None:
    file["VTKHDF/Steps"].attrs["NSteps"] = 1


@pytest.mark.parametrize("edit", [exchanged, without_digest, later])
def test_what_has_a_digest_of_its_own_is_not_taken_for_another(
    tmp_path: Path, edit: Callable[[h5py.File], None]
) -> None:
    path = tmp_path / "flow.vtkhdf"
    make_flow(path)
    with h5py.File(path, "r+") as file:
        edit(file)
    for look in (read_flow, verify_file):
        with pytest.raises(InputFileError):
            look(path)


def huge(group: h5py.Group) -> None:
    group.create_dataset("more", shape=(10**12,), dtype="f8", chunks=(1000,))


def external(group: h5py.Group) -> None:
    group["more"] = h5py.ExternalLink("other.h5", "x")


def soft(group: h5py.Group) -> None:
    group["more"] = h5py.SoftLink("/VTKHDF/Points")


def loop(group: h5py.Group) -> None:
    group["more"] = group


def strange(group: h5py.Group) -> None:
    group.create_dataset("more", data=["x"], dtype=h5py.string_dtype())


@pytest.mark.parametrize("add", [huge, external, soft, loop, strange])
@pytest.mark.parametrize("where", ["ppmc/history", "ppmc/frames", "VTKHDF/Steps"])
def test_guards_cover_the_whole_file(tmp_path: Path, add: Callable[[h5py.Group], None], where: str) -> None:
    path = tmp_path / "flow.vtkhdf"
    make_flow(path)
    with h5py.File(path, "r+") as file:
        add(file[where])
    with pytest.raises(InputFileError, match=rf"/{where}(/more)?\b"), open_series(path, "flow"):
        pass


def test_large_voxel_files_are_compared_block_by_block(tmp_path: Path) -> None:
    grid = VoxelGrid((70, 65, 130), (0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
    grey = np.random.default_rng(3).integers(0, 255, grid.shape).astype(np.uint8)
    path = tmp_path / "volume.vtkhdf"
    write_voxels(path, "volume", {"grey": grey}, grid=grid, provenance=ORIGIN)
    with h5py.File(path, "r+") as file:
        assert file["ppmc/digests/VTKHDF/PointData/grey"].shape == (3, 2, 3, 32)
        file["VTKHDF/PointData/grey"][69, 64, 129] ^= 1
    with h5py.File(path) as file:
        from ppmc.files.guard import block_check, compare_block

        check = block_check(file, "VTKHDF/PointData/grey", path)
        compare_block(check, (slice(0, 48), slice(0, 65), slice(0, 130)), path)
        with pytest.raises(InputFileError, match=r"grey\[48:70, 33:65, 88:130\]"):
            compare_block(check, (slice(66, 70), slice(60, 65), slice(100, 130)), path)
