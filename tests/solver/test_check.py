"""What `ppmc check` says about the solver: exact answers, stiffness, inertia, cost, impossible scenes."""

import math
import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from ppmc.charge.stage import run as make_charge
from ppmc.cli import _run
from ppmc.errors import SceneError
from ppmc.files import read_particles
from ppmc.geometry.tools.toolset import compile_tools
from ppmc.scene.loader import parse_scene
from ppmc.scene.scene import Scene
from ppmc.solver.check import findings
from ppmc.solver.forecast.closed_form import free_squeeze, walled_squeeze
from ppmc.solver.forecast.estimates import describe_charge, explicit_steps, implicit_steps, make_plan, narrow_places
from ppmc.solver.forecast.homogeneous import Squeeze, homogeneous_squeeze
from ppmc.solver.run.setup import prepare
from ppmc.solver.stage import run as solve_scene
from ppmc.solver.step.explicit import ExplicitIntegrator

from .scenes import make_squeeze, squeeze

BLOCK = """
name: block
charge:
  domain: {shape: box, origin: [10, 0, 0], size: [20, 10, 4]}
  spacing: 1 mm
  orientation: {source: uniform}
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 4], normal: [0, 0, -1], motion: {velocity: [0, 0, -2], travel: 2}}
material: {model: transversely_isotropic, shear_viscosity: 3, anisotropy_ratio: 116}
solver: {end_time: 1}
"""
COLLIMATED = "{source: uniform}"
MATERIAL = "{model: transversely_isotropic, shear_viscosity: 3, anisotropy_ratio: 116}"
WALLS = """
  front: {shape: plane, point: [0, 0, 0], normal: [0, 1, 0]}
  back: {shape: plane, point: [0, 10, 0], normal: [0, -1, 0]}
"""


def block(**changes: str) -> Scene:
    """The scene with whole pieces of it replaced."""
    text = BLOCK
    for old, new in changes.items():
        pieces = {"orientation": COLLIMATED, "material": MATERIAL, "solver": "{end_time: 1}", "travel": "travel: 2"}
        assert pieces[old] in text
        text = text.replace(pieces[old], new)
    return parse_scene(text)


def with_tools(text: str, **changes: str) -> Scene:
    scene = block(**changes)
    tooling = parse_scene(BLOCK.replace("material:", text.strip("\n") + "\nmaterial:")).tooling
    return scene.model_copy(update={"tooling": tooling})


def exact(scene: Scene) -> Squeeze | None:
    return homogeneous_squeeze(scene, compile_tools(scene.tooling))


def said(scene: Scene) -> str:
    return "\n".join(findings(scene))


# R, ratio of the collimated outline's sides at h0/h = 2 (model of Tucker and Dumont's plug flow, exact).
@pytest.mark.parametrize(("ratio", "aspect"), [(1.0, 1.0), (2.0, 1.41421), (116.0, 1.98808), (61215.0, 1.99998)])
def test_collimated_squeeze_with_free_sides(ratio, aspect):
    along, across, factor = free_squeeze(ratio, 2.0, True)
    assert across / along == pytest.approx(aspect, abs=1e-5)
    assert along * across == pytest.approx(2.0, rel=1e-14)
    assert factor == 4.0 - 1.0 / ratio


# h0/h, A11, and stress over eta23 x rate for R = 116.
@pytest.mark.parametrize(
    ("compression", "A11", "stress"), [(1.5, 0.6, 224.8), (2.0, 2 / 3, 259.6), (7 / 3, 0.7, 277.7), (4.0, 0.8, 335.2)]
)
def test_planar_random_squeeze_between_walls(compression, A11, stress):
    along, factor = walled_squeeze(116.0, compression, None)
    assert along == pytest.approx(A11, rel=1e-12)
    assert factor == pytest.approx(stress, abs=0.05)
    assert walled_squeeze(116.0, 1.0, None)[1] == pytest.approx(1.5 * 116 + 2.5)


