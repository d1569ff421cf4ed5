"""A CT volume shared out to the jobs of a workflow engine gives the file that one job gives."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ppmc.ct import stage
from ppmc.ct.stage import run
from ppmc.files import read_voxels
from ppmc.scene import load_scene

ROOT = Path(__file__).parents[2]
SCENE = """\
name: shared
seed: 1
phantom: {cavity: [7, 7.2, 2.4], voxel_size: 0.1, platelet: {length: 3, width: 2, thickness: 0.6}}
ct: {memory: 320}
"""


def content(path):
    with read_voxels(path, "orientations") as file:
        return {name: file.read(name) for name in file.names}


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.mark.slow  # starts an interpreter for each job
@pytest.mark.skipif(shutil.which("snakemake") is None, reason="snakemake is not installed")
def test_snakemake_scatters_and_gathers_the_same_orientations(scene_file, tmp_path):
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    command = [
        "snakemake", "-s", str(ROOT / "pipelines" / "Snakefile"), "--cores", "2", "--directory", str(tmp_path),
        "--config", f"scene={scene_file}", f"runs={tmp_path / 'runs'}", "ct_jobs=3",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PATH": path}, check=False)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "runs" / "shared"
    assert sorted(p.name for p in folder.iterdir()) == ["orientations.vtkhdf", "volume.vtkhdf"]
    assert done.stderr.count("rule ct_share:") == 3
    alone = run(load_scene(scene_file), input=folder / "volume.vtkhdf", output=tmp_path / "alone.vtkhdf")
    want, got = content(alone), content(folder / "orientations.vtkhdf")
    assert want.keys() == got.keys()
    for name in want:
        assert np.array_equal(got[name], want[name]), name


def test_machines_of_any_size_cut_shared_work_alike(scene_file, tmp_path, monkeypatch):
    """A share made on two cores and one made on sixteen belong to the same tiles; none is made twice."""
    scene = load_scene(scene_file)
    volume = stage.make_phantom(scene, tmp_path / "volume.vtkhdf")
    out = tmp_path / "o.vtkhdf"
    computed = []
    original = stage.compute_tiles

    def watched(job, cells, boxes, *rest):
        computed.extend(boxes)
        return original(job, cells, boxes, *rest)

    monkeypatch.setattr(stage, "compute_tiles", watched)
    for number, cores in ((1, 1), (2, 16)):
        monkeypatch.setattr(stage, "threads_of", lambda asked, cores=cores: asked or cores)
        run(scene, input=volume, output=out, part=(number, 2))
    shared = len(computed)
    assert shared == len(set(computed)) > 1
    monkeypatch.setattr(stage, "threads_of", lambda asked: asked or 3)
    run(scene, input=volume, output=out, resume=True)
    assert len(computed) == shared
