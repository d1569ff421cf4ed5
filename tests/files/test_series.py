"""Growing and sealed series: contents, VTK, resume, and kill -9."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


@pytest.mark.parametrize("sealed", [False, True])
def test_round_trip(tmp_path: Path, sealed: bool) -> None:
    path = tmp_path / "flow.partial"
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
    path = tmp_path / "flow.partial"
    grow(path, 5)
    writer = SeriesWriter.resume(path, frames=3)
    x, fields = frame(7)
    writer.append(0.3, x, fields, {"press_force": 7.0})
    with open_series(path, "flow") as flow:
        assert len(flow.times) == 4
        same_frame(flow.frame(2), 2)
        same_frame(flow.frame(3), 7)
    with pytest.raises(InputFileError, match="holds 4 sound frames, the checkpoint goes with 9"):
        SeriesWriter.resume(path, frames=9)


def vtk_steps(path: Path) -> Iterator[Any]:
    """Yield the mesh of each time step as VTK reads it."""
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    for k in range(max(1, reader.GetNumberOfSteps())):
        reader.SetStep(k)
        reader.Update()
        yield reader.GetOutput()


def same_in_vtk(mesh: Any, k: int) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    x, fields = frame(k)
    assert np.array_equal(vtk_to_numpy(mesh.GetPoints().GetData()), x)
    for name, values in fields.items():
        got = vtk_to_numpy(mesh.GetPointData().GetArray(name))
        assert np.array_equal(got.reshape(values.shape), values), name
    assert np.array_equal(vtk_to_numpy(mesh.GetPointData().GetArray("platelet_id")), np.arange(N))
    assert mesh.GetPointData().GetVectors().GetName() == "fibre_direction"
    assert mesh.GetNumberOfVerts() == N


def test_vtk_reads_every_step(tmp_path: Path) -> None:
    grow(tmp_path / "flow.partial", 3).seal(tmp_path / "flow.vtkhdf")
    meshes = list(vtk_steps(tmp_path / "flow.vtkhdf"))
    assert len(meshes) == 3
    for k, mesh in enumerate(vtk_steps(tmp_path / "flow.vtkhdf")):
        same_in_vtk(mesh, k)


def test_vtk_and_pyvista_watch_a_run_that_grows(tmp_path: Path) -> None:
    import pyvista

    writer = grow(tmp_path / "flow.partial", 2)
    for frames in (2, 3):
        reader = pyvista.get_reader(tmp_path / "flow.partial" / "flow.vtkhdf.series")
        assert reader.time_values == [0.1 * k for k in range(frames)]
        for k in range(frames):
            reader.set_active_time_point(k)
            mesh = reader.read()
            assert np.array_equal(mesh["velocity"], frame(k)[1]["velocity"])
            (seen,) = vtk_steps(tmp_path / "flow.partial" / f"frame_{k:06d}.vtkhdf")
            same_in_vtk(seen, k)
        x, fields = frame(frames)
        writer.append(0.1 * frames, x, fields, {"press_force": 2.0})


def test_a_viewer_that_holds_a_frame_keeps_nobody_waiting(tmp_path: Path) -> None:
    """HDF5 takes a shared lock on what it reads; no frame is ever opened for writing again."""
    writer = grow(tmp_path / "flow.partial", 1)
    with (tmp_path / "flow.partial" / "frame_000000.vtkhdf").open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        x, fields = frame(1)
        writer.append(0.1, x, fields, {"press_force": 1.0})
        writer.seal(tmp_path / "flow.vtkhdf")
    with open_series(tmp_path / "flow.vtkhdf", "flow") as flow:
        same_frame(flow.frame(1), 1)


def test_pyvista_reads_it(tmp_path: Path) -> None:
    import pyvista

    path = tmp_path / "flow.vtkhdf"
    grow(tmp_path / "growing", 2).seal(path)
    mesh = pyvista.read(path)
    assert mesh.n_points == N
    assert mesh["fibre_direction"].shape == (N, 3)
    # It is the first frame, and says so: its own time beside those of all frames.
    assert mesh.field_data["Time"].tolist() == [0.0] and mesh.field_data["frame_times"].tolist() == [0.0, 0.1]
    last = pyvista.get_reader(path)
    last.reader.SetStep(last.reader.GetNumberOfSteps() - 1)
    mesh = last.read()
    assert np.array_equal(mesh["velocity"], frame(1)[1]["velocity"])
    assert mesh.field_data["Time"].tolist() == [0.1] and mesh.field_data["frame_times"].tolist() == [0.0, 0.1]


def test_a_folder_of_others_is_not_emptied(tmp_path: Path) -> None:
    (tmp_path / "flow.partial").mkdir()
    (tmp_path / "flow.partial" / "thesis.txt").write_text("years of work")
    with pytest.raises(StorageError, match=r"thesis\.txt, which is not ppmc's"):
        grow(tmp_path / "flow.partial", 1)
    assert (tmp_path / "flow.partial" / "thesis.txt").read_text() == "years of work"


@pytest.mark.parametrize("name", ["frame_000001.vtkhdf", "header.vtkhdf"])
def test_a_damaged_frame_is_found_on_resume_and_when_sealing(tmp_path: Path, name: str) -> None:
    writer = grow(tmp_path / "flow.partial", 3)
    path = tmp_path / "flow.partial" / name
    data = bytearray(path.read_bytes())
    data[-(len(data) // 3)] ^= 4
    path.write_bytes(data)
    with pytest.raises(InputFileError, match=rf"{name}: .*(digest|damaged)"):
        writer.seal(tmp_path / "flow.vtkhdf")
    assert not (tmp_path / "flow.vtkhdf").exists()
    if name != "header.vtkhdf":
        with pytest.raises(InputFileError, match="holds 1 sound frames"):
            SeriesWriter.resume(tmp_path / "flow.partial", 3)


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
        path = tmp_path / f"killed-{kill}"
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
    path = tmp_path / "flow.partial"
    writer = SeriesWriter.create(path, N, static(), FIELDS, provenance=origin)
    x, fields = frame(0)
    writer.append(0.0, x, fields)
    with open_series(path, "flow") as flow:
        assert flow.provenance == origin
        assert json.loads(json.dumps(flow.provenance.inputs)) == {
            "in.txt": "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
        }
