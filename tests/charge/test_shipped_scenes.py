"""The scenes of the papers' parts that ship with the project: their geometry is the parts', computed, not typed off."""

from pathlib import Path

import pytest

from ppmc.charge.domain import lattice_of
from ppmc.geometry.parts import Part, PinBracket
from ppmc.scene import Scene, load_scene

CONFIGS = Path(__file__).parents[2] / "configs"
PARTS: dict[str, Part] = {
    "bracket": PinBracket(),
    "bracket_coarse": PinBracket(),
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
    assert scene.solver.end_time == pytest.approx(part.closing_time, abs=1e-9)
    assert scene.material is not None


def test_bracket_has_the_particles_of_the_paper() -> None:
    scene = load_scene(CONFIGS / "bracket.yaml")
    assert scene.charge is not None
    lattice = lattice_of(scene.charge)
    assert lattice.shape == (12, 68, 187)
    assert lattice.n == 152_592