def test_factors_are_those_of_the_viscosity_averaged_over_directions():
    # J5 for many directions of fibres that were planar random and moved affinely.
    angles = (np.arange(4000) + 0.5) * np.pi / 4000
    compression, ratio = 2.0, 50.0
    for walls in (False, True):
        stretch = np.diag([compression, 1.0]) if walls else np.sqrt(compression) * np.eye(2)
        rate = np.diag([1.0, 0.0, -1.0]) if walls else np.diag([0.5, 0.5, -1.0])
        p = np.stack([np.cos(angles), np.sin(angles)]).T @ stretch
        p /= np.linalg.norm(p, axis=1, keepdims=True)
        m = np.pad(p[:, :, None] * p[:, None, :], ((0, 0), (0, 1), (0, 1))) - np.eye(3) / 3.0
        stress = 2.0 * rate + 4.0 * (ratio - 1.0) * np.mean(np.einsum("ij,nij->n", rate, m)[:, None, None] * m, axis=0)
        factor = walled_squeeze(ratio, compression, None)[1] if walls else free_squeeze(ratio, compression, False)[2]
        assert stress[0, 0] - stress[2, 2] == pytest.approx(factor, rel=1e-6)


def test_exact_answer_of_a_collimated_block():
    answer = exact(block())
    assert answer is not None and answer.kind == "collimated charge with free sides" and answer.even
    assert answer.stretches["along the fibres"] == pytest.approx(2 ** (0.5 / 116))
    assert answer.stretches["x3"] == pytest.approx(0.5)
    np.testing.assert_allclose(answer.orientation, [1, 0, 0])
    # (4 - 1/R) eta23 v V / h^2.
    (begin, first), (end, last) = answer.forces
    assert (begin, end) == (0.0, 1.0)
    assert first == pytest.approx((4 - 1 / 116) * 3 * 2 * 800 / 16)
    assert last == pytest.approx(4 * first)
    turned = exact(block(orientation="{source: uniform, fibre_direction: [1, 1, 0]}"))
    assert turned is not None and turned.stretches == pytest.approx(answer.stretches)
    np.testing.assert_allclose(turned.orientation, [0.5, 0.5, 0])


def test_exact_answer_of_planar_random_fibres():
    planar = "{source: planar_random}"
    free = exact(block(orientation=planar))
    assert free is not None and not free.even
    assert free.stretches == pytest.approx({"x1": math.sqrt(2), "x2": math.sqrt(2), "x3": 0.5})
    assert free.forces[0][1] == pytest.approx(118 * 3 * 2 * 800 / 16)
    walled = exact(with_tools(WALLS, orientation=planar))
    assert walled is not None and walled.kind == "planar random charge between side walls across x2"
    assert walled.stretches == pytest.approx({"x1": 2.0, "x2": 1.0, "x3": 0.5})
    np.testing.assert_allclose(walled.orientation, [2 / 3, 1 / 3, 0])
    assert walled.forces[1][1] == pytest.approx(259.556 * 3 * 2 * 800 / 4, rel=1e-5)
    uniform_planar = block(material=MATERIAL.replace("transversely_isotropic", "planar_uniform"))
    answer = exact(uniform_planar)
    assert answer is not None and answer.forces[0][1] == pytest.approx(118 * 3 * 2 * 800 / 16)


@pytest.mark.parametrize(("direction", "factor", "A11"), [("[1, 0, 0]", 4 * 116, 1.0), ("[0, 1, 0]", 4.0, 0.0)])
def test_exact_answer_of_fibres_along_and_across_a_channel(direction, factor, A11):
    answer = exact(with_tools(WALLS, orientation=f"{{source: uniform, fibre_direction: {direction}}}"))
    assert answer is not None and answer.stretches["x1"] == pytest.approx(2.0)
    assert answer.forces[0][1] == pytest.approx(factor * 3 * 2 * 800 / 16)
    assert answer.orientation[0] == A11


def test_a_ram_that_starts_above_the_charge_meets_it_later():
    scene = parse_scene(BLOCK.replace("point: [0, 0, 4]", "point: [0, 0, 5]").replace("travel: 2", "travel: 3").replace(
        "end_time: 1", "end_time: 2"))  # fmt: skip
    answer = exact(scene)
    assert answer is not None
    assert answer.forces[0][0] == pytest.approx(0.5)
    assert answer.forces[1][0] == pytest.approx(1.5)
    assert answer.stretches["x3"] == pytest.approx(0.5)


