"""Progress: plain, sparse lines in a log, with share and ETA."""

from __future__ import annotations

import pytest

from ppmc.progress import Progress


def test_log_gets_a_line_per_five_percent(capsys: pytest.CaptureFixture[str]) -> None:
    with Progress("work", total=1000, unit="rows") as bar:
        for _ in range(1000):
            bar.advance(1, note="fine")
    captured = capsys.readouterr()
    lines = captured.err.splitlines()
    assert captured.out == ""
    assert 19 <= len(lines) <= 21
    assert lines[9].startswith("work: 500/1000 rows (50%) elapsed 0:00:00 ETA 0:00:0") and lines[9].endswith("fine")
    assert "\r" not in captured.err


def test_nothing_to_do_is_no_error() -> None:
    with Progress("none", total=0) as bar:
        bar.update(0)
