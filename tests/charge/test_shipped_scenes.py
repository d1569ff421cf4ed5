"""The scenes of the papers' parts that ship with the project: their geometry is the parts', computed, not typed off."""

from pathlib import Path

import pytest

from ppmc.charge.domains.domain import lattice_of
from ppmc.geometry.parts import CenterGatedDisk, DoubleDome, Part, PinBracket, Plaque
from ppmc.scene import Scene, load_scene

CONFIGS = Path(__file__).parents[2] / "configs"
PARTS: dict[str, Part] = {
    "bracket": PinBracket(),
    "bracket_coarse": PinBracket(),
    "double_dome_transverse": DoubleDome(),
    "double_dome_axial": DoubleDome(charge="axial"),
    "center_gated_disk": CenterGatedDisk(short_shot_height=4.5),
    "plaque": Plaque(),
}


@pytest.mark.parametrize("name", PARTS)
def test_scene_moulds_the_part(name: str) -> None:
    scene, part = load_scene(CONFIGS / f"{name}.yaml"), PARTS[name]
    sections = part.scene_sections()
    charge = {**sections["charge"], "spacing": 1.0}
    computed = Scene.model_validate({"name": name, **sections, "charge": charge})
    assert scene.tooling == computed.tooling
    assert scene.charge is not None
    assert computed.charge is not None
    assert scene.charge.domain == computed.charge.domain
    assert scene.analysis is not None
    assert computed.analysis is not None
    assert scene.analysis.regions == computed.analysis.regions
    assert scene.analysis.paths == computed.analysis.paths
    assert scene.solver is not None
    assert scene.solver.end_time == pytest.approx(part.closing_time, rel=1e-12)
    assert scene.material == computed.material
    if name != "plaque":
        assert scene.charge.orientation == computed.charge.orientation


def test_dome_scenes_write_the_short_shots() -> None:
    # D, Figs 6 and 7: the die stopped by shims 5 to 1 mm above closure.
    for kind in ("transverse", "axial"):
        scene, part = load_scene(CONFIGS / f"double_dome_{kind}.yaml"), PARTS[f"double_dome_{kind}"]
        assert scene.solver is not None
        assert scene.solver.output_times is not None
        opened = [part.stroke - part.closing_speed * t for t in scene.solver.output_times]
        assert opened == pytest.approx([5, 4, 3, 2, 1], abs=1e-6)


def test_bracket_has_the_particles_of_the_paper() -> None:
    scene = load_scene(CONFIGS / "bracket.yaml")
    assert scene.charge is not None
    lattice = lattice_of(scene.charge)
    assert lattice.shape == (12, 68, 187)
    assert lattice.n == 152_592
