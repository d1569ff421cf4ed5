"""Growing and sealed series: contents, VTK, resume, and kill -9."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ppmc.errors import InputFileError, StorageError
from ppmc.files import Provenance, SeriesWriter, open_series

N = 50
FIELDS = ("fibre_direction", "deformation_gradient", "volume_ratio", "velocity", "pressure")


def frame(k: int, n: int = N) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(k)
    p = rng.normal(size=(n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    fields = {
        "fibre_direction": p,
        "deformation_gradient": rng.normal(size=(n, 3, 3)),
        "volume_ratio": rng.uniform(0.9, 1.1, n),
        "velocity": rng.normal(size=(n, 3)),
        "pressure": rng.normal(size=n),
    }
    return rng.normal(size=(n, 3)), fields


def static(n: int = N) -> dict[str, np.ndarray]:
    return {"platelet_id": np.arange(n), "reference_position": np.ones((n, 3)), "volume": np.full(n, 0.5)}


def grow(path: Path, frames: int, n: int = N) -> SeriesWriter:
    writer = SeriesWriter.create(path, n, static(n), FIELDS, ("press_force",), provenance=Provenance.collect("test"))
    for k in range(frames):
        x, fields = frame(k, n)
        writer.append(0.1 * k, x, fields, {"press_force": float(k)})
    return writer


def same_frame(got: dict[str, np.ndarray], k: int, n: int = N) -> None:
    x, fields = frame(k, n)
    assert np.array_equal(got["position"], x)
    for name, values in fields.items():
        assert np.array_equal(got[name].reshape(values.shape), values), name


@contextmanager
def held_open(path: Path) -> Iterator[None]:
    """As by a viewer: HDF5 takes a shared lock on what it reads."""
    with path.open("rb") as handle:
        fcntl.flock(handle, fcntl.LOCK_SH)
        yield


def test_a_frame_waits_while_a_viewer_holds_the_file(tmp_path: Path) -> None:
    writer = grow(tmp_path / "flow.partial.vtkhdf", 1)
    x, fields = frame(1)
    late = threading.Thread(target=writer.append, args=(0.1, x, fields, {"press_force": 1.0}))
    with held_open(writer.path):
        late.start()
        time.sleep(0.5)
        assert writer.frames == 1
    late.join()
    assert writer.frames == 2
    with open_series(writer.path, "flow") as flow:
        same_frame(flow.frame(1), 1)


def test_a_viewer_that_never_lets_go_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ppmc.files.growing.LOCKED_SECONDS", 0.0)
    writer = grow(tmp_path / "flow.partial.vtkhdf", 1)
    x, fields = frame(1)
    with held_open(writer.path), pytest.raises(StorageError, match=r"flow\.partial\.vtkhdf: another program"):
        writer.append(0.1, x, fields, {"press_force": 1.0})
    assert writer.frames == 1


@pytest.mark.parametrize("sealed", [False, True])
def test_round_trip(tmp_path: Path, sealed: bool) -> None:
    path = tmp_path / "flow.partial.vtkhdf"
    writer = grow(path, 4)
    if sealed:
        final = tmp_path / "flow.vtkhdf"
        writer.seal(final, {"time": np.arange(9.0)}, {"note": "x"})
        assert not path.exists()
        path = final
    with open_series(path, "flow") as flow:
        assert flow.complete is sealed
        assert np.array_equal(flow.times, 0.1 * np.arange(4))
        assert np.array_equal(flow.scalars["press_force"], np.arange(4.0))
        assert np.array_equal(flow.static["platelet_id"], np.arange(N))
        for k in range(4):
            same_frame(flow.frame(k), k)
        same_frame(flow.frame(-1), 3)
        with pytest.raises(InputFileError, match="has 4 frames, frame 4"):
            flow.frame(4)
        if sealed:
            assert np.array_equal(flow.history["time"], np.arange(9.0))
            assert flow.extra == {"note": "x"}


def test_equal_work_gives_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        grow(tmp_path / f"{name}.partial", 3).seal(tmp_path / name, {"time": np.arange(3.0)})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_resume_drops_frames_past_the_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "flow.partial.vtkhdf"
    grow(path, 5)
    writer = SeriesWriter.resume(path, frames=3)
    x, fields = frame(7)
    writer.append(0.3, x, fields, {"press_force": 7.0})
    with open_series(path, "flow") as flow:
        assert len(flow.times) == 4
        same_frame(flow.frame(2), 2)
        same_frame(flow.frame(3), 7)
    with pytest.raises(InputFileError, match="holds 4 frames, the checkpoint goes with 9"):
        SeriesWriter.resume(path, frames=9)


@pytest.mark.parametrize("sealed", [False, True])
def test_vtk_reads_every_step(tmp_path: Path, sealed: bool) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    path = tmp_path / "flow.vtkhdf"
    writer = grow(path if not sealed else tmp_path / "growing.vtkhdf", 3)
    if sealed:
        writer.seal(path)
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 3
    for k in range(3):
        reader.SetStep(k)
        reader.Update()
        mesh = reader.GetOutput()
        x, fields = frame(k)
        assert np.array_equal(vtk_to_numpy(mesh.GetPoints().GetData()), x)
        for name, values in fields.items():
            got = vtk_to_numpy(mesh.GetPointData().GetArray(name))
            assert np.array_equal(got.reshape(values.shape), values), name
        assert np.array_equal(vtk_to_numpy(mesh.GetPointData().GetArray("platelet_id")), np.arange(N))
        assert mesh.GetPointData().GetVectors().GetName() == "fibre_direction"


def test_pyvista_reads_it(tmp_path: Path) -> None:
    import pyvista

    path = tmp_path / "flow.vtkhdf"
    grow(tmp_path / "growing.vtkhdf", 2).seal(path)
    mesh = pyvista.read(path)
    assert mesh.n_points == N
    assert mesh["fibre_direction"].shape == (N, 3)


WRITER = """
import sys, importlib.util
spec = importlib.util.spec_from_file_location("series_test", sys.argv[1])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
from pathlib import Path
n = 4000
writer = module.grow(Path(sys.argv[2]), 0, n)
x, fields = module.frame(3, n)
print("ready", flush=True)
for k in range(10000):
    writer.append(0.1 * k, x, fields)
    print(k, flush=True)