def test_a_disk_is_a_prism_too():
    scene = parse_scene(
        BLOCK.replace(
            "{shape: box, origin: [10, 0, 0], size: [20, 10, 4]}",
            "{shape: cylinder, center: [0, 0, 2], axis: [0, 0, 1], radius: 6, length: 4}",
        )
    )
    answer = exact(scene)
    assert answer is not None
    assert answer.forces[0][1] == pytest.approx((4 - 1 / 116) * 3 * 2 * np.pi * 36 * 4 / 16)


NOT_HOMOGENEOUS = {
    "friction": (BLOCK.replace("normal: [0, 0, -1],", "normal: [0, 0, -1], wall: no_slip,"), "block"),
    "a stop in the way": (BLOCK.replace("material:", "  pin: {shape: cylinder, center: [20, 12, 0], axis: [0, 0, 1], "
                                                     "radius: 1}\nmaterial:"), "pin"),
    "a ram that is no larger than the charge": (
        BLOCK.replace("{shape: plane, point: [0, 0, 4], normal: [0, 0, -1],",
                      "{shape: box, center: [20, 5, 6], size: [20, 10, 4],"), "box"),
    "walls that end with the charge": (
        BLOCK.replace("{source: uniform}", "{source: planar_random}").replace("material:", """
  front: {shape: box, center: [20, -1, 2], size: [20, 2, 4]}
  back: {shape: box, center: [20, 11, 2], size: [20, 2, 4]}
material:"""), "walls"),
    "oblique fibres in a channel": (
        BLOCK.replace("{source: uniform}", "{source: uniform, fibre_direction: [1, 1, 0]}")
        .replace("material:", WALLS.strip("\n") + "\nmaterial:"), "oblique"),
    "platelets": (BLOCK.replace("{source: uniform}", "{source: platelets, length: 6, width: 3}"), "platelets"),
    "fibres through the thickness": (
        BLOCK.replace("{source: uniform}",
                      "{source: uniform, fibre_direction: [0, 0, 1], platelet_normal: [1, 0, 0]}"), "upright"),
    "a force": (BLOCK.replace("{velocity: [0, 0, -2], travel: 2}",
                              "{force: 5 N, direction: [0, 0, -1], max_speed: 1}"), "force"),
    "a sideways motion": (BLOCK.replace("velocity: [0, 0, -2]", "velocity: [1, 0, -2]"), "sideways"),
}  # fmt: skip


@pytest.mark.parametrize("name", NOT_HOMOGENEOUS)
def test_flows_that_are_not_homogeneous_get_no_exact_answer(name):
    scene = parse_scene(NOT_HOMOGENEOUS[name][0])
    assert exact(scene) is None
    assert "exact" not in said(scene)


def test_the_solver_agrees_with_what_is_promised():
    done = squeeze(shape=(8, 8, 6), ratio=20.0)
    text = """
name: same
charge:
  domain: {shape: box, size: [8, 8, 6]}
  spacing: 1 mm
  orientation: {source: uniform}
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 6], normal: [0, 0, -1], motion: {velocity: [0, 0, -3]}}
material: {model: transversely_isotropic, shear_viscosity: 1, anisotropy_ratio: 20}
solver: {end_time: 1, output_interval: 1}
"""
    scene = parse_scene(text)
    answer = exact(scene)
    assert answer is not None
    mean = done.stretch.mean(axis=0)
    assert mean[0, 0] == pytest.approx(answer.stretches["along the fibres"], rel=0.01)
    assert mean[1, 1] == pytest.approx(answer.stretches["across them"], rel=0.01)
    # Forces of a step belong to its middle.
    later = done.compression**2 / 4.0
    assert done.press_force == pytest.approx(answer.forces[1][1] * later, rel=0.03)
    tools = compile_tools(scene.tooling)
    charge = describe_charge(scene.charge, scene, tools)
    plan = make_plan(scene.solver, scene.material, tools, charge, narrow_places(tools, charge, 1.0)[0])
    assert implicit_steps(scene.solver, plan) == pytest.approx(len(done.reports), rel=0.25)


