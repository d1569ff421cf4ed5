"""Signals at any moment, and standard streams that go away."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ppmc.cli import run_command
from ppmc.command_end import exit_code_of
from ppmc.interrupts import install

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in SIGNALS}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("number", "code", "told"),
    [
        (signal.SIGTERM, 75, "stopped by SIGTERM"),
        (signal.SIGHUP, 75, "stopped by SIGHUP"),
        (signal.SIGINT, 130, "interrupted"),
        (signal.SIGUSR1, 0, ""),
    ],
)
def test_a_signal_before_the_first_step(
    number: int, code: int, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def struck(_: object) -> str:
        os.kill(os.getpid(), number)
        return "done"

    install()
    monkeypatch.setattr("ppmc.files.describe.describe_file", struck)
    assert exit_code_of(lambda: run_command(["info", "x"])) == code
    assert told in capsys.readouterr().err


def test_what_the_caller_ignores_stays_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nohup ignores SIGHUP for what it starts."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    install()
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_a_second_interrupt_ends_at_once() -> None:
    child = os.fork()
    if child == 0:
        install()
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            os.kill(os.getpid(), signal.SIGINT)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 130


@pytest.mark.parametrize(
    ("command", "code", "told"),
    [
        ("schema > /dev/full", 5, "standard output: No space left on device"),
        ("schema >&-", 0, ""),
        ("schema 2>&- | cat", 0, ""),
        ("info no_such_file 2> /dev/full", 3, ""),
    ],
)
def test_streams_that_are_closed_or_full(command: str, code: int, told: str, tmp_path: Path) -> None:
    line = f"set -o pipefail; {sys.executable} -m ppmc {command}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert told in done.stderr
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr
