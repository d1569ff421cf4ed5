"""The command line: exit codes, one message, nothing left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ppmc import __version__
from ppmc.cli import _run

CONFIGS = Path(__file__).parents[2] / "configs"


def ppmc(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ppmc.cli", *arguments], capture_output=True, text=True, cwd=cwd, check=False
    )


def test_version() -> None:
    done = ppmc("--version")
    assert done.returncode == 0 and done.stdout.strip() == f"ppmc {__version__}"


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["crage"], 2, "charge"),
        (["run", "--workdri", "x", "scene.yaml"], 2, "--workdri"),
        (["run"], 2, "SCENE requires an argument"),
        (["run", "no-such.yaml"], 2, "no-such.yaml: no such scene file"),
        (["info", "no-such.vtkhdf"], 3, "no-such.vtkhdf: no such file"),
        (["check", "no-such.vtkhdf"], 3, "no-such.vtkhdf: no such file"),
        (["schema", "--output", "/proc/self/x.json"], 5, "cannot write here"),
        (
            ["run", str(CONFIGS / "squeeze.yaml"), "--until", "ct"],
            2,
            "has no stage 'ct'; it has charge, solve, analyze",
        ),
    ],
)
def test_exit_codes(arguments: list[str], code: int, message: str, tmp_path: Path) -> None:
    done = ppmc(*arguments, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert message in done.stderr + done.stdout
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_interrupt_is_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ppmc.files.describe.describe_file", interrupted)
    assert _run(["info", "x"]) == 130
    assert "interrupted" in capsys.readouterr().err


def test_closed_pipe_is_quiet() -> None:
    done = subprocess.run(
        f"{sys.executable} -m ppmc.cli schema | head -c 10", shell=True, capture_output=True, text=True, check=False
    )
    assert done.stderr == "" and len(done.stdout) == 10


def test_check_walks_the_scene() -> None:
    done = ppmc("check", str(CONFIGS / "demo.yaml"))
    assert done.returncode == 0, done.stderr
    for word in ("scene 'demo': valid", "phantom:", "ct:", "charge:", "solve:", "analyze:"):
        assert word in done.stdout
