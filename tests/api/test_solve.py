"""A flow from Python is the flow of the command, bit for bit, in memory and in a file."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

import ppmc
from ppmc.errors import InputFileError, NumericalError, SceneError, VerdictError

Solve = Callable[..., ppmc.Flow]
PLANES = [ppmc.tools.plane((0, 0, 0), (0, 0, 1))]
WATER = ppmc.materials.Newtonian(shear_viscosity=1.0)


def test_a_charge_is_the_file_of_the_command(folder: Path, charge: ppmc.Charge, tmp_path: Path) -> None:
    charge.write(tmp_path / "charge.vtkhdf")
    assert (tmp_path / "charge.vtkhdf").read_bytes() == (folder / "charge.vtkhdf").read_bytes()


def test_a_flow_in_memory_is_the_file_of_the_command(folder: Path, flow: ppmc.Flow) -> None:
    told = ppmc.read(folder / "flow.vtkhdf")
    assert isinstance(told, ppmc.Flow)
    assert len(flow) == len(told) == 4
    assert np.array_equal(flow.times, told.times) and flow.times[-1] == 1.2
    for ours, theirs in zip(flow, told, strict=True):
        assert np.array_equal(ours.positions, theirs.positions) and ours.time == theirs.time
        here, there = ours.arrays(), theirs.arrays()
        assert list(here) == list(there)
        for name, values in here.items():
            assert values.dtype == there[name].dtype
            assert np.array_equal(values, there[name]), name
    assert list(flow.steps) == list(told.steps)
    assert np.array_equal(flow.steps.to_numpy(), told.steps.to_numpy(), equal_nan=True)
    assert np.array_equal(flow.press_force, told.press_force) and flow.press_force[-1] > 0
    assert flow.verdict == told.verdict and flow.tools == ("lower", "ram")
    assert flow.series.extra == told.series.extra


def test_an_output_is_the_file_of_the_command(folder: Path, solved: Solve, tmp_path: Path) -> None:
    made = solved(folder / "charge.vtkhdf", output=tmp_path / "flow.vtkhdf")
    assert made.path == tmp_path / "flow.vtkhdf"
    assert made.path.read_bytes() == (folder / "flow.vtkhdf").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(["flow.vtkhdf", "flow.steps.csv"])
    with pytest.raises(InputFileError, match="not the file any more"):
        other = ppmc.Flow.read(made.path)
        made.path.write_bytes(made.path.read_bytes() + b"x")
        other[0]


def test_a_flow_in_memory_is_written_later(folder: Path, flow: ppmc.Flow, tmp_path: Path) -> None:
    path = flow.write(tmp_path / "later.vtkhdf")
    with h5py.File(path) as ours, h5py.File(folder / "flow.vtkhdf") as theirs:
        names: list[str] = []
        theirs.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        for name in names:
            if name not in ("ppmc/inputs", "ppmc/digests/manifest"):
                values = theirs[name][()]
                assert np.array_equal(ours[name][()], values, equal_nan=np.asarray(values).dtype.kind == "f"), name
    assert flow.provenance.inputs.keys() == {"charge"}
    with pytest.raises(ppmc.PpmcError, match="flow"):
        flow.write(folder / "charge.vtkhdf")


def test_frames_are_arrays_tables_and_meshes(flow: ppmc.Flow) -> None:
    last = flow[-1]
    assert last.F.shape == (144, 3, 3) and np.allclose(np.linalg.det(last.F), last.J, atol=0.1)
    assert np.array_equal(last.deformation_gradient, last.F)
    assert np.trace(last.A) == pytest.approx(1) and np.trace(last.N) == pytest.approx(1)
    assert np.allclose(flow.A[-1], last.A) and flow.N.shape == (4, 3, 3)
    table = last.to_pandas()
    assert list(table[["x1", "x2", "x3"]].iloc[3]) == last.positions[3].tolist()
    assert table.attrs["time"] == 1.2 and {"fibre_direction_1", "deformation_gradient_33"} <= set(table)
    mesh = last.to_pyvista()
    assert mesh.n_points == 144 and mesh.field_data["TimeValue"][0] == 1.2
    assert np.array_equal(mesh.point_data["velocity"], last.velocity)
    every = flow.to_pandas()
    assert np.allclose(every["A12"], flow.A[:, 0, 1]) and np.array_equal(every["time"], flow.times)
    assert [frame.time for frame in flow[1:]] == flow.times[1:].tolist()
    with pytest.raises(IndexError, match="has 4 frames, frame 4"):
        flow[4]
    with pytest.raises(AttributeError, match=r"no field 'temperature'; fields: .*velocity"):
        _ = last.temperature


def test_what_is_done_to_a_frame_stays_with_it(flow: ppmc.Flow) -> None:
    before = flow[-1].velocity
    flow[-1].velocity[:] = 0.0
    assert np.array_equal(flow[-1].velocity, before) and before.any()


def test_what_the_command_tells_is_a_warning(charge: ppmc.Charge, solved: Solve, capfd) -> None:
    far = {
        "lower": ppmc.tools.plane((0, 0, 0), (0, 0, 1)),
        "ram": ppmc.tools.plane((0, 0, 4), (0, 0, -1), motion=ppmc.tools.velocity((0, 0, -1), travel=0.1)),
        "far": ppmc.tools.box((40, 0, 2), (4, 4, 4), motion=ppmc.tools.velocity((0, 1, 0))),
    }
    material = ppmc.materials.Newtonian(shear_viscosity="1 Pa*s")
    with pytest.warns(ppmc.PpmcWarning, match="tool 'far' never reaches the charge") as told:
        ppmc.solve(charge, far, material, end_time=0.1)
    assert {Path(w.filename).name for w in told} == {"test_solve.py"}
    assert capfd.readouterr() == ("", "")


def test_a_verdict_that_is_not_passed_warns_or_raises(charge: ppmc.Charge, solved: Solve) -> None:
    loose = {"bulk_modulus": "100 Pa", "end_time": 0.4, "output_interval": 0.4}
    with pytest.warns(ppmc.PpmcWarning, match="NOT PASSED(.|\n)*mean"):
        flow = solved(charge, **loose)
    assert flow.verdict is not None and not flow.verdict.passed
    with warnings.catch_warnings(), pytest.raises(VerdictError, match=r"mean \|J - 1\|") as refused:
        warnings.simplefilter("ignore")
        solved(charge, strict=True, **loose)
    assert refused.value.flow is not None and refused.value.flow.verdict == flow.verdict


def test_a_run_that_fails_keeps_its_frames(charge: ppmc.Charge) -> None:
    # Without a bulk modulus to speak of nothing resists shrinking alike in all directions.
    ram = ppmc.tools.plane((0, 0, 4), (0, 0, -1), motion=ppmc.tools.velocity((0, 0, -1)))
    with pytest.raises(NumericalError, match="mean volume ratio is off") as failed:
        ppmc.solve(charge, [*PLANES, ram], WATER, end_time=2, bulk_modulus="1 mPa", volume_correction=0)
    assert failed.value.flow is not None and len(failed.value.flow) >= 1
    assert "the state is in" not in str(failed.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"end_time": "1 mm"}, r"^ppmc\.solve: solver\.end_time: '1 mm' .*"),
        ({}, r"^ppmc\.solve: solver\.end_time: this key is required$"),
        ({"end_time": 1, "smoothing_ration": 1.3}, "unknown key; did you mean 'smoothing_ratio'"),
        ({"end_time": 1, "tools": [*PLANES, "ram"]}, "'ram' is no tool"),
        ({"end_time": 1, "tools": []}, "needs at least two planes|no tool"),
        ({"end_time": 1, "charge": "no.vtkhdf"}, "no.vtkhdf"),
        ({"end_time": 1, "charge": 3}, "3 is no charge"),
        ({"end_time": 1, "material": {"model": "treacle"}}, r"ppmc\.solve: material.*treacle"),
        ({"end_time": 1, "settings": ppmc.SolverSettings(end_time=1)}, "not both"),
        ({"end_time": 1, "tools": [ppmc.tools.plane((0, 0, 2), (0, 0, 1), name="lower")]}, "start inside this tool"),
    ],
)
def test_wrong_input_gives_one_clear_error(charge: ppmc.Charge, options: dict, message: str) -> None:
    given = {"charge": charge, "tools": PLANES, "material": WATER} | options
    with pytest.raises((SceneError, InputFileError), match=message) as told:
        ppmc.solve(**given)
    assert str(told.value).count("\n") == 0


def test_two_tools_of_one_name() -> None:
    twice = [ppmc.tools.plane((0, 0, 0), (0, 0, 1), name="a"), ppmc.tools.plane((0, 0, 1), (0, 0, -1), name="a")]
    with pytest.raises(SceneError, match="two are named 'a'"):
        ppmc.tools.named(twice)
