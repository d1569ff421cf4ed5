"""Pictures of charges: made for every kind of charge, showing what they should."""

import numpy as np
import pytest

from ppmc.charge.figures import pictures
from ppmc.charge.figures.pictures import View, coloured, colours_of_ids, draw_in_tool, space_of, uppermost
from ppmc.charge.stage import draw, run
from ppmc.files import ParticleFile, read_particles
from ppmc.geometry.tools.toolset import compile_tools
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


def test_the_drawing_process_says_why_it_failed():
    charge = ParticleFile(
        np.zeros((1, 3)), {"platelet_id": np.zeros(1, np.int64), "fibre_direction": np.eye(3)[:1]}, {"spacing": "x"}
    )
    with pytest.raises(ValueError, match="could not convert"):
        draw_in_tool(charge, View(), None, (np.zeros(3), np.ones(3)))
    charge.extra["spacing"] = [1.0, 1.0]
    assert isinstance(draw_in_tool(charge, View(), None, (np.zeros(3), np.ones(3))), str)


def test_what_is_seen_from_above_is_the_top_layer(tmp_path):
    charge = read_particles(run(parse_scene(SCENE), output=tmp_path / "charge.vtkhdf"), "charge")
    seen = uppermost(charge, View())
    assert len(seen) == 16 * 12 and np.all(charge.positions[seen, 2] == 1.75)
    below = uppermost(charge, View(toward=-1.0))
    assert np.all(charge.positions[below, 2] == 0.25)


def test_pictures_show_the_whole_cavity_or_the_charge_where_it_is_open(tmp_path):
    scene = parse_scene(SCENE + "\n")
    charge = read_particles(run(scene, output=tmp_path / "charge.vtkhdf"), "charge")
    open_low, open_high = space_of(charge, compile_tools(scene.tooling))
    assert np.all(open_low > -0.7) and np.all(open_high < [8.7, 6.7, 2.7])
    wall = "  wall: {shape: box, center: [10, 3, 1], size: [22, 8, 10], inside: true}"
    closed = parse_scene(SCENE.replace("  lower:", wall + "\n  lower:"))
    low, high = space_of(charge, compile_tools(closed.tooling))
    assert np.all(low < [-1, -1, 0]) and np.all(high > [21, 7, 2]) and np.all(high < [26, 11, 6])


def test_colours_show_groups_else_directions(tmp_path):
    charge = read_particles(run(parse_scene(SCENE), output=tmp_path / "charge.vtkhdf"), "charge")
    assert coloured(charge)[0] == "platelets"
    charge.fields["platelet_id"][:] = -1
    meaning, rgb = coloured(charge)
    assert meaning.startswith("red p1^2")
    np.testing.assert_allclose(rgb, 0.15 + 0.8 * charge.fields["fibre_direction"] ** 2)


def test_views_and_colours():
    assert View.against((0, -1, 0)) == View(2, 0, 1.0)
    assert View.against((0, 0, -1)) == View(0, 1, 1.0)
    colours = colours_of_ids(np.array([-1, 0, 1, 2]))
    assert np.all(colours[0] == 0.6) and len(np.unique(np.round(colours, 3), axis=0)) == 4
