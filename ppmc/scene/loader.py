"""Read a scene: YAML 1.2 in, a validated `Scene` or one message with file and line out."""

from __future__ import annotations

import difflib
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from ppmc.errors import SceneError
from ppmc.scene.scene import Scene

MOST_BYTES = 1_000_000
MOST_VALUES = 20_000  # a second of reading
DEEPEST = 40
MOST_ERRORS_SHOWN = 8

TAGS = ("shape", "source", "model", "kind", "law")
"""Keys that say which of several sections is meant."""

Location = tuple[int | str, ...]
S = TypeVar("S", bound=BaseModel)


def load_scene(path: str | Path) -> Scene:
    """Read and validate a scene file.

    Parameters
    ----------
    path : str or Path
        A YAML 1.2 file.

    Returns
    -------
    Scene
        The scene, in mm, s, g, Pa, with every default filled in.

    Raises
    ------
    SceneError
        If the file cannot be read, is not YAML, or is not a valid scene; every problem with ``file:line``, the key,
        the value and, for an unknown key, the nearest known one.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise SceneError(f"{path}: a scene is text of at most {MOST_BYTES:,} bytes; this file is larger")
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SceneError(f"{path}: no such scene file{_near_files(path)}") from None
    except IsADirectoryError:
        raise SceneError(f"{path}: is a folder, not a scene file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: cannot be read as text: {error}") from None
    scene = parse_scene(text, path)
    scene._file = path
    return scene


def parse_scene(text: str, path: Path = Path("scene.yaml")) -> Scene:
    """Validate the text of a scene; `path` names it in messages and anchors its relative paths.

    Raises
    ------
    SceneError
        As `load_scene`.
    """
    lines, data = _read_yaml(text, path)
    if not isinstance(data, dict):
        raise SceneError(f"{path}:1: a scene is a mapping of sections such as 'name:' and 'charge:'")
    try:
        scene = Scene.model_validate(data)
    except ValidationError as error:
        raise _refusal(error, _Text(Scene, data, lines, str(path))) from None
    scene._directory = path.parent
    return scene


def make_section(model: type[S], name: str, values: Mapping[str, Any]) -> S:
    """Validate a section that comes from Python, with the messages of a scene file.

    Parameters
    ----------
    model : type
        Class of the section.
    name : str
        Stands in messages where a file would.
    values : mapping of str to object
        Its keys; quantities as numbers in mm, s, g, Pa, as text, or of pint; arrays of NumPy; sections.

    Raises
    ------
    SceneError
        Every problem with `name`, the key and the value.
    """
    data = {key: _plain(value) for key, value in values.items()}
    lines = dict.fromkeys(_keys_in(data, ()), 0)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise _refusal(error, _Text(model, data, lines, name)) from None


def _plain(value: Any) -> Any:
    """Return a value as YAML would give it: no arrays, no quantities that hold several numbers."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    shape = getattr(value, "shape", None)
    if isinstance(value, list | tuple) or (isinstance(shape, tuple) and shape):
        return [_plain(inner) for inner in value]
    # Numbers of NumPy; a quantity of pint has a magnitude.
    return value.item() if hasattr(value, "item") and not hasattr(value, "magnitude") else value


def _keys_in(value: Any, here: Location) -> Iterator[Location]:
    """Yield the place of every key and list item."""
    yield here
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, below in inner:
        yield from _keys_in(below, (*here, key))


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of scenes, for editors that complete and check YAML."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Scene.model_json_schema()}


def _near_files(path: Path) -> str:
    """Return a hint that names a scene file of similar name, if there is one."""
    folder = path.parent
    names = [p.name for p in folder.glob("*.y*ml")] if folder.is_dir() else []
    near = difflib.get_close_matches(path.name, names, n=1)
    return f"; did you mean {folder / near[0]}?" if near else ""


