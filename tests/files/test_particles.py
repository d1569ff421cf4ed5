"""Particle files and checkpoints: exact contents, and refusal of what breaks the contract."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from ppmc.errors import InputFileError
from ppmc.files import Provenance, read_particles, read_state, write_particles, write_state
from ppmc.files.describe import describe_file, verify_file

ORIGIN = Provenance.collect("test", seed=4)
N = 20


def charge() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, np.pi, N)
    p = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    r = np.tile([0.0, 0, 1], (N, 1))
    fields = {
        "fibre_direction": p,
        "in_plane_direction": np.cross(r, p),
        "platelet_normal": r,
        "volume": rng.uniform(1, 2, N),
        "platelet_id": np.arange(N),
    }
    return rng.normal(size=(N, 3)), fields


def written(path: Path) -> Path:
    x, fields = charge()
    write_particles(path, "charge", x, fields, provenance=ORIGIN, extra={"spacing": [0.5, 0.5, 0.5]})
    return path


def test_round_trip(tmp_path: Path) -> None:
    got = read_particles(written(tmp_path / "c.vtkhdf"), "charge")
    x, fields = charge()
    assert np.array_equal(got.positions, x)
    assert set(got.fields) == set(fields)
    for name, values in fields.items():
        assert np.array_equal(got.fields[name], values)
    assert got.extra == {"spacing": [0.5, 0.5, 0.5]}
    assert got.provenance == ORIGIN


def test_pyvista_shows_its_vectors(tmp_path: Path) -> None:
    import pyvista

    mesh = pyvista.read(written(tmp_path / "c.vtkhdf"))
    x, fields = charge()
    assert np.array_equal(mesh.points, x) and mesh.n_cells == N
    assert mesh.active_vectors_name == "fibre_direction"
    for name, values in fields.items():
        assert np.array_equal(mesh[name], values)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("volume", np.zeros(N), r"volume\[0\] = 0.* must be positive; 20 of 20"),
        ("fibre_direction", np.full((N, 3), np.nan), r"fibre_direction\[0\] .* is not finite"),
        ("fibre_direction", np.ones((N, 3)), "must have unit length"),
        ("fibre_direction", np.tile([0.0, 0, 1], (N, 1)), "must be orthogonal to platelet_normal"),
        ("fibre_direction", np.ones((N, 2)), r"has shape \(20, 2\), must be \(20,\) \+ \(3,\)"),
        ("platelet_id", np.ones(N), "holds float64, must hold i8"),
        ("volume", None, "volume is missing"),
    ],
)
def test_broken_contract_is_refused(tmp_path: Path, name: str, values: np.ndarray | None, message: str) -> None:
    path = written(tmp_path / "c.vtkhdf")
    with h5py.File(path, "r+") as f:
        del f[f"VTKHDF/PointData/{name}"]
        if values is not None:
            f[f"VTKHDF/PointData/{name}"] = values
    with pytest.raises(InputFileError, match=message):
        read_particles(path, "charge")


def test_writer_asks_for_the_whole_contract(tmp_path: Path) -> None:
    x, fields = charge()
    del fields["volume"]
    with pytest.raises(ValueError, match="needs volume"):
        write_particles(tmp_path / "c", "charge", x, fields, provenance=ORIGIN)
    x, fields = charge()
    fields["volume"] = fields["volume"][:-1]
    with pytest.raises(ValueError, match="'volume' has shape"):
        write_particles(tmp_path / "c", "charge", x, fields, provenance=ORIGIN)
    assert list(tmp_path.iterdir()) == []


def test_state_is_exact(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    arrays = {"x": rng.normal(size=(5, 3)), "ids": np.arange(4, dtype=np.int32), "flags": np.array([True, False])}
    write_state(tmp_path / "s", arrays, {"step": 3, "time": 0.1 + 0.2}, provenance=ORIGIN)
    got, attributes, origin = read_state(tmp_path / "s")
    assert attributes == {"step": 3, "time": 0.1 + 0.2} and origin == ORIGIN
    for name, values in arrays.items():
        assert got[name].dtype == values.dtype and np.array_equal(got[name], values)


def test_changed_state_is_refused(tmp_path: Path) -> None:
    write_state(tmp_path / "s", {"x": np.ones(5)}, {}, provenance=ORIGIN)
    with h5py.File(tmp_path / "s", "r+") as f:
        f["state/x"][2] = 1.0000001
    with pytest.raises(InputFileError, match="does not match its digest"):
        read_state(tmp_path / "s")


def test_describe_explains_and_verify_finds_a_changed_byte(tmp_path: Path) -> None:
    path = written(tmp_path / "c.vtkhdf")
    text = describe_file(path)
    for word in (
        "charge",
        "20 particles",
        "fibre_direction / 1: fibre direction p",
        "volume / mm^3",
        "ppmc charge",
        "seed 4",
    ):
        assert word in text, word
    assert len(verify_file(path)) >= 6
    with h5py.File(path, "r+") as f:
        f["VTKHDF/PointData/volume"][3] += 1e-9
    with pytest.raises(InputFileError, match="volume does not match its digest"):
        verify_file(path)


def test_random_damage_is_never_silent(tmp_path: Path) -> None:
    """300 mutations of a sealed file: each is refused, or changes nothing that is read."""
    path = written(tmp_path / "c.vtkhdf")
    good = path.read_bytes()
    x, fields = charge()
    rng = np.random.default_rng(2)
    refused = 0
    for _ in range(300):
        data = bytearray(good)
        kind = rng.integers(3)
        at = int(rng.integers(len(data)))
        if kind == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data = data[:at]
        else:
            data[at : at + 512] = bytes(min(512, len(data) - at))
        path.write_bytes(data)
        try:
            verify_file(path)
            got = read_particles(path, "charge")
        except InputFileError:
            refused += 1
            continue
        assert np.array_equal(got.positions, x)
        for name, values in fields.items():
            assert np.array_equal(got.fields[name], values), name
    assert refused > 100
