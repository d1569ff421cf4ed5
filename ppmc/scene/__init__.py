"""One validated description of a whole chain, a section for each stage.

Imports of `Scene` and `load_scene` go through here; the sections themselves stand one a file. They are loaded when
they are asked for: materials and wall laws are sections too, stand in rooms of their own, and need units from here.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ppmc.scene.loader import load_scene, parse_scene, scene_json_schema
    from ppmc.scene.paths import RunPaths, run_paths
    from ppmc.scene.scene import Scene

__all__ = ["RunPaths", "Scene", "load_scene", "parse_scene", "run_paths", "scene_json_schema"]

_HOMES = {
    "RunPaths": "paths", "run_paths": "paths", "Scene": "scene",
    "load_scene": "loader", "parse_scene": "loader", "scene_json_schema": "loader",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
