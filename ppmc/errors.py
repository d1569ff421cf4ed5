"""Errors that a user can mend: one clear message each, and the exit code of the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ppmc.api.flow import Flow


class PpmcError(Exception):
    """Base of every error that is shown as one message, without a traceback.

    Attributes
    ----------
    exit_code : int
        What the ``ppmc`` command returns when the error reaches it.
    """

    exit_code = 1


class SceneError(PpmcError):
    """The scene or the command line asks for something that cannot be (exit code 2)."""

    exit_code = 2


class InputFileError(PpmcError):
    """An input file is missing, damaged or not what the stage needs (exit code 3)."""

    exit_code = 3


class NumericalError(PpmcError):
    """The computation left the range in which its result means something (exit code 4).

    Attributes
    ----------
    flow : Flow or None
        The frames up to then, of a flow in memory.
    """

    exit_code = 4
    flow: Flow | None = None


class VerdictError(PpmcError):
    """The result is complete but broke a limit, and the user asked for none (exit code 4).

    Attributes
    ----------
    flow : Flow or None
        The result, where ppmc was called from Python.
    """

    exit_code = 4
    flow: Flow | None = None


class StorageError(PpmcError):
    """An output cannot be written where it was asked for (exit code 5)."""

    exit_code = 5


class StoppedWithCheckpoint(PpmcError):
    """The run stopped early on request; the same command resumes it (exit code 75)."""

    exit_code = 75


class PpmcWarning(UserWarning):
    """What may be wrong but need not be, where ppmc is called from Python; the commands tell it on the terminal."""
