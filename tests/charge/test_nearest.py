"""The nearest-voxel map against brute force, in pieces and in one, and its refusals."""

from types import SimpleNamespace

import numpy as np
import pytest

from ppmc.charge.orientations.from_ct import frames_from_ct, placement
from ppmc.charge.orientations.nearest import nearest_valid_voxels, read_voxels_at
from ppmc.errors import InputFileError, SceneError
from ppmc.files import VoxelGrid
from ppmc.orientation import angle_between_axes
from ppmc.scene.sections.charge import CtOrientation

TURNED = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def fake_file(shape=(9, 11, 13), spacing=(0.5, 0.4, 0.7), origin=(1.0, -2.0, 3.0), direction=None, share=0.3, seed=0):
    """Return an orientations file in memory; `largest` records the most bytes of a single read."""
    generator = np.random.default_rng(seed)
    p = generator.normal(size=(*shape, 3))
    p /= np.linalg.norm(p, axis=-1, keepdims=True)
    r = np.cross(p, generator.normal(size=(*shape, 3)))
    r /= np.linalg.norm(r, axis=-1, keepdims=True)
    data = {
        "fibre_direction": p.astype(np.float32),
        "platelet_normal": r.astype(np.float32),
        "valid": (generator.random(shape) < share).astype(np.uint8),
        "confidence": generator.random(shape).astype(np.float32),
        "platelet_id": np.arange(np.prod(shape), dtype=np.int32).reshape(shape),
    }
    file = SimpleNamespace(grid=VoxelGrid(shape, spacing, origin, direction or np.eye(3)), names=tuple(data), largest=0)

    def read(name, block):
        part = data[name][block]
        file.largest = max(file.largest, part.nbytes)
        return part

    file.read, file.data = read, data
    file.read_points = lambda name, block, points: file.read(name, block)[tuple(points.T)]
    return file


def brute_force(file, points, radius, confidence):
    """Return index and distance of the nearest valid voxel; all pairs, so for small volumes only."""
    ok = (file.data["valid"] > 0) & (file.data["confidence"] >= confidence)
    where = np.argwhere(ok)
    centres = file.grid.to_world(where[:, ::-1].astype(float))
    distance = np.linalg.norm(points[:, None] - centres[None], axis=2)
    best = distance.argmin(axis=1)
    near = distance[np.arange(len(points)), best]
    voxel = np.where((near <= radius)[:, None], where[best], -1)
    return voxel, np.where(near <= radius, near, np.inf)


@pytest.mark.parametrize("direction", [None, TURNED])
@pytest.mark.parametrize(("radius", "confidence"), [(0.45, 0.0), (1.3, 0.5), (1.3, 0.97), (np.inf, 0.99)])
@pytest.mark.parametrize("slab_bytes", [2**26, 700])
def test_map_equals_brute_force(direction, radius, confidence, slab_bytes):
    file = fake_file(direction=direction)
    corner, far = file.grid.to_world(np.array([[-2.0, -2, -2], [15, 13, 11]]))
    points = np.random.default_rng(1).uniform(np.minimum(corner, far), np.maximum(corner, far), size=(300, 3))
    found = nearest_valid_voxels(file, points, radius=radius, confidence=confidence, slab_bytes=slab_bytes)
    voxel, distance = brute_force(file, points, max(radius, 0.5 * np.linalg.norm(file.grid.spacing)), confidence)
    assert np.array_equal(found.voxel, voxel)
    np.testing.assert_allclose(found.distance, distance, rtol=1e-12)
    index = file.grid.to_index(points)
    assert np.array_equal(found.outside, np.any((index < -0.5) | (index > [12.5, 10.5, 8.5]), axis=1))


def test_reads_are_bounded_and_skip_slices_without_particles():
    file = fake_file(shape=(60, 8, 8), share=1.0)
    reads = []
    inner = file.read
    file.read = lambda name, block: reads.append(block[0]) or inner(name, block)
    z = np.array([5.0, 50.0])
    points = file.grid.to_world(np.array([[3.0, 3, k] for k in z]))
    found = nearest_valid_voxels(file, points, radius=0.1)
    assert np.array_equal(found.voxel[:, 0], z)
    assert sum(s.stop - s.start for s in reads) <= 6
    many = file.grid.to_world(np.random.default_rng(0).uniform(0, [7, 7, 59], size=(400, 3)))
    file.largest = 0
    voxel = nearest_valid_voxels(file, many, radius=0.1, slab_bytes=2000).voxel
    ids = read_voxels_at(file, "platelet_id", voxel, slab_bytes=2000)
    assert file.largest <= 2000
    assert np.array_equal(ids, file.data["platelet_id"][tuple(voxel.T)])


