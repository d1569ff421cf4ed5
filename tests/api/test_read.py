"""Every product reads back as the object of its kind; CT and analysis from Python are those of the commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ppmc
from ppmc.cli import run_command
from ppmc.errors import InputFileError, SceneError
from ppmc.files import read_voxels

SCAN = """
name: ct
seed: 3
phantom:
  cavity: [3.2 mm, 2.4 mm, 1.6 mm]
  voxel_size: 0.1 mm
  platelet: {length: 2 mm, width: 1 mm, thickness: 0.4 mm}
"""
CT = """
name: ct
ct: {sigma: 0.1, fibre_window: 0.2, threads: 1, stride: 2, source: {voxel_size: 0.1, path: volume.vtkhdf}}
"""
KEYS = {"sigma": 0.1, "fibre_window": 0.2, "threads": 1, "stride": 2}


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A phantom and its orientations, by the commands."""
    folder = tmp_path_factory.mktemp("scan")
    (folder / "scan.yaml").write_text(SCAN)
    (folder / "ct.yaml").write_text(CT)
    assert run_command(["phantom", str(folder / "scan.yaml"), "--output", str(folder / "volume.vtkhdf")]) == 0
    given = ["--input", str(folder / "volume.vtkhdf"), "--output", str(folder / "orientations.vtkhdf")]
    assert run_command(["ct", str(folder / "ct.yaml"), *given]) == 0
    return folder


def test_voxels(scan: Path) -> None:
    volume, found = ppmc.read(scan / "volume.vtkhdf"), ppmc.read(str(scan / "orientations.vtkhdf"))
    assert isinstance(volume, ppmc.Voxels) and isinstance(found, ppmc.Voxels)
    assert volume.product == "volume" and found.product == "orientations"
    assert volume["grey"].shape == volume.grid.shape == (16, 24, 32)
    image = found.to_pyvista()
    assert image.dimensions == (16, 12, 8) and image.spacing == (0.2, 0.2, 0.2)
    assert np.array_equal(image["fibre_direction"].reshape(8, 12, 16, 3), found["fibre_direction"])
    table = found.to_pandas()
    assert len(table) == found["valid"].sum() and np.trace(found.A) == pytest.approx(1, abs=6e-5)
    assert np.abs(found.A - volume.A).max() < 0.2 and len(volume.particles) == (volume["platelet_id"] >= 0).sum()
    with pytest.raises(InputFileError, match=r"has no field 'gray'; it has grey"):
        volume["gray"]


def test_orientations_in_memory_are_the_file_of_the_command(scan: Path, tmp_path: Path) -> None:
    told = ppmc.read(scan / "orientations.vtkhdf")
    assert isinstance(told, ppmc.Voxels)
    volume = ppmc.read(scan / "volume.vtkhdf")
    assert isinstance(volume, ppmc.Voxels)
    grey, mask = volume["grey"], volume["mask"]
    for found in (
        ppmc.orient(scan / "volume.vtkhdf", voxel_size="100 um", **KEYS),
        ppmc.orient(grey, voxel_size=0.1, mask=mask, **KEYS),
    ):
        assert found.names == told.names and found.grid.shape == told.grid.shape
        for name in told.names:
            assert np.array_equal(found[name], told[name]), name
    path = found.write(tmp_path / "again.vtkhdf")
    with read_voxels(path, "orientations") as again:
        assert np.array_equal(again.read("fibre_direction"), told["fibre_direction"])
    written = ppmc.orient(scan / "volume.vtkhdf", voxel_size=0.1, output=tmp_path / "o.vtkhdf", **KEYS)
    assert np.array_equal(written["confidence"], told["confidence"])


def test_a_charge_from_ct_in_memory_is_that_from_the_file(scan: Path) -> None:
    found = ppmc.orient(scan / "volume.vtkhdf", voxel_size=0.1, **KEYS)
    volume = ppmc.read(scan / "volume.vtkhdf")
    made = [
        ppmc.Charge.box(
            (3, 2, 1), spacing=0.25, orientation=ppmc.FromCT(given, fallback="nearest", platelet_ids=volume)
        )
        for given in (found, scan / "orientations.vtkhdf")
    ]
    assert np.array_equal(made[0].fibre_direction, made[1].fibre_direction)
    assert np.array_equal(made[0].platelet_id, made[1].platelet_id) and made[0].platelet_id.max() > 0
    assert made[0].provenance.inputs.keys() == {"orientations", "volume.vtkhdf"}


def test_an_analysis_in_memory_is_that_of_the_command(folder: Path, flow: ppmc.Flow, tmp_path: Path) -> None:
    regions = {"corner": {"min": (0, 0, 0), "max": (3, 3, 4)}}
    found = ppmc.analyze(flow, regions=regions, frames="all")
    (tmp_path / "a.yaml").write_text(
        "name: a\nanalysis: {regions: {corner: {min: [0, 0, 0], max: [3, 3, 4]}}, frames: all, views: []}\n"
    )
    output = tmp_path / "analysis.vtkhdf"
    words = ["--input", str(folder / "flow.vtkhdf"), "--output", str(output)]
    assert run_command(["analyze", str(tmp_path / "a.yaml"), *words]) == 0
    told = ppmc.read(output)
    assert isinstance(told, ppmc.Analysis)
    assert found.regions == told.regions and "corner" in told.regions
    assert np.array_equal(found.A, told.A, equal_nan=True) and found.A.shape == (4, len(told.regions), 3, 3)
    assert np.array_equal(found.times, told.times) and np.allclose(found.A[-1, 0], flow[-1].A)
    assert set(found.tables) == set(told.tables)
    for name, table in found.tables.items():
        pd.testing.assert_frame_equal(table.reset_index(drop=True), told.tables[name], rtol=1e-8, check_dtype=False)
    assert told.to_pyvista().n_points == len(told.regions)
    with pytest.raises(InputFileError, match=r"has no table 'region'; it has .*regions"):
        told.to_pandas("region")
    with pytest.raises(SceneError, match="write it first"):
        ppmc.analyze(flow, output=tmp_path / "b.vtkhdf")


def test_a_flow_that_grows(flow: ppmc.Flow, tmp_path: Path) -> None:
    from ppmc.files import SeriesWriter

    series = flow.series
    writer = SeriesWriter.create(
        tmp_path / "f.partial", series.n, series.static, series.names, tuple(series.scalars), provenance=flow.provenance
    )
    fields = series.frame(0)
    writer.append(0.0, fields.pop("position"), fields, {name: v[0] for name, v in series.scalars.items()})
    growing = ppmc.read(tmp_path / "f.partial")
    assert isinstance(growing, ppmc.Flow)
    assert len(growing) == 1 and growing.verdict is None and growing.steps.empty
    assert np.array_equal(growing[0].positions, flow[0].positions)
    with pytest.raises(InputFileError, match=r"holds 'frame'; ppmc.read takes a volume"):
        ppmc.read(tmp_path / "f.partial" / "frame_000000.vtkhdf")


@pytest.mark.parametrize("text", [None, "junk"])
def test_no_product(text: str | None, tmp_path: Path) -> None:
    path = tmp_path / "x.vtkhdf"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputFileError, match=r"x\.vtkhdf"):
        ppmc.read(path)
