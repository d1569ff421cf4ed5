"""From a function with a NumPy-style docstring to a command whose help has everything the docstring says."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from cyclopts import App


def command(function: Callable[..., Any]) -> App:
    """Return the command of a function: text and parameters from its docstring, its Examples at the end of the help.

    Parameters
    ----------
    function : callable
        Named as the command; its docstring's Examples section holds one command line a paragraph.

    Returns
    -------
    App
        To be mounted in the ``ppmc`` command.
    """
    text = inspect.cleandoc(function.__doc__ or "")
    _, _, examples = text.partition("Examples\n--------\n")
    lines = [line for line in examples.splitlines() if line.strip()]
    epilogue = "\n\n".join(["Examples", *(f"  {line}" for line in lines)]) if lines else None
    app = App(name=function.__name__, help_format="rst", help_epilogue=epilogue)
    app.default(function)
    return app
