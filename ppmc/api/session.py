"""What the API does around a stage: warnings in place of lines on the terminal, progress only where it is asked for."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from ppmc.errors import PpmcWarning
from ppmc.notices import listening
from ppmc.progress import progress_shown

ROOT = str(Path(__file__).parents[1])


def warn(text: str) -> None:
    """Give a warning that points to the line outside of ppmc from which the API was called."""
    frame: FrameType | None = sys._getframe(0)
    level = 1
    while frame is not None and frame.f_code.co_filename.startswith(ROOT):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, PpmcWarning, stacklevel=level)


@contextmanager
def session(progress: bool = False) -> Iterator[None]:
    """Let a stage work within the block: what it tells becomes warnings, its progress is shown if asked for."""
    with listening(warn), progress_shown(progress):
        yield