def test_frames_are_taken_over_whole_and_never_mixed():
    file = fake_file()
    section = CtOrientation(fallback={"source": "nearest"}, confidence=0.2)
    points = file.grid.to_world(np.random.default_rng(2).uniform(0, 8, size=(200, 3)))
    frames = frames_from_ct(section, file, points, (0.5, 0.5, 0.5), np.random.default_rng(0), platelet_ids=file)
    voxel, _ = brute_force(file, points, np.inf, 0.2)
    assert angle_between_axes(frames.fibre_direction, file.data["fibre_direction"][tuple(voxel.T)]).max() < 1e-4
    assert angle_between_axes(frames.platelet_normal, file.data["platelet_normal"][tuple(voxel.T)]).max() < 1e-4
    assert np.abs(np.sum(frames.fibre_direction * frames.platelet_normal, axis=1)).max() < 1e-15
    np.testing.assert_allclose(frames.confidence, file.data["confidence"][tuple(voxel.T)], rtol=1e-6)
    assert np.array_equal(
        frames.platelet_id, file.data["platelet_id"][tuple(np.rint(file.grid.to_index(points)).astype(int)[:, ::-1].T)]
    )
    assert frames.notes["particles_without_data"] == np.sum(brute_force(file, points, 0.5, 0.2)[1] > 0.5)


def test_placement_turns_positions_and_directions_together():
    file = fake_file(share=1.0)
    turn = {"rotation": {"axis": [0, 0, 1], "angle": "90 deg"}, "translation": [10, 20, 30]}
    section = CtOrientation.model_validate(turn)
    R, shift = placement(section)
    np.testing.assert_allclose(R, TURNED, atol=1e-15)
    index = np.array([[3.0, 4, 5], [10, 2, 7]])
    points = file.grid.to_world(index) @ R.T + shift
    frames = frames_from_ct(section, file, points, (0.5, 0.5, 0.5), np.random.default_rng(0))
    taken = file.data["fibre_direction"][index[:, 2].astype(int), index[:, 1].astype(int), index[:, 0].astype(int)]
    np.testing.assert_allclose(frames.fibre_direction, np.stack([-taken[:, 1], taken[:, 0], taken[:, 2]], 1), atol=1e-6)


def test_charge_outside_the_volume_is_refused_with_the_share_covered():
    file = fake_file(share=1.0)
    points = file.grid.to_world(np.stack([np.linspace(0, 24, 100), np.full(100, 5.0), np.full(100, 4.0)], axis=1))
    with pytest.raises(SceneError, match=r"only 5\d\.00% of the 100 particles .* lie outside the CT volume"):
        frames_from_ct(CtOrientation(), file, points, (0.4, 0.4, 0.4), np.random.default_rng(0), name="scan")


def test_each_fallback_fills_the_gaps_and_says_so():
    file = fake_file(share=0.05)
    points = file.grid.to_world(np.random.default_rng(2).uniform(0, 8, size=(500, 3)))
    gaps = brute_force(file, points, 0.5, 0.0)[1] > 0.5
    assert 50 < gaps.sum() < 500
    for fallback, code in (
        ({"source": "uniform", "fibre_direction": [0, 1, 0]}, 0),
        ({"source": "planar_random", "normal": [0, 1, 0]}, 2),
        ({"source": "nearest"}, 1),
    ):
        section = CtOrientation.model_validate({"fallback": fallback})
        frames = frames_from_ct(section, file, points, (0.5, 0.5, 0.5), np.random.default_rng(0))
        assert np.array_equal(frames.source == code, gaps if code != 1 else np.ones(500, bool))
        assert frames.notes["share_with_data"] == pytest.approx(1 - gaps.mean())
        if code == 0:
            assert np.all(frames.fibre_direction[gaps] == [0, 1, 0])
        if code == 2:
            assert np.abs(frames.fibre_direction[gaps] @ [0, 1, 0]).max() < 1e-12
        assert np.all(frames.confidence[gaps] == 0) or code == 1


def test_a_volume_without_valid_voxels_and_a_missing_confidence_are_explained():
    points = np.array([[2.0, 0, 5]])
    empty = fake_file(share=0.0)
    with pytest.raises(InputFileError, match="no voxel at all is valid"):
        frames_from_ct(
            CtOrientation(fallback={"source": "nearest"}), empty, points, (1, 1, 1), np.random.default_rng(0)
        )
    bare = fake_file()
    bare.names = ("fibre_direction", "platelet_normal", "valid")
    with pytest.raises(InputFileError, match="no dataset 'confidence'"):
        frames_from_ct(CtOrientation(confidence=0.5), bare, points, (1, 1, 1), np.random.default_rng(0))
