"""Faults at every system call of a growing history: at most the frame in flight is lost, and the same bytes result."""

from __future__ import annotations

import importlib.util
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

from ppmc.errors import InputFileError
from ppmc.files import Provenance, SeriesWriter, open_series

_spec = importlib.util.spec_from_file_location("interrupt", Path(__file__).with_name("interrupt.py"))
assert _spec is not None and _spec.loader is not None
interrupt = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(interrupt)

N, FRAMES = 20, 3
STRIDE = 19  # prime to the calls of a frame; `make -C pipelines faults` goes through them all
FIELDS = ("fibre_direction", "deformation_gradient", "volume_ratio", "velocity", "pressure")


def values(k: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(k)
    p = rng.normal(size=(N, 3))
    return {
        "fibre_direction": p / np.linalg.norm(p, axis=1, keepdims=True),
        "deformation_gradient": rng.normal(size=(N, 9)),
        "volume_ratio": rng.uniform(0.9, 1.1, N),
        "velocity": rng.normal(size=(N, 3)),
        "pressure": rng.normal(size=N),
    }


def begin(folder: Path) -> SeriesWriter:
    static = {"platelet_id": np.arange(N), "reference_position": np.ones((N, 3)), "volume": np.full(N, 0.5)}
    return SeriesWriter.create(
        folder / "flow.partial", N, static, FIELDS, ("press_force",), provenance=Provenance("test", key="k")
    )


def finish(writer: SeriesWriter, folder: Path) -> None:
    for k in range(writer.frames, FRAMES):
        writer.append(0.1 * k, np.full((N, 3), float(k)), values(k), {"press_force": float(k)})
        (folder / "acknowledged").write_text(str(k + 1))
    writer.seal(folder / "flow.vtkhdf", {"time": np.arange(3.0)})


def go_on(folder: Path) -> None:
    """As a resumed run does: from the frames that are there, or from the start if there are none."""
    if (folder / "flow.vtkhdf").exists():
        return
    try:
        writer = SeriesWriter.resume(folder / "flow.partial")
    except InputFileError:
        assert not (folder / "acknowledged").exists()
        writer = begin(folder)
    told = folder / "acknowledged"
    assert writer.frames >= (int(told.read_text()) if told.exists() else 0)
    for k in range(writer.frames):
        with open_series(folder / "flow.partial", "flow") as flow:
            assert np.array_equal(flow.frame(k)["velocity"], values(k)["velocity"])
    finish(writer, folder)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("whole")
    finish(begin(folder), folder)
    return (folder / "flow.vtkhdf").read_bytes()


@pytest.mark.parametrize("fault", ["kill", "error"])
def test_a_fault_at_every_call_loses_at_most_the_frame_in_flight(tmp_path: Path, whole: bytes, fault: str) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    status, calls = interrupt.in_child(lambda: finish(begin(folder), folder), fault, 10**9)
    assert status == 0 and calls > 40
    assert (folder / "flow.vtkhdf").read_bytes() == whole
    for at in range(1, calls + 1, STRIDE):
        shutil.rmtree(folder)
        folder.mkdir()
        status, _ = interrupt.in_child(lambda: finish(begin(folder), folder), fault, at)
        assert status == (-signal.SIGKILL if fault == "kill" else 5), at
        go_on(folder)
        assert (folder / "flow.vtkhdf").read_bytes() == whole, at


def test_short_writes_change_nothing(tmp_path: Path, whole: bytes) -> None:
    status, _ = interrupt.in_child(lambda: finish(begin(tmp_path), tmp_path), "short", 0)
    assert status == 0
    assert (tmp_path / "flow.vtkhdf").read_bytes() == whole
