"""Tiles cover the volume once, fit the budget, and may be kept, lost and shared out without changing a bit."""

import subprocess
import sys

import h5py
import numpy as np
import pytest

from ppmc.ct.settings import settings
from ppmc.ct.stage import make_phantom, run
from ppmc.ct.tiles import BASE_BYTES, MIB, tile_bytes, tiling
from ppmc.errors import SceneError
from ppmc.files import read_voxels
from ppmc.scene import Scene
from ppmc.scene.sections.ct import CtSection

PHANTOM = {"cavity": (7, 7.2, 2.4), "voxel_size": 0.1, "platelet": {"length": 3, "width": 2, "thickness": 0.6}}


@pytest.mark.parametrize("shape", [(1024, 1024, 1024), (60, 160, 240), (2000, 300, 50), (5, 5, 5), (3, 3, 70)])
@pytest.mark.parametrize("stride", [1, 4])
def test_tiles_cover_once_and_fit(shape, stride):
    chosen = settings(CtSection(), (0.1, 0.1, 0.1), (256, 256, 256), 0.6)
    budget, threads = 1024.0, 2
    tiles = tiling(shape, chosen, stride=stride, budget=budget, threads=threads, itemsize=1, masked=False)
    covered = sum(np.prod([b - a for a, b in box]) for box in tiles.boxes())
    assert covered == np.prod(shape)
    need = threads * tile_bytes(tiles.tile, chosen, stride, 1, False)
    assert need + BASE_BYTES <= budget * MIB


def test_too_little_memory_is_refused_with_the_amount_needed():
    chosen = settings(CtSection(), (0.1, 0.1, 0.1), (256, 256, 256), 0.6)
    with pytest.raises(SceneError, match=r"100 MiB is too little for 2 threads.*need \d+ MiB"):
        tiling((512, 512, 512), chosen, stride=1, budget=100.0, threads=2, itemsize=1, masked=False)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiles")
    scene = Scene(name="t", seed=1, phantom=PHANTOM, ct={"memory": 296, "threads": 1})
    volume = make_phantom(scene, folder / "volume.vtkhdf")
    whole = Scene(name="t", seed=1, phantom=PHANTOM, ct={"memory": 4000, "threads": 2})
    return scene, volume, content(run(whole, input=volume, output=folder / "whole.vtkhdf"))


def content(path):
    with read_voxels(path, "orientations") as file:
        return {name: file.read(name) for name in file.names}


def same(a, b):
    assert a.keys() == b.keys()
    for name in a:
        assert np.array_equal(a[name], b[name]), name


def test_budget_and_threads_change_no_bit(case, tmp_path):
    scene, volume, want = case
    same(content(run(scene, input=volume, output=tmp_path / "a.vtkhdf")), want)
    assert [p.name for p in tmp_path.iterdir()] == ["a.vtkhdf"]


def test_shares_on_several_machines_give_the_same_file(case, tmp_path):
    scene, volume, want = case
    out = tmp_path / "a.vtkhdf"
    for number in (2, 1):
        folder = run(scene, input=volume, output=out, part=(number, 2))
        assert folder.is_dir()
        assert not out.exists()
    same(content(run(scene, input=volume, output=out, resume=True)), want)
    assert not folder.exists()


def test_stopped_work_is_resumed_and_damaged_tiles_are_made_again(case, tmp_path, monkeypatch):
    scene, volume, want = case
    out = tmp_path / "a.vtkhdf"
    folder = run(scene, input=volume, output=out, part=(1, 1))
    tiles = sorted(folder.iterdir())
    assert len(tiles) > 3
    tiles[0].unlink()
    with h5py.File(tiles[1], "r+") as file:
        data = file["state/confidence"]
        data[0, 0, 0] = 0.123
    computed = []
    import ppmc.ct.stage as stage

    original = stage.compute_tiles
    monkeypatch.setattr(
        stage, "compute_tiles", lambda j, c, boxes, *rest: computed.extend(boxes) or original(j, c, boxes, *rest)
    )
    same(content(run(scene, input=volume, output=out, resume=True)), want)
    assert len(computed) == 2


def test_tiles_of_another_scene_are_not_used(case, tmp_path):
    scene, volume, _ = case
    out = tmp_path / "a.vtkhdf"
    run(scene, input=volume, output=out, part=(1, 1))
    other = Scene(name="t", seed=1, phantom=PHANTOM, ct={"memory": 296, "threads": 1, "sigma": 0.12})
    changed = content(run(other, input=volume, output=out, resume=True))
    assert not np.array_equal(changed["fibre_direction"], case[2]["fibre_direction"])


@pytest.mark.slow  # compiles in a fresh process and works through 57 million voxels
def test_peak_memory_stays_within_the_budget(tmp_path):
    n, budget = 384, 420
    grey = np.random.default_rng(0).integers(60, 200, (n, n, n), dtype=np.uint8)
    grey.tofile(tmp_path / "a.raw")
    script = f"""
import resource
from pathlib import Path
from ppmc.ct.stage import run
from ppmc.scene import Scene
source = {{"shape": [{n}] * 3, "dtype": "uint8", "voxel_size": 0.1}}
scene = Scene(name="m", ct={{"source": source, "platelet_thickness": 0.8, "memory": {budget}, "threads": 2}})
run(scene, input=Path("a.raw"), output=Path("o.vtkhdf"))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    # pages of the memory-mapped input count too, though the system may take them back at any time
    assert float(done.stdout) < budget + grey.nbytes / 2**20
