"""The verdict as files keep it: read back as written, told in words, refused where it is not one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ppmc.errors import InputFileError
from ppmc.files.verdict import Finding, Verdict, read_verdict

DEEP = Finding(
    "penetration", 0.034, 0.02, "at most", "spacings", "why", 0.25, "ram", 17, (1.0, 2.0, 3.0)
)  # fmt: skip
COVERED = Finding("coverage", 0.5, 0.5, "at least", "1", "why")
UNKNOWN = Finding("packing", None, 0.9, "at least", "1", "why")
HERE = Path("flow.vtkhdf")


def test_a_verdict_comes_back_as_it_was_written() -> None:
    verdict = Verdict((DEEP, COVERED, UNKNOWN))
    facts = json.loads(json.dumps({"verdict": verdict.as_facts()}))
    assert read_verdict(facts, HERE) == verdict
    assert facts["verdict"]["passed"] is False


def test_what_is_broken_is_told_with_value_limit_time_and_place() -> None:
    verdict = Verdict((DEEP, COVERED, UNKNOWN))
    assert verdict.broken == (DEEP,)
    headline, line = verdict.lines()
    assert headline == "NOT PASSED: 1 of 3 limits not kept"
    assert line.strip() == (
        "penetration: 0.034 spacings, at most 0.02 spacings; tool 'ram', t = 0.25 s, particle 17, (1, 2, 3) mm"
    )


def test_a_value_at_its_limit_keeps_it_and_one_that_is_no_number_does_not() -> None:
    assert COVERED.kept and UNKNOWN.kept
    assert Verdict((COVERED, UNKNOWN)).lines() == ["passed: all 2 limits kept"]
    assert not Finding("J", float("nan"), 0.1, "at most", "1", "why").kept
    assert not Finding("J", float("nan"), 0.1, "at least", "1", "why").kept


def test_a_file_without_a_verdict_has_none() -> None:
    assert read_verdict({"steps": 3}, HERE) is None


@pytest.mark.parametrize(
    "damage",
    [{"bound": "about"}, {"limit": "x"}, {"position": [1.0]}, {"particle": "all"}, {"time": [1]}, {"value": {}}],
)
def test_a_damaged_verdict_is_refused(damage: dict[str, object]) -> None:
    facts = Verdict((DEEP,)).as_facts()
    facts["findings"][0] |= damage
    with pytest.raises(InputFileError, match=r"flow\.vtkhdf: .*verdict"):
        read_verdict({"verdict": facts}, HERE)


@pytest.mark.parametrize("facts", ["passed", [], {"passed": True}, {"findings": [3]}])
def test_what_is_no_verdict_at_all_is_refused(facts: object) -> None:
    with pytest.raises(InputFileError, match="verdict"):
        read_verdict({"verdict": facts}, HERE)