@pytest.mark.parametrize(
    "settings",
    ["{end_time: 1}", "{end_time: 1, bulk_modulus: 5 MPa}", "{end_time: 1, bulk_ratio: 40, reynolds_number: 0.01}",
     "{end_time: 1, strain_rate: 2, density: 0.3}"],
)  # fmt: skip
def test_constants_are_those_of_the_run(settings, tmp_path):
    for domain in ("{shape: box, origin: [10, 0, 0], size: [20, 10, 4]}",
                   "{shape: cylinder, center: [0, 0, 2], axis: [0, 0, 1], radius: 6, length: 4}"):  # fmt: skip
        text = BLOCK.replace("{shape: box, origin: [10, 0, 0], size: [20, 10, 4]}", domain)
        scene = parse_scene(text.replace("{end_time: 1}", settings))
        make_charge(scene, output=tmp_path / "charge.vtkhdf")
        model, state = prepare(scene, read_particles(tmp_path / "charge.vtkhdf", "charge"))
        tools = compile_tools(scene.tooling)
        charge = describe_charge(scene.charge, scene, tools)
        plan = make_plan(scene.solver, scene.material, tools, charge, None)
        assert plan.bulk_modulus == pytest.approx(model.bulk_modulus)
        assert plan.density == pytest.approx(model.density)
        assert charge.count == pytest.approx(len(state), rel=0.02)


@pytest.mark.parametrize("ratio", [1.0, 30.0, 61215.0])
def test_explicit_steps_are_those_that_the_integrator_finds(ratio):
    implicit = make_squeeze(shape=(12, 12, 8), ratio=ratio, integrator="explicit", reynolds_number=1e-3)
    implicit.model.density = 0.7
    integrator = ExplicitIntegrator(implicit.model, implicit.state)
    integrator.initialise(0.0, 1e-3)
    limits = integrator.limits
    scene = block()
    tools = compile_tools(scene.tooling)
    charge = describe_charge(scene.charge, scene, tools)
    plan = make_plan(scene.solver, scene.material, tools, charge, None)
    plan = type(plan)(**{**vars(plan), "density": 0.7, "bulk_modulus": implicit.model.bulk_modulus})
    viscous, acoustic, used = explicit_steps(implicit.model.material, implicit.model.settings.zero_energy, plan, 1.0)
    assert limits is not None
    assert viscous == pytest.approx(limits.viscous, rel=0.15)
    assert acoustic == pytest.approx(limits.courant, rel=0.1)
    assert used == pytest.approx(limits.used, rel=0.15)


def number(text: str, pattern: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found[1].replace(",", ""))


def test_bulk_modulus_is_judged_by_the_closing_rate_at_the_end():
    # eta11 = 463 x 3 Pa s; 2 mm/s on the last 2 mm is 1 1/s.
    text = said(block(solver="{end_time: 1, bulk_modulus: 55560}"))
    assert number(text, r"Pa, ([\d.]+) x eta11") == pytest.approx(40.0, rel=1e-3)
    assert number(text, r"errors of about ([\d.]+) %") == pytest.approx(0.83)
    assert "too soft" not in text
    assert "too soft, 1 % needs 33" in said(block(solver="{end_time: 1, bulk_modulus: 41670}"))


def test_reynolds_number_and_mass_scaling_of_the_bracket():
    # J12: Re = 6.36 x 10^n / (R + 2); with R = 116 and n = 1 it is .54.
    text = """
name: bracket
charge:
  domain: {shape: box, size: [93.5, 34, 6]}
  spacing: 0.5 mm
  layers: 12
  orientation: {source: uniform}
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 6], normal: [0, 0, -1], motion: {velocity: [0, 0, -3.55], travel: 3.55}}
material: {model: transversely_isotropic, matrix_viscosity: 1, fibre_volume_fraction: 0.6, anisotropy_ratio: 116}
solver: {end_time: 1, integrator: explicit, density: 16}
"""
    told = said(parse_scene(text))
    assert number(told, r"Reynolds number ([\d.]+)") == pytest.approx(0.539, abs=0.001)
    assert "inertia shows" in told and "1e+04 x unscaled (1.6e+1.00)" in told
    told = said(parse_scene(text.replace("116", "61215")))
    assert number(told, r"Reynolds number ([\d.]+)") == pytest.approx(1.039e-3, rel=1e-2)
    assert "inertia shows" not in told
    assert number(told, r"about ([\d,]+) MiB") == pytest.approx(152_592 * 1900 / 2**20, rel=0.01)
    steps = number(told, r"about ([\d,]+) steps")
    assert steps == pytest.approx(1.0 / number(told, r"together ([\d.e-]+) s"), rel=0.01)
    assert number(told, r"roughly ([\d.]+) h") == pytest.approx(
        steps * 152_592 / 0.45e6 / 3600 / number(told, r"measured to be ([\d.e+-]+) times"), rel=0.1
    )