"""


def test_killed_writer_leaves_every_finished_frame_readable(tmp_path: Path) -> None:
    """20 kills at random moments: no unreadable file, no acknowledged frame lost, all go on."""
    rng = np.random.default_rng(5)
    n = 4000
    for kill in range(20):
        path = tmp_path / f"killed-{kill}.vtkhdf"
        command = [sys.executable, "-c", WRITER, __file__, str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            time.sleep(float(rng.uniform(0.01, 0.4)))
            os.kill(process.pid, signal.SIGKILL)
            told = process.stdout.read().split("\n")
        acknowledged = int(told[-2]) + 1 if len(told) > 1 else 0
        writer = SeriesWriter.resume(path)
        assert writer.frames >= acknowledged
        x, fields = frame(3, n)
        writer.append(99.0, x, fields)
        with open_series(path, "flow") as flow:
            assert flow.times[-1] == 99.0
            for k in range(len(flow.times)):
                same_frame(flow.frame(k), 3, n)


def test_inputs_of_one_name_are_kept_apart(tmp_path: Path) -> None:
    paths = [tmp_path / folder / "flow.vtkhdf" for folder in ("a", "b", "c/b")]
    for path in paths:
        path.parent.mkdir(parents=True)
        path.write_text(str(path.parent.relative_to(tmp_path)))
    found = Provenance.collect("ppmc.test", inputs=paths)
    assert list(found.inputs) == ["flow.vtkhdf", "b/flow.vtkhdf", "b/flow.vtkhdf (2)"]
    assert len(set(found.inputs.values())) == 3
    assert found.key != Provenance.collect("ppmc.test", inputs=paths[::-1]).key


def test_provenance_is_kept(tmp_path: Path) -> None:
    source = tmp_path / "in.txt"
    source.write_text("x")
    origin = Provenance.collect("ppmc.test", inputs=[source, None], seed=5)
    path = tmp_path / "flow.vtkhdf"
    writer = SeriesWriter.create(path, N, static(), FIELDS, provenance=origin)
    x, fields = frame(0)
    writer.append(0.0, x, fields)
    with open_series(path, "flow") as flow:
        assert flow.provenance == origin
        assert json.loads(json.dumps(flow.provenance.inputs)) == {
            "in.txt": "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
        }
