"""The verdict as a function of the table of steps: every limit at its bound and beyond, with time and place."""

import dataclasses

import numpy as np
import pytest

from ppmc.solver.run.history import History
from ppmc.solver.run.verdict import LIMITS, REASONS, Limits, coverage, judge

TOOLS = ("lower", "ram")
STEPS = 4
BULK = 1e3
# Column, what it must hold to be exactly at the limit (spacing .5 mm), and towards which side it breaks it.
COLUMNS = {
    "mean_volume_error": ("mean_volume_ratio_error", LIMITS.mean_volume_error, 1.0),
    "largest_volume_error": ("max_volume_ratio_error", LIMITS.largest_volume_error, 1.0),
    "packing_low": ("packing_low", LIMITS.packing_low, -1.0),
    "packing_high": ("packing_high", LIMITS.packing_high, 1.0),
    "packing_worst": ("packing_worst", 1.0 + LIMITS.packing_worst, 1.0),
    "unconverged": ("unconverged", LIMITS.unconverged, 1.0),
    "penetration": ("penetration", 0.5 * LIMITS.penetration, 1.0),
    "outside": ("outside", LIMITS.outside, 1.0),
}


def table(tmp_path):
    """Columns of a run without fault: four steps of a quarter of a second."""
    columns = {name: np.zeros(STEPS) for name in History(TOOLS, tmp_path / "steps.csv").columns}
    columns["time"] = np.linspace(0.25, 1.0, STEPS)
    columns |= {name: np.ones(STEPS) for name in ("packing_low", "packing_high", "packing_worst", "driven_share")}
    columns |= {name: np.full(STEPS, -1.0) for name in columns if name.endswith("_particle")}
    columns["dissipation"] = np.full(STEPS, 2.0)
    columns |= {"cover_lower": np.full(STEPS, 8.0), "cover_ram": np.full(STEPS, 8.0)}
    columns |= {"closing_lower": np.ones(STEPS), "closing_ram": np.ones(STEPS)}
    columns |= {"force_lower_z": np.full(STEPS, -5.0), "force_ram_z": np.full(STEPS, 5.0)}
    return columns


def found(columns, name):
    names = [field.name for field in dataclasses.fields(Limits)]
    return judge(columns, TOOLS, 0.5, BULK).findings[names.index(name)]


def test_a_run_without_fault_passes(tmp_path):
    verdict = judge(table(tmp_path), TOOLS, 0.5, BULK)
    assert verdict.passed
    assert len(verdict.findings) == len(dataclasses.fields(Limits)) == len(REASONS)


@pytest.mark.parametrize("name", COLUMNS)
def test_each_limit_is_kept_at_its_bound_and_broken_beyond(tmp_path, name):
    column, at_limit, side = COLUMNS[name]
    columns = table(tmp_path)
    columns[column][2] = at_limit - 1e-9 * side if name == "packing_worst" else at_limit
    assert judge(columns, TOOLS, 0.5, BULK).passed
    columns[column][2] = at_limit + 0.01 * side
    verdict = judge(columns, TOOLS, 0.5, BULK)
    assert [finding.name for finding in verdict.broken] == [found(columns, name).name]
    assert verdict.broken[0].time == 0.75


@pytest.mark.parametrize(
    ("column", "place", "name"),
    [
        ("max_volume_ratio_error", "volume_ratio", "largest_volume_error"),
        ("packing_worst", "packing", "packing_worst"), ("penetration", "penetration", "penetration"),
        ("outside", "outside", "outside"),
    ],
)  # fmt: skip
def test_a_place_is_that_of_the_worst_step(tmp_path, column, place, name):
    columns = table(tmp_path)
    columns[column][1:3] = [4.0, 5.0]
    for step, particle in ((1, 7), (2, 9)):
        columns[f"{place}_particle"][step] = particle
        for axis in (1, 2, 3):
            columns[f"{place}_x{axis}"][step] = 10.0 * particle + axis
    finding = found(columns, name)
    assert (finding.time, finding.particle, finding.position) == (0.75, 9, (91.0, 92.0, 93.0))


