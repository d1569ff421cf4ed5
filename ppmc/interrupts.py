"""Signals and standard streams of the command line, from its first moment to its last.

Until a stage knows better, Ctrl-C, SIGTERM and SIGHUP end a command in order, and SIGUSR1 waits for somebody who can
write a checkpoint. A terminal that is gone, a pipe without reader or a full disk under standard output or error never
end a computation: its result is its file.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from types import FrameType
from typing import Any, TextIO

INTERRUPTED = 130
STOPPING = (signal.SIGTERM, signal.SIGHUP)


class StopSignal(BaseException):
    """A signal asked for the end; no fault, so that nothing that mends faults catches it.

    Attributes
    ----------
    name : str
        Its name, such as ``"SIGTERM"``.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name


def install() -> None:
    """Take over the signals that end a command; those that the caller wants ignored (nohup) stay ignored."""
    for number in (*STOPPING, signal.SIGINT, signal.SIGUSR1):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)


def ignore() -> None:
    """Let nothing end a command any more that has only its exit code left to give."""
    for number in (*STOPPING, signal.SIGINT, signal.SIGUSR1):
        signal.signal(number, signal.SIG_IGN)


def end_at_once(number: int, frame: FrameType | None) -> None:
    """Leave at once, on a second Ctrl-C: files appear whole or not at all, and locks end with the process."""
    os._exit(INTERRUPTED)


def _end(number: int, frame: FrameType | None) -> None:
    if number == signal.SIGUSR1:
        return
    if number == signal.SIGINT:
        signal.signal(signal.SIGINT, end_at_once)
        raise KeyboardInterrupt
    raise StopSignal(signal.Signals(number).name)


class LastingStream:
    """A text stream that outlives what it writes to.

    Attributes
    ----------
    error : OSError or None
        What ended it; everything after that goes nowhere.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Write text, or nothing if the stream has ended."""
        try:
            self._stream.write(text)
        except OSError as error:
            self._close(error)
        return len(text)

    def flush(self) -> None:
        """Flush, unless the stream has ended."""
        try:
            self._stream.flush()
        except OSError as error:
            self._close(error)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _close(self, error: OSError) -> None:
        """Lead what is still in the buffer, and all that follows, to nowhere."""
        self.error = self.error or error
        with contextlib.suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)
            self._stream.flush()


def hold_streams() -> None:
    """Give standard streams that are closed a place to go, and let open ones outlive their ends.

    A closed descriptor would be given to the next file that is opened, and messages written into that.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is None:
            stream = open(number, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        if not isinstance(stream, LastingStream):
            setattr(sys, name, LastingStream(stream))
