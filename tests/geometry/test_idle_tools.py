"""Tools that never touch the charge, or only leave it, are told; tools that do their work are not."""

from __future__ import annotations

import numpy as np
import pytest

from ppmc.geometry.tools.checks import idle_tools
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene import parse_scene

BOX = np.array(np.meshgrid(*[np.linspace(0.0, s, 5) for s in (4.0, 4.0, 2.0)], indexing="ij")).reshape(3, -1).T
PLANE = "{shape: plane, point: [0, 0, HEIGHT], normal: [0, 0, -1], motion: MOTION}"


@pytest.mark.parametrize(
    ("height", "motion", "told"),
    [
        ("2", "{velocity: [0, 0, -1]}", ""),
        ("3", "{velocity: [0, 0, -1]}", ""),
        ("20", "{velocity: [0, 0, -1]}", "'ram' never reaches the charge: it comes no nearer than 17 mm up to 1 s"),
        ("3", "{velocity: [0, 0, -1], travel: 0.2}", "never reaches the charge"),
        ("2", "{velocity: [0, 0, 1]}", "'ram' only leaves the charge"),
        ("2", "{times: [0, 0.5, 1], displacements: [[0, 0, 0], [0, 0, -0.5], [0, 0, 3]]}", ""),
        ("4", "{force: 1 N, direction: [0, 0, -1], max_speed: 1}", "never reaches the charge"),
        ("4", "{force: 1 N, direction: [0, 0, -1], max_speed: 5}", ""),
        ("9", "{fixed: true}", ""),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_idle_tools_are_told(height: str, motion: str, told: str, turned: bool) -> None:
    text = PLANE.replace("HEIGHT", height).replace("MOTION", motion)
    scene = parse_scene(
        f"name: x\ntooling:\n  lower: {{shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}}\n  ram: {text}\n"
    )
    points = BOX
    if turned:  # along x1
        text = text.replace(f"[0, 0, {height}]", f"[{height}, 0, 0]").replace("[0, 0, -1]", "[-1, 0, 0]")
        text = text.replace("[0, 0, 1]", "[1, 0, 0]").replace("[0, 0, -0.5]", "[-0.5, 0, 0]")
        text = text.replace("[0, 0, 3]", "[3, 0, 0]")
        scene = parse_scene(f"name: x\ntooling: {{ram: {text}}}\n")
        points = BOX[:, ::-1]
    assert scene.tooling is not None
    lines = idle_tools(compile_tools(scene.tooling), points, 0.5, 1.0)
    assert (told in lines[0] and len(lines) == 1) if told else lines == []
