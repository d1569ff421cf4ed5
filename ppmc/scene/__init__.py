"""One validated description of a whole chain, a section for each stage.

Imports of `Scene` and `load_scene` go through here; the sections themselves stand one a file.
"""

from ppmc.scene.loader import load_scene, parse_scene, scene_json_schema
from ppmc.scene.paths import RunPaths, run_paths
from ppmc.scene.scene import Scene

__all__ = ["RunPaths", "Scene", "load_scene", "parse_scene", "run_paths", "scene_json_schema"]
