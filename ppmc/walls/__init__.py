"""Wall laws, one a file: what a tool of a scene may call by ``law``, and what is passed from Python.

A file in this folder that holds a subclass of :class:`ppmc.walls.law.WallSection` with a literal ``law`` is a wall law
of scenes; nothing else has to know of it. A law of one's own need not be in here: any :class:`ppmc.walls.law.WallLaw`
can be passed where a scene's section could.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Field, PlainSerializer, WrapValidator

from ppmc.scene.base import kinds_in
from ppmc.walls.law import WallLaw, WallSection


def _in_full(value: Any, validate: Callable[[Any], Any]) -> Any:
    """Let a ready law pass; write the short forms of scenes out: a name alone, and ``{friction: ...}`` (Navier)."""
    if isinstance(value, WallLaw):
        return value
    if isinstance(value, str):
        value = {"law": value}
    elif isinstance(value, dict) and "law" not in value and get_close_matches("friction", map(str, value), n=1):
        value = {"law": "navier", **value}
    return validate(value)


LAWS: dict[str, type[WallSection]] = kinds_in(sys.modules[__name__], WallSection, "law")
"""The wall laws that scenes know, by ``law``."""
globals().update({kind.__name__: kind for kind in LAWS.values()})

if TYPE_CHECKING:
    Wall = WallLaw
else:
    Wall = Annotated[
        Union[tuple(LAWS.values())],  # noqa: UP007
        Field(discriminator="law"),
        WrapValidator(_in_full),
        PlainSerializer(lambda wall: wall.described()),
    ]

__all__ = ["LAWS", "Wall", "WallLaw", "WallSection"]
