"""A voxel, a particle of the charge and a region is one row in every field: read from the files that commands wrote."""

from pathlib import Path

import numpy as np
import pytest

from ppmc.cli import _run
from ppmc.files import open_series, read_particles, read_voxels
from ppmc.orientation import angle_between_axes, from_six

SCENE = """\
name: rows
seed: 4
phantom:
  cavity: [6 mm, 5 mm, 2.4 mm]
  voxel_size: 0.1 mm
  platelet: {{length: 4 mm, width: 2 mm, thickness: 0.6 mm}}
  noise: 0.1
ct: {{stride: 2, platelet_thickness: 0.6 mm, memory: 310, threads: 1}}
charge:
  domain: {{shape: box, size: [6 mm, 5 mm, 2.4 mm]}}
  spacing: 0.6 mm
  orientation: {orientation}
analysis:
  regions:
    left: {{min: [0, 0, 0], max: [2.3, 5, 2.4]}}
    above: {{min: [0, 0, 1.3], max: [6, 5, 2.4]}}
    corner: {{min: [3.5, 2.6, 0], max: [6, 5, 0.9]}}
  path: {{kind: straight, axis: x2, slices: 4}}
"""
FROM_CT = "{source: ct, platelet_ids: volume.vtkhdf, fallback: {source: nearest}}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a scene from phantom to charge, the CT in tiles of a small memory budget."""
    where = tmp_path_factory.mktemp("rows")
    (where / "scene.yaml").write_text(SCENE.format(orientation=FROM_CT))
    scene, volume, orientations, charge = (
        str(where / n) for n in ("scene.yaml", "volume.vtkhdf", "orientations.vtkhdf", "charge.vtkhdf")
    )
    assert _run(["phantom", scene, "--output", volume]) == 0
    assert _run(["ct", scene, "--input", volume, "--output", orientations]) == 0
    assert _run(["charge", scene, "--input", orientations, "--output", charge]) == 0
    return where


