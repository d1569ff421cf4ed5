"""Requests from outside: Ctrl-C, SIGTERM, SIGHUP and a time limit stop with a checkpoint, SIGUSR1 asks for one."""

import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Any

from ppmc.interrupts import end_at_once


class StopRequests:
    """Context that turns signals into flags, read between steps.

    A second Ctrl-C stops at once, as if nobody had caught the first.

    Parameters
    ----------
    max_walltime : float or None
        Wall-clock limit, s.
    signals : bool
        Whether to catch signals; a run that keeps no checkpoint leaves them to its caller.

    Attributes
    ----------
    stop : str
        Why to stop, empty if nobody asked.
    interrupted : bool
        Whether it was Ctrl-C.
    checkpoint : bool
        Whether a checkpoint is asked for.
    """

    def __init__(self, max_walltime: float | None, signals: bool = True) -> None:
        self.signals = signals
        self.deadline = None if max_walltime is None else time.monotonic() + max_walltime
        self.stop = ""
        self.interrupted = False
        self.checkpoint = False
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> "StopRequests":
        if self.signals and threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1):
                if signal.getsignal(number) is signal.SIG_IGN:
                    continue  # nohup, or a shell that keeps Ctrl-C from its background jobs
                self._previous[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def expired(self, next_step: float) -> bool:
        """Tell whether a step of `next_step` seconds of wall clock would end past the limit."""
        return self.deadline is not None and time.monotonic() + next_step > self.deadline

    def _note(self, number: int, frame: FrameType | None) -> None:
        if number == signal.SIGUSR1:
            self.checkpoint = True
            return
        self.stop = signal.Signals(number).name
        self.interrupted = number == signal.SIGINT
        if self.interrupted:
            # A command leaves; whoever called from Python gets the exception, and stays.
            own = self._previous[number]
            signal.signal(signal.SIGINT, own if own is signal.default_int_handler else end_at_once)
