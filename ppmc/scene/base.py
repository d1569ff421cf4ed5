"""What every section of a scene shares: nothing unknown, nothing infinite, nothing changed after loading."""

from __future__ import annotations

import ast
import hashlib
import inspect
import pkgutil
import textwrap
from importlib import import_module
from types import ModuleType
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema

# Names become those of files, datasets and columns.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$", max_length=60)]


class Section(BaseModel):
    """A validated, frozen part of a scene; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON schema, each key described by the text that follows it in the class.

        Pydantic can do this too, but for every class as it is made: half of the time that any command takes to start.
        """
        schema = handler.resolve_ref_schema(handler(core_schema))
        for base in reversed(cls.__mro__):
            if issubclass(base, Section) and base is not Section:
                for name, text in _described(base):
                    if name in schema.get("properties", ()):
                        schema["properties"][name]["description"] = text
        return schema


def _described(section: type[Section]) -> list[tuple[str, str]]:
    """Return the keys that a class defines, each with the text that follows it in the source."""
    (found,) = ast.parse(textwrap.dedent(inspect.getsource(section))).body
    assert isinstance(found, ast.ClassDef)
    return [
        (key.target.id, inspect.cleandoc(text.value.value))
        for key, text in zip(found.body, found.body[1:], strict=False)
        if isinstance(key, ast.AnnAssign)
        and isinstance(key.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    ]


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


def kinds_in(package: ModuleType, base: type, key: str) -> dict[str, type[Any]]:
    """Return the sections of a package's files by the name that scenes give them; only the folder has to know of them.

    Parameters
    ----------
    package : module
        The package; each of its modules is imported.
    base : type
        Subclasses of this that a module itself defines are looked at.
    key : str
        The field whose default is a kind's name, such as ``"model"``; classes without it are no kinds.
    """
    found: dict[str, type[Any]] = {}
    for name in sorted(info.name for info in pkgutil.iter_modules(package.__path__)):
        module = import_module(f"{package.__name__}.{name}")
        for kind in vars(module).values():
            own = isinstance(kind, type) and issubclass(kind, base) and kind.__module__ == module.__name__
            if own and key in kind.model_fields:
                found[kind.model_fields[key].default] = kind
    return found
