"""A part as the text of a whole scene, ready to be edited and run."""

from __future__ import annotations

import io
from typing import Any

from pydantic import ValidationError

from ppmc.errors import SceneError
from ppmc.geometry.parts import PARTS
from ppmc.geometry.parts.part import Part


def make_part(name: str, settings: list[str]) -> Part:
    """Return a part with some of its dimensions changed.

    Parameters
    ----------
    name : str
        Name of the part.
    settings : list of str
        ``key=value`` each, such as ``"hole_diameter=9.525 mm"``.

    Raises
    ------
    SceneError
        If the part or a key is unknown, or the dimensions are impossible.
    """
    if name not in PARTS:
        raise SceneError(f"no part '{name}'; there are {', '.join(PARTS)}")
    values: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise SceneError(f"--set {setting}: write key=value, for example --set closing_speed='3 mm/s'")
        values[key.strip()] = _number_or_text(value.strip())
    try:
        return PARTS[name].model_validate(values)
    except ValidationError as error:
        known = ", ".join(k for k in PARTS[name].model_fields if k != "part")
        first = error.errors(include_url=False)[0]
        key = ".".join(str(k) for k in first["loc"])
        if first["type"] == "extra_forbidden":
            raise SceneError(f"{name} has no dimension '{key}'; it has {known}") from None
        raise SceneError(f"{name}{'.' if key else ''}{key}: {first['msg'].removeprefix('Value error, ')}") from None


def scene_text(part: Part, name: str, spacing: float) -> str:
    """Return YAML of a scene that moulds a part: geometry from the part, the rest for the user to change.

    Parameters
    ----------
    part : Part
        The part.
    name : str
        Name of the scene.
    spacing : float
        Distance between particles, mm.
    """
    sections = part.scene_sections()
    dimensions = ", ".join(f"{k}={v}" for k, v in part.model_dump(exclude_none=True).items() if k != "part")
    domain, orientation = sections["charge"]["domain"], sections["charge"]["orientation"]
    scene = {
        "name": name,
        "seed": 1,
        "description": f"{type(part).__name__}: {dimensions}",
        "charge": {"domain": domain, "spacing": spacing, "orientation": orientation},
        "tooling": sections["tooling"],
        "material": sections["material"],
        "solver": sections["solver"] | {"output_interval": part.closing_time / 20.0},
        "analysis": sections["analysis"],
    }
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 110
    text = io.StringIO()
    yaml.dump(scene, text)
    return f"# Geometry by volume balance; lengths in mm, times in s. Made by `ppmc part`.\n{text.getvalue()}"


def _number_or_text(value: str) -> float | str:
    """Return a number where the text is one: quantities with units and choices stay text."""
    try:
        return float(value)
    except ValueError:
        return value