def test_zero_energy_control_counts_by_the_work_it_takes(tmp_path):
    columns = table(tmp_path)
    columns["dissipation"][3], columns["zero_energy_share"][3] = 1e-3, 1.0
    assert judge(columns, TOOLS, 0.5, BULK).passed
    columns["zero_energy_share"][:3] = [0.9, 0.7, 0.0]
    control = found(columns, "zero_energy_share")
    assert control.value == pytest.approx(1.6 / 3.0, rel=1e-3)
    assert (control.kept, control.time) == (False, 0.25)


def test_what_drives_the_flow_counts_by_strain(tmp_path):
    columns = table(tmp_path)
    columns["dissipation"][:], columns["driven_share"][:] = [4.0, 4.0, 1.0, 1e-12], [1.0, 0.5, 0.0, 0.0]
    driven = found(columns, "driven_share")
    assert driven.value == pytest.approx(3.0 / 5.0, rel=1e-5)
    assert (driven.kept, driven.time) == (True, 0.5)
    columns["driven_share"][:2] = [0.7, 0.5]
    assert found(columns, "driven_share").value == pytest.approx(2.4 / 5.0, rel=1e-5)
    assert not found(columns, "driven_share").kept


def test_a_run_that_dissipates_nothing_has_no_shares(tmp_path):
    columns = table(tmp_path)
    columns["dissipation"][:] = 0.0
    assert found(columns, "driven_share").value is None
    assert judge(columns, TOOLS, 0.5, BULK).passed


def test_steps_without_an_interior_are_passed_over(tmp_path):
    columns = table(tmp_path)
    columns["packing_low"][:] = [np.nan, 0.97, 0.98, np.nan]
    assert found(columns, "packing_low").value == 0.97
    columns["packing_low"][:] = np.nan
    assert found(columns, "packing_low").value is None


def test_a_closing_tool_must_stay_covered(tmp_path):
    columns = table(tmp_path)
    columns["cover_ram"][:] = [8.0, 4.0, 3.0, 8.0]
    columns["released_particle"][2] = 5
    for axis in (1, 2, 3):
        columns[f"released_x{axis}"][2] = axis
    finding = found(columns, "coverage")
    assert (finding.value, finding.tool, finding.time) == (3.0 / 8.0, "ram", 0.75)
    assert (finding.particle, finding.position) == (5, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(coverage(columns, TOOLS, 1e-3)[:, 1], [1.0, 0.5, 0.375, 1.0])
    columns["closing_ram"][2] = 0.0
    assert judge(columns, TOOLS, 0.5, BULK).passed


def test_a_run_without_tools_has_no_coverage(tmp_path):
    columns = {k: v for k, v in table(tmp_path).items() if "lower" not in k and "ram" not in k}
    verdict = judge(columns, (), 0.5, BULK)
    assert verdict.passed
    assert verdict.findings[7].value is None


def test_round_off_neither_presses_nor_works(tmp_path):
    """A charge that is pushed along without resistance: what its forces and its dissipation look like means nothing."""
    columns = table(tmp_path)
    columns["cover_ram"][2:] = 0.0
    columns["zero_energy_share"][:] = 1.0
    assert len(judge(columns, TOOLS, 0.5, BULK).broken) == 2
    columns["dissipation"][:] = [1e-22, -1e-22, 3e-22, 1e-22]
    columns |= {"force_lower_z": np.full(STEPS, -1e-11), "force_ram_z": np.full(STEPS, 1e-11)}
    verdict = judge(columns, TOOLS, 0.5, BULK)
    assert verdict.passed
    assert [finding.value for finding in verdict.findings[7:10]] == [None, None, None]


def test_forces_that_do_not_balance_mean_nothing(tmp_path):
    columns = table(tmp_path)
    assert found(columns, "force_balance").value == pytest.approx(0.0)
    columns["force_ram_z"][:] = 5.0 * 1.2
    assert found(columns, "force_balance").value == pytest.approx(1.0 / 5.5)
    assert judge(columns, TOOLS, 0.5, BULK).passed
    columns["force_ram_z"][:] = 5.0 * 1.3
    columns["force_ram_x"][1] = 9.0
    broken = judge(columns, TOOLS, 0.5, BULK).broken
    assert [finding.name for finding in broken] == ["tools' forces out of balance"]
    assert broken[0].time == 0.5
    for axis in "xyz":
        for tool in TOOLS:
            columns[f"force_{tool}_{axis}"][:] = 0.0
    assert found(columns, "force_balance").value is None