def planned(text: str) -> tuple[float, float]:
    """Steps and iterations that are foretold."""
    told = said(parse_scene(text))
    return number(told, r"about ([\d,]+) steps"), number(told, r"steps, ([\d,]+) iterations")


SMALL = """
name: small
charge:
  domain: {shape: box, origin: [2, 2, 0], size: [8, 8, 6]}
  spacing: 1 mm
  orientation: ORIENTATION
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 6], normal: [0, 0, -1], motion: {velocity: [0, 0, -3], travel: 3}}
  WALLS
material: {model: transversely_isotropic, shear_viscosity: 1, anisotropy_ratio: RATIO}
solver: {end_time: 1, output_interval: 0.25}
"""
FRAME = "frame: {shape: box, center: [6, 6, 0], size: [12, 10.6667, 30], inside: true}"


@pytest.mark.parametrize(
    ("ratio", "orientation", "walls"),
    [
        ("20", "{source: uniform}", ""),
        ("100", "{source: platelets, length: 4, width: 2}", ""),
        ("1000", "{source: planar_random}", ""),
        ("100", "{source: platelets, length: 4, width: 2}", FRAME),
    ],
)
def test_steps_and_iterations_are_foretold_within_a_factor_of_three(ratio, orientation, walls, tmp_path):
    # Air holds the charges on their plates; without it the stiff one leans and has let go at 0.9 s.
    text = SMALL.replace("RATIO", ratio).replace("ORIENTATION", orientation).replace("WALLS", walls)
    text = text.replace("output_interval: 0.25", "output_interval: 0.25, ambient_pressure: 0.1 MPa")
    steps, iterations = planned(text)
    scene = parse_scene(text)
    make_charge(scene, output=tmp_path / "charge.vtkhdf")
    solve_scene(scene, input=tmp_path / "charge.vtkhdf", output=tmp_path / "flow.vtkhdf")
    with h5py.File(tmp_path / "flow.vtkhdf") as file:
        done = file["ppmc/history/iterations"][:]
    assert 1 / 3 < steps / len(done) < 3
    assert 1 / 3 < iterations / done.sum() < 3


def test_an_overfull_mould_is_refused_by_check(tmp_path, capsys):
    path = tmp_path / "scene.yaml"
    path.write_text(SMALL.replace("RATIO", "20").replace("ORIENTATION", "{source: uniform}").replace(
        "WALLS", FRAME.replace("size: [12,", "size: [10,")).lstrip())  # fmt: skip
    assert _run(["check", str(path)]) == 2
    assert "charge: at 1 s the charge takes 120.00% of the closed cavity of 320" in capsys.readouterr().err
    path.write_text(path.read_text().replace("end_time: 1,", "end_time: 1, bulk_modulus: 1 MPa,"))
    assert _run(["check", str(path)]) == 0


def test_narrow_places_between_fixed_tools_are_counted_in_spacings():
    slot = """
  left: {shape: box, center: [12, 5, 8], size: [12, 60, 8]}
  right: {shape: box, center: [26.5, 5, 8], size: [13, 60, 8]}
  ends: {shape: box, center: [20, 5, 6], size: [28, 10, 12], inside: true}
"""
    lower = BLOCK.replace(
        "point: [0, 0, 0], normal: [0, 0, 1]",
        "point: [0, 0, 0], normal: [0, 0, 1], motion: {velocity: [0, 0, 1], travel: 1}",
    )
    ram = "  ram: {shape: plane, point: [0, 0, 4], normal: [0, 0, -1], motion: {velocity: [0, 0, -2], travel: 2}}\n"
    text = lower.replace(ram, slot.strip("\n") + "\n")
    told = said(parse_scene(text))
    assert "leave 2 mm, 2 particle spacings: too few" in told
    assert "'left' and 'right'" in told or "'right' and 'left'" in told


