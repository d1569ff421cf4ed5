"""What may be wrong but need not be is told while the work goes on: on the terminal, or to whoever listens."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from contextvars import ContextVar

_told: set[str] = set()
_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


def notice(text: str) -> None:
    """Tell the user something, once in a process; a standard error that is gone is no reason to stop.

    Parameters
    ----------
    text : str
        One sentence that names file, value and what to do.
    """
    listener = _listener.get()
    if listener is not None:
        listener(text)
        return
    if text in _told:
        return
    _told.add(text)
    with contextlib.suppress(OSError, ValueError):
        print(f"ppmc: note: {text}", file=sys.stderr, flush=True)


def tell(text: str) -> None:
    """Say on standard output what may be wrong with this very run, such as that its charge is a short shot."""
    listener = _listener.get()
    if listener is not None:
        listener(text)
        return
    print(text)


def inform(text: str) -> None:
    """Say on standard output how the work goes; nothing to those who listen for what may be wrong."""
    if _listener.get() is None:
        print(text)


@contextlib.contextmanager
def listening(listener: Callable[[str], None]) -> Iterator[None]:
    """Hand all that is told within the block to `listener`, and leave the terminal alone."""
    before = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(before)