def _read_yaml(text: str, path: Path) -> tuple[dict[Location, int], Any]:
    """Return the line of every key, and the data."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError
    from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent, ScalarEvent

    yaml = YAML(typ="safe", pure=True)
    lines: dict[Location, int] = {}
    try:
        depth = values = 0
        for event in yaml.parse(text):
            line = event.start_mark.line + 1
            if isinstance(event, AliasEvent):
                raise SceneError(f"{path}:{line}: aliases (*name) are not used in scenes; write the value out")
            depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
            values += isinstance(event, ScalarEvent)
            if depth > DEEPEST:
                raise SceneError(f"{path}:{line}: nested more than {DEEPEST} deep; no section of a scene is")
            if values > MOST_VALUES:
                raise SceneError(f"{path}:{line}: holds more than {MOST_VALUES:,} values; put long lists into files")
        node = yaml.compose(text)
        if node is not None:
            _note_lines(node, (), lines, path)
        data = YAML(typ="safe", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise SceneError(f"{path}:{line}: not readable as YAML: {error.problem or error.context}") from None
    except (YAMLError, RecursionError, ValueError) as error:
        raise SceneError(f"{path}:1: not readable as YAML: {str(error).splitlines()[0]}") from None
    return lines, data


def _note_lines(node: Any, here: Location, lines: dict[Location, int], path: Path) -> None:
    """Collect the line (from 1) of every key and list item below a YAML node.

    Raises
    ------
    SceneError
        If a key is a list or a mapping.
    """
    lines.setdefault(here, node.start_mark.line + 1)
    if node.id == "mapping":
        for key, value in node.value:
            if key.id != "scalar":
                raise SceneError(f"{path}:{key.start_mark.line + 1}: a key must be a word, not a list or a mapping")
            lines[(*here, key.value)] = key.start_mark.line + 1
            _note_lines(value, (*here, key.value), lines, path)
    elif node.id == "sequence":
        for i, value in enumerate(node.value):
            _note_lines(value, (*here, i), lines, path)


@dataclass(frozen=True)
class _Text:
    """What a validation error is about.

    Attributes
    ----------
    model : type
        Class that the whole is.
    data : object
        The values.
    lines : dict
        Line of every key and list item, 0 where there are no lines.
    name : str
        File, or what stands for one.
    """

    model: type[BaseModel]
    data: Any
    lines: dict[Location, int]
    name: str

    def at(self, key: Location) -> str:
        """Return where a key stands, as messages begin."""
        line = self.lines.get(key, self.lines.get((), 1))
        return f"{self.name}:{line}:" if line else f"{self.name}:"


def _refusal(error: ValidationError, text: _Text) -> SceneError:
    """Return the error of values that are no section."""
    # A value that stands for three axes is refused three times in the same words.
    shown = _explain_all(error, text)
    if len(shown) > MOST_ERRORS_SHOWN:
        shown[MOST_ERRORS_SHOWN:] = [f"... and {len(shown) - MOST_ERRORS_SHOWN} more problems"]
    return SceneError("\n".join(shown))


def _explain_all(error: ValidationError, text: _Text) -> list[str]:
    """Return a line for each problem; a key that is missing because it is misspelt is one problem, not two."""
    found = error.errors(include_url=False)
    misspelt = {
        (*e["loc"][:-1], near)
        for e in found
        if e["type"] == "extra_forbidden" and (near := _near_key(e["loc"], text.model)[0])
    }
    kept = [e for e in found if not (e["type"] == "missing" and e["loc"] in misspelt)]
    return list(dict.fromkeys(_explain(e, text) for e in kept))


def _near_key(loc: Location, root: type[BaseModel]) -> tuple[str | None, list[str]]:
    """Return the known key that an unknown one is nearest to, if any, and all that are known there."""
    known = sorted({f for m in _models_at(loc[:-1], root) for f in m.model_fields})
    near = difflib.get_close_matches(str(loc[-1]), known, n=1)
    return (near[0] if near else None), known


def _place(loc: Location, value: Any, data: Any, lines: dict[Location, int]) -> Location:
    """Return where in the file a validation error stands.

    pydantic puts the tag of a tagged union into the location, and a tag may be spelt like a key beside the one that
    is meant (``motion`` of the kind ``velocity`` has a key ``velocity``). Of all ways to leave parts out, that one is
    right which ends at the value complained about; then the one that uses most parts.
    """
    best: tuple[bool, int, Location] = (False, 0, ())

    def walk(here: Location, at: Any, rest: Location) -> None:
        nonlocal best
        score = (at is value, len(here), here)
        if score[:2] > best[:2]:
            best = score
        for k, part in enumerate(rest):
            if (*here, part) in lines and isinstance(at, dict | list):
                try:
                    below = at[part]  # type: ignore[index]
                except (KeyError, IndexError, TypeError):
                    continue
                walk((*here, part), below, rest[k + 1 :])

    walk((), data, loc)
    return best[2]


def _explain(error: Any, text: _Text) -> str:
    """Return one line for one validation error."""
    loc, kind, value = error["loc"], error["type"], error.get("input")
    key = _place(loc, value, text.data, text.lines)
    at, name = text.at(key), ".".join(str(k) for k in key)
    if kind == "extra_forbidden":
        near, known = _near_key(loc, text.model)
        hint = f"; did you mean '{near}'?" if near else f"; known here: {', '.join(known)}" if known else ""
        return f"{at} {name}: unknown key{hint}"
    if kind == "missing":
        where = f"{name}." if name else ""
        return f"{at} {where}{loc[-1]}: this key is required"
    message = error["msg"].removeprefix("Value error, ")
    if (kind.startswith("union_tag") or kind == "tool_shape") and isinstance(value, dict):
        tag = next((t for t in TAGS if difflib.get_close_matches(t, map(str, set(value) - set(TAGS)), n=1)), None)
        slips = difflib.get_close_matches(tag, map(str, value), n=1) if tag else []
        if slips and tag not in value:
            return f"{text.at((*key, slips[0]))} {name}.{slips[0]}: unknown key; did you mean '{tag}'?"
    told = not isinstance(value, str | int | float) or str(value).lower() in message.lower()
    got = "" if told else f" (got {value!r})"
    named = name or ("scene" if text.model is Scene else "")
    return f"{at} {named}: {message}{got}" if named else f"{at} {message}{got}"


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the section classes that an annotation can hold."""
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        if issubclass(annotation, BaseModel):
            yield annotation
    else:
        for part in typing.get_args(annotation):
            yield from _models_in(part)


def _models_at(loc: Location, root: type[BaseModel]) -> list[type[BaseModel]]:
    """Return the section classes whose keys stand at a location of a validation error."""
    models: list[type[BaseModel]] = [root]
    for part in loc:
        inside = [c for m in models if part in m.model_fields for c in _models_in(m.model_fields[part].annotation)]
        tagged = [m for m in models if any(part in typing.get_args(f.annotation) for f in m.model_fields.values())]
        models = inside or tagged or models
    return models