def test_fills_have_no_exact_answer_and_a_punch_under_its_sheet_is_no_overlap(capsys):
    for name in ("bracket_coarse", "double_dome_transverse"):
        assert _run(["check", str(Path(__file__).parents[2] / "configs" / f"{name}.yaml")]) == 0
        told = capsys.readouterr().out
        assert "bulk modulus K" in told and "exact" not in told


IMPOSSIBLE = {
    "overlapping tools": ("travel: 2}", "travel: 5}", "end_time: 1", "end_time: 3",
                          "'lower' and 'ram' overlap by 1 mm at t = 2.5 s"),
    "tools that leave nothing": ("travel: 2}", "travel: 4}", "end_time: 1", "end_time: 3",
                                 "'lower' and 'ram' leave a gap of 0 mm"),
    "charge in a tool": ("point: [0, 0, 4]", "point: [0, 0, 3]", "", "", "800 particles are inside 'ram'"),
    "zero thickness": ("size: [20, 10, 4]", "size: [20, 10, 0]", "", "",
                       "charge.domain.size.2: Input should be greater than 0"),
    "negative viscosity": ("shear_viscosity: 3", "shear_viscosity: -3", "", "",
                           "material.shear_viscosity: Input should be greater than 0 (got -3)"),
    "unreachable output": ("end_time: 1", "end_time: 1, output_times: [2]", "", "",
                           "output time 2 s cannot be reached: `end_time` is 1 s"),
    "unreachable interval": ("end_time: 1", "end_time: 1, output_interval: 2", "", "",
                             "`output_interval` 2 s is beyond `end_time` 1 s"),
    "no tools": ("tooling:", "analysis: {}\nnothing:", "", "", "tooling"),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_impossible_scenes_get_one_clear_message(name, tmp_path, capsys):
    old, new, old2, new2, message = IMPOSSIBLE[name]
    assert old in BLOCK and old2 in BLOCK
    path = tmp_path / "scene.yaml"
    path.write_text((BLOCK.replace(old, new).replace(old2, new2) if old2 else BLOCK.replace(old, new)).lstrip())
    code = _run(["check", str(path)])
    err = capsys.readouterr().err
    assert code == 2
    assert err.startswith("ppmc: ") and "Traceback" not in err
    assert message in err, err


def test_a_missing_section_is_named():
    with pytest.raises(SceneError, match="needs a section 'material:'"):
        findings(parse_scene(BLOCK.replace(f"material: {MATERIAL}", "")))
    bare = parse_scene(BLOCK[: BLOCK.index("charge:")] + BLOCK[BLOCK.index("tooling:") :])
    assert "no section charge" in said(bare)


@pytest.mark.parametrize(
    ("spacing", "wall", "told"),
    [
        ("[1, 1, 2]", "slip", "2 layers of particles carry no profile"),
        ("[1, 1, 2]", "no_slip", "its force is up to 23 % too small"),
        ("[1, 1, 1]", "no_slip", "its force is up to 11 % too small"),
        ("[1, 1, 1]", "slip", None),
        ("[1, 1, 0.5]", "no_slip", None),
    ],
)
def test_few_layers_are_told(spacing, wall, told):
    text = BLOCK.replace("spacing: 1 mm", f"spacing: {spacing}").replace("travel: 2}}", f"travel: 2}}, wall: {wall}}}")
    lines = [line for line in findings(parse_scene(text)) if "do not resolve" in line or "no profile" in line]
    assert len(lines) == (told is not None)
    assert told is None or told in lines[0]


@pytest.mark.parametrize("spacing", ["[1, 1, 4]", "[1, 10, 1]"])
def test_a_single_layer_is_refused(spacing):
    with pytest.raises(SceneError, match=r"charge\.spacing: .* mm of charge are a single layer .* of [12.5]+ mm"):
        findings(parse_scene(BLOCK.replace("spacing: 1 mm", f"spacing: {spacing}")))
