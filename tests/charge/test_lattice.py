"""Lattices: counts, exact volumes, symmetry, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ppmc.charge.domains.domain import lattice_of
from ppmc.charge.domains.lattice import box_lattice, filled_lattice
from ppmc.errors import InputFileError, SceneError
from ppmc.scene.sections.charge import ChargeSection

UPRIGHT = {"shape": "cylinder", "center": [0, 0, 0], "axis": [0, 0, 1], "radius": 5, "length": 2}
PRISM = {"shape": "extrusion", "axis": [0, 0, 1], "first_axis": [1, 0, 0], "length": 1}


def section(domain, spacing, **more):
    return ChargeSection.model_validate(
        {"domain": domain, "spacing": spacing, "orientation": {"source": "uniform"}, **more}
    )


def test_bracket_charge_of_the_paper_has_152592_particles():
    lattice = box_lattice((0, 0, 0), (93.5, 34.0, 6.0), (0.5, 0.5, 0.5), layers=12)
    assert lattice.shape == (12, 68, 187)
    assert lattice.n == 152_592
    assert np.bincount(lattice.layer).tolist() == [12_716] * 12
    assert lattice.volumes.sum() == pytest.approx(19_074.0, rel=1e-12)
    np.testing.assert_allclose(lattice.positions[0], [0.25, 0.25, 0.25])
    np.testing.assert_allclose(lattice.positions[-1], [93.25, 33.75, 5.75])


@settings(max_examples=50, deadline=None)
@given(
    size=st.tuples(*[st.floats(1.0, 30.0)] * 3),
    spacing=st.tuples(*[st.floats(0.8, 2.0)] * 3),
    origin=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
)
def test_box_lattice_fills_the_box_exactly(size, spacing, origin):
    lattice = box_lattice(origin, size, spacing)
    n3, n2, n1 = lattice.shape
    assert lattice.n == n1 * n2 * n3
    assert lattice.volumes.sum() == pytest.approx(np.prod(size), rel=1e-12)
    np.testing.assert_allclose(np.array(lattice.spacing) * (n1, n2, n3), size, rtol=1e-12)
    np.testing.assert_allclose(lattice.positions.mean(axis=0), np.add(origin, np.multiply(size, 0.5)), atol=1e-9)
    for axis, (step, wanted) in enumerate(zip(lattice.spacing, spacing, strict=True)):
        assert wanted / 2 - 1e-9 <= step <= 1.5 * wanted + 1e-9, axis


def test_spacing_may_differ_from_axis_to_axis_and_layers_rule_the_third():
    lattice = lattice_of(section({"shape": "box", "size": [10, 6, 4]}, ["1 mm", "0.5 mm", "9 m"], layers=5))
    assert lattice.shape == (5, 12, 10)
    assert lattice.spacing == pytest.approx((1.0, 0.5, 0.8))


def test_cylinder_volume_is_exact_and_its_lattice_symmetric():
    lattice = lattice_of(
        section({"shape": "cylinder", "center": [1, 2, 5], "axis": [0, 0, 1], "radius": 10, "length": 4}, 1.0)
    )
    assert lattice.volumes.sum() == pytest.approx(400 * np.pi, rel=1e-12)
    assert abs(lattice.volume_scale - 1) < 0.02
    np.testing.assert_allclose(lattice.positions.mean(axis=0), [1, 2, 5], atol=1e-12)
    assert lattice.positions[:, 2].min() == pytest.approx(3.5)
    counts = np.bincount(lattice.layer)
    assert len(counts) == 4 and len(set(counts)) == 1


def test_cells_point_back_to_the_full_lattice():
    lattice = lattice_of(section(UPRIGHT, 0.5))
    k, j, i = np.unravel_index(lattice.cells, lattice.shape)
    again = np.stack([i, j, k], axis=1) * lattice.spacing + np.array([-4.75, -4.75, -0.75])
    np.testing.assert_allclose(lattice.positions, again, atol=1e-12)


def test_extrusion_of_an_l_shape():
    profile = [[0, 0], [10, 0], [10, 4], [4, 4], [4, 10], [0, 10]]
    domain = {"shape": "extrusion", "profile": profile, "origin": [0, 0, 1], "axis": [0, 0, 1], "first_axis": [1, 0, 0]}
    lattice = lattice_of(section({**domain, "length": 3}, 0.5))
    assert lattice.volumes.sum() == pytest.approx(192)
    assert lattice.volume_scale == pytest.approx(1.0)
    assert not np.any((lattice.positions[:, 0] > 4) & (lattice.positions[:, 1] > 4))
    with pytest.raises(SceneError, match="needs a `length`"):
        lattice_of(section(domain, 0.5))


def test_a_surface_file_is_filled(tmp_path):
    corners = np.array([[x, y, z] for z in (0, 2) for y in (0, 3) for x in (0, 4)], dtype=float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    lines = ["solid box"]
    for a, b, c, d in quads:
        for triangle in ((a, b, c), (a, c, d)):
            lines += ["facet normal 0 0 0", "outer loop"]
            lines += [f"vertex {x} {y} {z}" for x, y, z in corners[list(triangle)]] + ["endloop", "endfacet"]
    (tmp_path / "box.stl").write_text("\n".join([*lines, "endsolid box"]))
    lattice = lattice_of(section({"shape": "mesh", "file": "box.stl", "unit": "mm"}, 0.5), tmp_path)
    assert lattice.n == 8 * 6 * 4
    assert lattice.volumes.sum() == pytest.approx(24)
    with pytest.raises(InputFileError, match="no such surface file"):
        lattice_of(section({"shape": "mesh", "file": "bux.stl"}, 0.5), tmp_path)


def test_layers_at_a_time_do_not_change_the_lattice():
    # More than a million cells, so that several calls of `inside` make up the lattice.
    def ball(points):
        return np.sum(points**2, axis=1) < 1.0

    lattice = filled_lattice(-np.ones(3), np.ones(3), 4 / 3 * np.pi, ball, (0.0175, 0.0175, 0.0175))
    k, j, i = np.meshgrid(*[(np.arange(n) + 0.5) * 2 / n - 1 for n in lattice.shape], indexing="ij")
    assert np.array_equal(lattice.cells, np.flatnonzero(k**2 + j**2 + i**2 < 1.0))
    assert abs(lattice.volume_scale - 1) < 2e-3


@pytest.mark.parametrize(
    ("domain", "spacing", "message"),
    [
        ({"shape": "box", "size": [10, 10, 1]}, 5.0, "does not fit the domain's extent of 1 mm along x3"),
        ({"shape": "box", "size": [1000, 1000, 1000]}, 0.5, "more than the limit"),
        ({**UPRIGHT, "radius": 1, "length": 4}, 2.0, "too coarse for this shape"),
        ({**PRISM, "profile": [[0, 0], [4, 4], [4, 0], [0, 3]]}, 0.5, "must not cross itself"),
    ],
)
def test_unsuitable_lattices_are_refused(domain, spacing, message):
    with pytest.raises(SceneError, match=message):
        lattice_of(section(domain, spacing))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spacing": "-0.5 mm"}, "greater than 0"),
        ({"spacing": [0.5, 0.5]}, "expected three values"),
        ({"spacing": "3 s"}, "wrong dimension"),
        ({"layers": 0}, "greater than or equal to 1"),
        ({"domain": {"shape": "box", "size": [1, 0, 1]}}, "greater than 0"),
        ({"domain": {"shape": "blob"}}, "box"),
        ({"domain": {**UPRIGHT, "wall": "no_slip"}}, "`wall` belongs to a tool"),
        ({"orientation": {"source": "uniform", "fibre_direction": [0, 0, 1]}}, "must be perpendicular"),
        ({"orientation": {"source": "ct", "confidence": 1.5}}, "less than or equal to 1"),
        ({"orientation": {"source": "planar_random", "normal": [0, 0, 0]}}, "zero vector"),
        ({"spacng": 1}, "Extra inputs"),
    ],
)
def test_bad_sections_are_refused(change, message):
    good = {"domain": {"shape": "box", "size": [1, 1, 1]}, "spacing": 0.5, "orientation": {"source": "uniform"}}
    ChargeSection.model_validate(good)
    with pytest.raises(ValueError, match=message):
        ChargeSection.model_validate({**good, **change})
