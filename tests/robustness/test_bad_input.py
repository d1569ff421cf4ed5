"""Bad input through the command line: one message, the right exit code, nothing left behind."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from ppmc.cli import _run
from ppmc.files import Provenance, VoxelGrid, write_voxels

SCENE = """\
name: small
charge:
  domain: {shape: box, size: [2 mm, 2 mm, 1 mm]}
  spacing: 0.5 mm
  orientation: {source: ct}
"""
GRID = VoxelGrid((10, 20, 20), (0.1, 0.1, 0.1), (0.05, 0.05, 0.05))


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A folder with a good scene and a good orientations file."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    p = np.zeros((*GRID.shape, 3), np.float32)
    p[..., 0] = 1
    r = np.zeros_like(p)
    r[..., 2] = 1
    fields = {"fibre_direction": p, "platelet_normal": r, "valid": np.ones(GRID.shape, np.uint8)}
    write_voxels(tmp_path / "o.vtkhdf", "orientations", fields, grid=GRID, provenance=Provenance.collect("test"))
    return tmp_path


def charge(case: Path, output: str = "charge.vtkhdf") -> int:
    return _run(["charge", str(case / "scene.yaml"), "--input", str(case / "o.vtkhdf"), "--output", str(case / output)])


def refused(
    case: Path, code: int, *words: str, capsys: pytest.CaptureFixture[str], output: str = "charge.vtkhdf"
) -> None:
    """Run, and check code, message, and that no file was added."""
    before = {p.name: p.read_bytes() for p in case.iterdir() if p.is_file()}
    capsys.readouterr()
    assert charge(case, output) == code
    message = capsys.readouterr().err
    assert message.startswith("ppmc: ") and "Traceback" not in message
    for word in words:
        assert word in message, message
    assert {p.name: p.read_bytes() for p in case.iterdir() if p.is_file()} == before


def change(case: Path, old: str, new: str) -> None:
    text = (case / "scene.yaml").read_text()
    assert old in text
    (case / "scene.yaml").write_text(text.replace(old, new))


def test_the_good_case_works(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert charge(case) == 0, capsys.readouterr().err
    assert (case / "charge.vtkhdf").exists()


def test_missing_file(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (case / "o.vtkhdf").unlink()
    refused(case, 3, "o.vtkhdf", "ppmc ct", capsys=capsys)


def test_wrong_dataset_shape(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(case / "o.vtkhdf", "r+") as f:
        del f["VTKHDF/PointData/fibre_direction"]
        f["VTKHDF/PointData/fibre_direction"] = np.zeros((10, 20, 19, 3), np.float32)
    refused(case, 3, "o.vtkhdf", "fibre_direction", "(10, 20, 19, 3)", "(10, 20, 20)", capsys=capsys)


@pytest.mark.parametrize(("value", "words"), [(np.nan, "is not finite"), (2.0, "must have unit length")])
def test_bad_vectors(case: Path, value: float, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(case / "o.vtkhdf", "r+") as f:
        f["VTKHDF/PointData/fibre_direction"][4, :, :, 0] = value
    refused(case, 3, "o.vtkhdf", "fibre_direction[", words, capsys=capsys)


def test_truncated_file(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = (case / "o.vtkhdf").read_bytes()
    (case / "o.vtkhdf").write_bytes(data[: len(data) // 2])
    refused(case, 3, "o.vtkhdf", "truncated", capsys=capsys)


def test_external_link(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(case / "o.vtkhdf", "r+") as f:
        del f["VTKHDF/PointData/fibre_direction"]
        f["VTKHDF/PointData/fibre_direction"] = h5py.ExternalLink("secret.h5", "/x")
    refused(case, 3, "fibre_direction", "ExternalLink", capsys=capsys)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("spacing: 0.5 mm", "spacing: -0.5 mm", ("scene.yaml:4", "spacing", "-0.5 mm")),
        ("spacing: 0.5 mm", "spacing: 0.5 s", ("scene.yaml:4", "spacing", "expected mm, got second")),
        ("spacing: 0.5 mm", "spacin: 0.5 mm", ("scene.yaml:4", "spacin: unknown key", "did you mean 'spacing'?")),
        ("name: small", "name: [small", ("scene.yaml", "not readable as YAML")),
        ("size: [2 mm, 2 mm, 1 mm]", "size: [9 mm, 2 mm, 1 mm]", ("o.vtkhdf", "have a valid voxel", "fallback")),
    ],
)
def test_bad_scene(case: Path, old: str, new: str, words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    change(case, old, new)
    refused(case, 2, *words, capsys=capsys)


def test_output_folder_not_writable(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (case / "file").write_text("")
    refused(case, 5, "file", "cannot write here", "--output", capsys=capsys, output="file/charge.vtkhdf")


def test_input_is_output(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(case, 2, "o.vtkhdf", "input and output are the same file", capsys=capsys, output="o.vtkhdf")


def test_wrong_product(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert charge(case) == 0
    (case / "charge.vtkhdf").replace(case / "o.vtkhdf")
    refused(case, 3, "holds 'charge'", "'orientations' is needed", "ppmc ct", capsys=capsys)
