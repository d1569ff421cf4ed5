"""The campaign of faults runs as a command, and its table counts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CAMPAIGN = Path(__file__).parents[2] / "pipelines" / "faults"


@pytest.mark.slow
def test_a_row_of_the_campaign_is_right() -> None:
    command = [sys.executable, str(CAMPAIGN), "--tries", "2", "--only", "writes of a part"]
    done = subprocess.run(command, capture_output=True, text=True, env=dict(os.environ), check=False)
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("writes of a part")]
    assert done.returncode == 0, done.stdout + done.stderr
    assert [row[4] for row in rows] == ["phantom", "ct", "charge", "solve", "analyze", "run"]
    assert all(row[5] == row[6] == "1" for row in rows)