def grid_points(grid: object, shape: tuple[int, ...]) -> np.ndarray:
    """Positions of all voxels, shape (n, 3), x first, in the order of raveled [z, y, x] arrays."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)[..., ::-1].reshape(-1, 3)
    return np.asarray(grid.origin) + index * np.asarray(grid.spacing)  # type: ignore[attr-defined]


def test_a_voxels_fields_belong_together_and_to_its_place(folder: Path) -> None:
    with read_voxels(folder / "orientations.vtkhdf", "orientations") as file:
        grid, found = file.grid, {name: file.read(name) for name in file.names}
    with read_voxels(folder / "volume.vtkhdf", "volume") as file:
        fine, truth, true_normal = file.grid, file.read("fibre_direction"), file.read("platelet_normal")
    valid = found["valid"].astype(bool)
    p, r = found["fibre_direction"][valid], found["platelet_normal"][valid]
    assert np.abs(np.einsum("na,na->n", p, r)).max() < 6e-5  # components are multiples of 2^-15
    # Noise is taken off eigenvalues and ratios a little differently; other voxels differ by a tenth and more.
    low, middle, high = np.moveaxis(found["eigenvalues"][valid].astype(float), -1, 0)
    assert (low <= middle).all() and (middle <= high).all()
    np.testing.assert_allclose(found["confidence"][valid], (middle - low) / (middle + low), atol=5e-3)
    # The truth at the same place in space, by the grids' own words.
    at = np.rint((grid_points(grid, valid.shape) - fine.origin) / fine.spacing).astype(int)
    here = truth[at[:, 2], at[:, 1], at[:, 0]].reshape(*valid.shape, 3)
    normal = true_normal[at[:, 2], at[:, 1], at[:, 0]].reshape(*valid.shape, 3)
    known = valid & (np.linalg.norm(here, axis=-1) > 0.5)
    assert known.mean() > 0.7
    error = angle_between_axes(found["fibre_direction"][known].astype(float), here[known].astype(float))
    assert np.median(error) < 4.0
    assert np.mean(error < 15.0) > 0.6  # a sixth in any other order
    assert np.median(angle_between_axes(found["platelet_normal"][known], normal[known])) < 4.0
    # What is said to be uncertain is worse than what is not: errors and predictions are in one order.
    predicted = found["predicted_error"][known]
    worse, better = error[predicted > np.quantile(predicted, 0.9)], error[predicted < np.quantile(predicted, 0.5)]
    assert worse.mean() > 1.5 * better.mean()


def test_a_particle_has_frame_id_and_confidence_of_one_voxel(folder: Path) -> None:
    with read_voxels(folder / "orientations.vtkhdf", "orientations") as file:
        grid, found = file.grid, {name: file.read(name) for name in file.names}
    with read_voxels(folder / "volume.vtkhdf", "volume") as file:
        fine, ids = file.grid, file.read("platelet_id")
    charge = read_particles(folder / "charge.vtkhdf", "charge")
    fields = charge.fields
    assert fields["volume"].sum() == pytest.approx(6 * 5 * 2.4, rel=1e-12)
    p, q, r = (fields[n] for n in ("fibre_direction", "in_plane_direction", "platelet_normal"))
    np.testing.assert_allclose(np.cross(p, q), r, atol=1e-6)
    valid = found["valid"].astype(bool).ravel()
    voxels = grid_points(grid, found["valid"].shape)[valid]
    kinds = {n: found[n].reshape(len(valid), -1)[valid] for n in ("fibre_direction", "platelet_normal", "confidence")}
    at = np.rint((charge.positions - fine.origin) / fine.spacing).astype(int)
    near_ids = ids[at[:, 2], at[:, 1], at[:, 0]]
    for k, x in enumerate(charge.positions):
        distance = np.linalg.norm(voxels - x, axis=1)
        # Several voxels may be equally near: one of them gives all fields.
        same = [
            angle_between_axes(p[k : k + 1], kinds["fibre_direction"][[j]].astype(float))[0] < 0.01
            and angle_between_axes(r[k : k + 1], kinds["platelet_normal"][[j]].astype(float))[0] < 0.01
            and abs(fields["confidence"][k] - kinds["confidence"][j, 0]) < 1e-6
            for j in np.flatnonzero(distance < distance.min() + 1e-4)
        ]
        assert any(same), k
    own = fields["platelet_id"]
    around = [
        ids[max(z - 2, 0) : z + 3, max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3] for x, y, z in at
    ]  # within a voxel of the orientations, which are at every second one
    assert all(own[k] in around[k] for k in range(len(own)))
    assert np.mean(own == near_ids) > 0.5


def test_platelets_have_one_frame_each_and_stand_together(tmp_path: Path) -> None:
    text = SCENE.format(orientation="{source: platelets, length: 3 mm, width: 1.8 mm}")
    (tmp_path / "scene.yaml").write_text(text)
    assert _run(["charge", str(tmp_path / "scene.yaml"), "--output", str(tmp_path / "charge.vtkhdf")]) == 0
    charge = read_particles(tmp_path / "charge.vtkhdf", "charge")
    ids = charge.fields["platelet_id"]
    assert len(np.unique(ids)) > 8
    for number in np.unique(ids[ids >= 0]):
        mine = ids == number
        p, q, r = (charge.fields[n][mine] for n in ("fibre_direction", "in_plane_direction", "platelet_normal"))
        assert np.ptp(p, axis=0).max() < 1e-9
        assert np.ptp(r, axis=0).max() < 1e-9
        away = charge.positions[mine] - charge.positions[mine].mean(axis=0)
        # No particle lies beyond the platelet's own length and width, give or take a cell.
        assert np.abs(np.einsum("na,na->n", away, p)).max() < 3.0 / 2 + 0.9
        assert np.abs(np.einsum("na,na->n", away, q)).max() < 3.0
        assert np.abs(np.einsum("na,na->n", away, r)).max() < 0.31


def test_a_regions_tensors_are_those_of_its_particles(folder: Path) -> None:
    scene, charge, output = (str(folder / n) for n in ("scene.yaml", "charge.vtkhdf", "analysis.vtkhdf"))
    assert _run(["analyze", scene, "--input", charge, "--output", output]) == 0
    particles = read_particles(folder / "charge.vtkhdf", "charge")
    x, weight = particles.positions, particles.fields["volume"]
    p, r = particles.fields["fibre_direction"], particles.fields["platelet_normal"]
    boxes = {
        "whole": ([0, 0, 0], [6, 5, 2.4]), "left": ([0, 0, 0], [2.3, 5, 2.4]), "above": ([0, 0, 1.3], [6, 5, 2.4]),
        "corner": ([3.5, 2.6, 0], [6, 5, 0.9]),
    }  # fmt: skip
    slices = [([0, 1.25 * k, 0], [6, 1.25 * (k + 1), 2.4]) for k in range(4)]
    with open_series(folder / "analysis.vtkhdf", "analysis") as file:
        names, static, rows = file.extra["region_names"], file.static, file.frame(-1)
    assert names[:4] == list(boxes)
    every = [*boxes.values(), *slices]
    assert len(every) == len(static["region_id"])
    for row, (low, high) in enumerate(every):
        inside = ((x >= np.array(low)) & (x <= np.array(high))).all(axis=1)
        w = weight[inside] / weight[inside].sum()
        assert rows["particle_count"][row] == inside.sum()
        assert rows["region_volume"][row] == pytest.approx(weight[inside].sum())
        for name, vectors, axis in (
            ("fibre_tensor", p, "principal_fibre_direction"),
            ("normal_tensor", r, "principal_normal_direction"),
        ):
            exact = np.einsum("n,na,nb->ab", w, vectors[inside], vectors[inside])
            np.testing.assert_allclose(from_six(rows[name][row]), exact, atol=1e-6)
            largest = np.linalg.eigh(exact)[1][:, -1]
            assert abs(largest @ rows[axis][row]) == pytest.approx(1.0, abs=1e-5)
        assert (np.array(low) - 0.7 <= rows["position"][row]).all()
        assert (rows["position"][row] <= np.array(high) + 0.7).all()
