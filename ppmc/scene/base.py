"""What every section of a scene shares: nothing unknown, nothing infinite, nothing changed after loading."""

from __future__ import annotations

import hashlib
import inspect
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

# Names become those of files, datasets and columns.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$", max_length=60)]


class Section(BaseModel):
    """A validated, frozen part of a scene; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)


def description_of(law: Any) -> dict[str, Any]:
    """Return what a file keeps of a law that is no section: its class, its constants and a digest of its source.

    Two runs with another formula under the same name must not be taken for one; where Python cannot tell the source of
    a class (typed at a prompt), its name has to do.
    """
    kind = type(law)
    constants = {k: v for k, v in sorted(vars(law).items()) if isinstance(v, int | float | str | bool)}
    try:
        source = hashlib.sha256(inspect.getsource(kind).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        source = "unknown"
    return {"class": f"{kind.__module__}.{kind.__qualname__}", **constants, "source": source}
