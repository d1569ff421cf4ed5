"""Pictures of charges: made for every kind of charge, showing what they should."""

import numpy as np
import pytest

from ppmc.charge import pictures
from ppmc.charge.pictures import View, colours_of_ids, draw_in_tool, uppermost
from ppmc.charge.stage import draw, run
from ppmc.files import ParticleFile, read_particles
from ppmc.scene.loader import parse_scene

SCENE = """
name: block
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 2], normal: [0, 0, -1]}
charge:
  domain: {shape: box, size: [8, 6, 2]}
  spacing: 0.5 mm
  orientation: {source: platelets, length: 4, width: 2}
"""


def test_top_and_cut_are_drawn_even_if_vtk_cannot(tmp_path, monkeypatch, capsys):
    scene = parse_scene(SCENE)
    path = run(scene, output=tmp_path / "charge.vtkhdf")
    monkeypatch.setattr(pictures, "draw_in_tool", None)
    monkeypatch.setattr("ppmc.charge.stage.draw_in_tool", lambda *_: "no OpenGL")
    made = draw(scene, path, tmp_path / "figures")
    assert [p.name for p in made] == ["charge_top.png", "charge_cut.png"]
    assert all(p.read_bytes()[:4] == b"\x89PNG" and p.stat().st_size > 5000 for p in made)
    assert "no OpenGL" in capsys.readouterr().err


def test_the_drawing_process_says_why_it_failed(tmp_path):
    charge = ParticleFile(
        np.zeros((1, 3)), {"platelet_id": np.zeros(1, np.int64), "fibre_direction": np.eye(3)[:1]}, {"spacing": "x"}
    )
    with pytest.raises(ValueError, match="could not convert"):
        draw_in_tool(charge, tmp_path / "a.png", View(), None)
    charge.extra["spacing"] = [1.0, 1.0]
    reason = draw_in_tool(charge, tmp_path / "a.png", View(), None)
    assert reason is not None and not (tmp_path / "a.png").exists()


def test_what_is_seen_from_above_is_the_top_layer(tmp_path):
    charge = read_particles(run(parse_scene(SCENE), output=tmp_path / "charge.vtkhdf"), "charge")
    seen = uppermost(charge, View())
    assert len(seen) == 16 * 12 and np.all(charge.positions[seen, 2] == 1.75)
    below = uppermost(charge, View(toward=-1.0))
    assert np.all(charge.positions[below, 2] == 0.25)


def test_views_and_colours():
    assert View.against((0, -1, 0)) == View(2, 0, 1.0)
    assert View.against((0, 0, -1)) == View(0, 1, 1.0)
    colours = colours_of_ids(np.array([-1, 0, 1, 2]))
    assert np.all(colours[0] == 0.6) and len(np.unique(np.round(colours, 3), axis=0)) == 4
