"""Random platelets: the five steps, walls, tilt, and the papers' statistics."""

import numpy as np
import pytest

from ppmc.charge.domains.lattice import box_lattice, filled_lattice
from ppmc.charge.orient import frames_of
from ppmc.charge.platelets import five_step, random_numbers
from ppmc.charge.platelets.five_step import COMPLETE, CUT_BY_WALL, FREE, INCOMPLETE, OUTSIDE, collect_cells, fill_layer
from ppmc.charge.platelets.platelets import distance_beyond, draw_sizes, random_platelets, tilted
from ppmc.errors import SceneError
from ppmc.orientation import angle_between_axes, orientation_tensor
from ppmc.scene.sections.charge import ListedSizes, NormalSizes, PlateletsOrientation

BRACKET = ((0.0, 0.0, 0.0), (93.5, 34.0, 6.0), (0.5, 0.5, 0.5))


def platelets(lattice, seed=0, **keys):
    section = PlateletsOrientation.model_validate({"length": 12.7, "width": 12.7, **keys})
    return frames_of(section, lattice, np.random.default_rng([seed, 3]))


def test_generator_gives_the_reference_numbers_and_even_shares():
    state = np.array([1234567], dtype=np.uint64)
    # First numbers of SplitMix64 from this seed, as published with the reference implementation.
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [int(random_numbers.next_bits(state)) for _ in range(4)] == expected
    draws = np.array([random_numbers.next_below(state, 7) for _ in range(70_000)])
    assert np.abs(np.bincount(draws, minlength=7) - 10_000).max() < 500


def layer(nx=60, ny=40):
    return np.full((ny, nx), FREE, dtype=np.int64)


def cells_of(shape, j0, i0, length, width, angle, dx, dy):
    """Return the mask of cells in a rectangle, the plain way: the twin of `collect_cells`."""
    j, i = np.indices(shape)
    x, y = (i - i0) * dx, (j - j0) * dy
    u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    return (np.abs(u) <= length / 2) & (np.abs(v) <= width / 2)


def test_collected_cells_equal_the_plain_ones():
    generator = np.random.default_rng(4)
    buffer = np.empty(10_000, np.int64)
    for _ in range(200):
        owner = layer()
        owner[generator.random(owner.shape) < 0.01] = 5
        owner[:, 50:] = OUTSIDE
        j0, i0 = generator.integers(0, 40), generator.integers(0, 50)
        owner[j0, i0] = FREE
        length, width, angle = generator.uniform(0.3, 8), generator.uniform(0.3, 8), generator.uniform(0, np.pi)
        mask = cells_of(owner.shape, j0, i0, length, width, angle, 0.5, 0.4)
        n, blocked = collect_cells(owner, 0.5, 0.4, j0, i0, length, width, np.cos(angle), np.sin(angle), buffer)
        assert np.array_equal(np.sort(buffer[:n]), np.flatnonzero(mask & (owner == FREE)))
        assert blocked == np.any(mask & (owner >= 0))


def test_overhang_counts_the_cells_of_a_rectangle_beyond_walls_and_outlines():
    generator = np.random.default_rng(5)
    wide = np.full((100, 120), OUTSIDE)
    wide[30:70, 30:90] = FREE
    wide[45:50, 40:44] = OUTSIDE
    owner = np.ascontiguousarray(wide[30:70, 30:90])
    for _ in range(200):
        j0, i0 = generator.integers(0, 40), generator.integers(0, 60)
        length, width = generator.uniform(0.3, 12, 2)
        angle = generator.choice([0.0, np.pi / 2, generator.uniform(0, np.pi)])
        mask = cells_of(wide.shape, j0 + 30, i0 + 30, length, width, angle, 0.5, 0.4)
        share = five_step.overhang(owner, 0.5, 0.4, j0, i0, length, width, np.cos(angle), np.sin(angle))
        assert share == pytest.approx(np.mean(wide[mask] == OUTSIDE))


def test_a_rectangle_whose_sides_pass_through_cell_centres_holds_these():
    owner, buffer = layer(), np.empty(200, np.int64)
    for angle in (0.0, np.pi / 2, np.pi):
        n, _ = collect_cells(owner, 0.5, 0.5, 20, 30, 6.0, 3.0, np.cos(angle), np.sin(angle), buffer)
        assert n == 13 * 7
    # It may touch the centres of the outermost cells, not those beyond.
    assert five_step.overhang(owner, 0.5, 0.5, 3, 30, 6.0, 3.0, 1.0, 0.0) == 0.0
    assert five_step.overhang(owner, 0.5, 0.5, 2, 30, 6.0, 3.0, 1.0, 0.0) == pytest.approx(1 / 7)


def test_a_cell_is_given_up_early_only_where_every_angle_is_blocked():
    generator = np.random.default_rng(6)
    buffer = np.empty(2000, np.int64)
    given_up = 0
    for _ in range(300):
        owner = layer()
        owner[generator.integers(0, 40), generator.integers(0, 60)] = 5
        owner[:, 55:] = OUTSIDE
        j0, i0 = generator.integers(0, 40), generator.integers(0, 55)
        length, width = np.sort(generator.uniform(2, 20, 2))[::-1]
        if owner[j0, i0] == FREE and five_step.taken_at_any_angle(owner, 0.5, 0.4, j0, i0, width):
            given_up += 1
            for angle in np.linspace(0, np.pi, 60):
                assert collect_cells(
                    owner, 0.5, 0.4, j0, i0, length, width, np.cos(angle), np.sin(angle), buffer
                )[1]  # fmt: skip
    assert given_up > 10


def test_distance_beyond_walls_is_exact_for_a_box_and_within_a_cell_for_a_disc():
    beyond = distance_beyond(np.ones((6, 10), bool), 3, 0.5, 0.4)
    x, y = (np.arange(-3, 13) + 0.5) * 0.5, (np.arange(-3, 9) + 0.5) * 0.4
    np.testing.assert_allclose(beyond[6], np.maximum(np.maximum(-x, x - 5.0), -1.0), atol=1e-12)
    np.testing.assert_allclose(beyond[:, 8], np.maximum(-y, y - 2.4), atol=1e-12)
    X, Y = np.meshgrid((np.arange(80) - 39.5) * 0.5, (np.arange(80) - 39.5) * 0.5)
    radius = np.hypot(X, Y)
    disc = distance_beyond(radius < 15, 4, 0.5, 0.5)[4:-4, 4:-4]
    np.testing.assert_allclose(disc, radius - 15, atol=0.5)


def test_extent_beyond_a_wall():
    beyond = distance_beyond(np.ones((40, 60), bool), 20, 0.5, 0.5)
    # Centre of the cell 0.25 mm from the wall at low x2, far from all other walls.
    for angle in (0.0, 0.3, np.pi / 2, 2.0):
        out = five_step.extent_beyond(beyond, 20, 0.5, 0.5, 0, 30, 6.0, 3.0, np.cos(angle), np.sin(angle))
        assert out == pytest.approx(0.5 * (6 * abs(np.sin(angle)) + 3 * abs(np.cos(angle))) - 0.25)
    assert five_step.extent_beyond(beyond, 20, 0.5, 0.5, 20, 30, 6.0, 3.0, 1.0, 0.0) < 0


def test_a_platelet_that_no_angle_keeps_in_lies_along_the_wall_or_as_softness_lets_it():
    owner, state = layer(), np.array([1], dtype=np.uint64)
    beyond = distance_beyond(owner == FREE, 20, 0.5, 0.5)
    at_wall = (owner, beyond, 20, 0.5, 0.5, 0, 30, 6.0, 3.0)
    assert {five_step.angle_at_wall(*at_wall, 0.0, state) for _ in range(20)} == {0.0}
    free = [five_step.angle_at_wall(*at_wall, 1.0, state) for _ in range(2000)]
    assert np.mean(np.cos(free) ** 2) == pytest.approx(0.5, abs=0.03)
    # Along the wall a platelet loses 3 of 7 rows of cells, across it 6 of 13.
    soft = [five_step.angle_at_wall(*at_wall, 0.45, state) for _ in range(200)]
    assert len(set(soft)) > 3
    assert np.abs(np.sin(soft)).max() < 0.9


def test_a_layer_has_no_gap_and_complete_platelets_have_every_cell():
    owner = layer(120, 80)
    state = np.array([7], dtype=np.uint64)
    beyond = distance_beyond(owner == FREE, 10, 0.5, 0.5)
    sizes = np.full(owner.size, 6.0), np.full(owner.size, 3.0)
    angles, kinds = fill_layer(owner, beyond, 10, 0.5, 0.5, *sizes, 0.0, 500, 100, state)
    counts = np.bincount(owner.ravel() - 100)
    assert owner.min() == 100 and len(counts) == len(angles) == len(kinds) and counts.min() >= 1
    assert {COMPLETE, INCOMPLETE} <= set(kinds.tolist())
    for k in np.flatnonzero(kinds == COMPLETE):
        j, i = np.nonzero(owner == 100 + k)
        # The rectangle is symmetric about the cell it began at, and a complete one kept all its cells.
        assert cells_of(owner.shape, j.mean(), i.mean(), 6.0, 3.0, angles[k], 0.5, 0.5).sum() == len(j)
    hard = np.isin(owner - 100, np.flatnonzero(kinds == CUT_BY_WALL))
    assert hard.mean() < 0.2


def test_layers_may_have_any_outline():
    def ring(points):
        r = np.hypot(points[:, 0], points[:, 1])
        return (r < 20) & (r > 8)

    lattice = filled_lattice(
        np.array([-20.0, -20, 0]), np.array([20.0, 20, 2]), np.pi * (400 - 64) * 2, ring, (0.5, 0.5, 0.5)
    )
    frames = platelets(lattice, length=8, width=4, on_edge={"share": 0.5})
    ids = frames.platelet_id
    assert ids.min() == 0 and np.array_equal(np.unique(ids), np.arange(frames.notes["platelets"]))
    assert np.abs(np.sum(frames.fibre_direction * frames.platelet_normal, axis=1)).max() < 1e-12
    standing = np.abs(frames.platelet_normal[:, 2]) < 0.5
    radius = np.hypot(lattice.positions[:, 0], lattice.positions[:, 1])
    assert standing.any() and np.all((radius[standing] > 19) | (radius[standing] < 9))
    outward = lattice.positions[standing] * [1, 1, 0]
    assert np.median(angle_between_axes(frames.platelet_normal[standing], outward)) < 15


def test_seeds_repeat_and_differ():
    lattice = box_lattice((0, 0, 0), (40, 20, 2), (0.5, 0.5, 0.5))
    keys = {"on_edge": {"share": 0.3}, "pitch": 5, "roll": 5, "length": {"mean": 8, "deviation": 1}}
    one, again, other = (platelets(lattice, s, **keys) for s in (1, 1, 2))
    assert np.array_equal(one.fibre_direction, again.fibre_direction)
    assert np.array_equal(one.platelet_normal, again.platelet_normal)
    assert np.array_equal(one.platelet_id, again.platelet_id)
    assert not np.array_equal(one.platelet_id, other.platelet_id)


def test_one_platelet_is_one_frame_and_stays_in_its_band():
    lattice = box_lattice((0, 0, 0), (30, 20, 3), (0.5, 0.5, 0.25))
    frames = platelets(lattice, length=8, width=4, thickness=0.5, pitch=4, roll=9)
    for k in range(frames.notes["platelets"]):
        mine = frames.platelet_id == k
        assert np.ptp(frames.fibre_direction[mine], axis=0).max() == 0
        assert np.ptp(frames.platelet_normal[mine], axis=0).max() == 0
        layers = np.unique(lattice.layer[mine])
        assert len(layers) == 2 and layers[0] % 2 == 0
    shares = [
        frames.notes[f"volume_fraction_{k}_per_layer"] for k in ("complete", "cut_by_wall", "incomplete", "on_edge")
    ]
    np.testing.assert_allclose(np.sum(shares, axis=0), 1.0, atol=1e-5)


# Mean A11 of ten runs of one 187 x 68 layer of an independent code, and its error. The errors are those of the means:
# one layer holds about 53 platelets of 12.7 mm square, whose random angles alone scatter by 0.354 / sqrt(53) = 0.05.
FIVE_STEP = [
    (12.7, 12.7, 0.482, 0.017),
    (12.7, 6.35, 0.609, 0.007),
    (6.35, 6.35, 0.488, 0.009),
    (12.7, 3.175, 0.599, 0.010),
    (25.4, 12.7, 0.748, 0.018),
]


def test_on_edge_layer_does_not_depend_on_the_lattice():
    shares = []
    for spacing in (1.0, 0.5, 0.25):
        lattice = box_lattice((0, 0, 0), (40, 20, 3), (spacing, spacing, 0.5))
        frames = platelets(lattice, length=8, width=4, on_edge={"share": 0.8, "depth": "0.5 mm"})
        shares.append(np.mean(np.abs(frames.platelet_normal[:, 2]) < 0.5))
    ring = 1 - (39 * 19) / (40 * 20)
    # The last platelet may take a little more than was wanted.
    assert shares == pytest.approx([0.8 * ring] * 3, rel=0.1)


@pytest.mark.parametrize(("length", "width", "expected", "error"), FIVE_STEP)
def test_five_step_statistics_of_the_reference(length, width, expected, error):
    # Layers are filled independently, so that 96 layers are 96 runs of one layer. Squares are the widest off, by 1.3
    # errors of the reference: their mean is 1/2 (below).
    lattice = box_lattice(*BRACKET[:2], BRACKET[2], layers=96)
    runs = platelets(lattice, length=length, width=width).fibre_direction[:, 0].reshape(96, -1)
    A11 = np.mean(runs**2, axis=1)
    assert abs(A11.mean() - expected) < (1.0 if length > width else 1.35) * error + 2.0 * A11.std() / np.sqrt(96)


@pytest.mark.parametrize("size", [12.7, 6.35])
def test_square_platelets_have_no_preferred_wall(size):
    # A square turned by 90 degrees covers the same cells: however walls limit angles, <A11> = 1/2 exactly.
    lattice = box_lattice(*BRACKET[:2], BRACKET[2], layers=96)
    runs = platelets(lattice, 1, length=size, width=size).fibre_direction[:, 0].reshape(96, -1)
    A11 = np.mean(runs**2, axis=1)
    assert abs(A11.mean() - 0.5) < 3 * A11.std() / np.sqrt(len(A11))


def test_soft_walls_forget_the_box():
    lattice = box_lattice(*BRACKET, layers=4)
    soft = [np.mean(platelets(lattice, s, width=3.175, wall_softness=1).fibre_direction[:, 0] ** 2) for s in range(8)]
    assert np.mean(soft) == pytest.approx(0.5, abs=0.03)


def test_the_measured_charge_of_the_bracket_can_be_matched():
    # J13, with the parameters that the scene's `platelets` section states.
    lattice = box_lattice(*BRACKET, layers=12)
    keys = {"width": 6.35, "wall_softness": 0.38, "pitch": 9.5, "roll": 19.5}
    keys["on_edge"] = {"share": 0.9, "depth": 0.5}
    runs = [platelets(lattice, s, **keys) for s in range(4)]
    A = np.mean([np.diag(orientation_tensor(f.fibre_direction)) for f in runs], axis=0)
    N = np.mean([np.diag(orientation_tensor(f.platelet_normal)) for f in runs], axis=0)
    np.testing.assert_allclose(A, [0.503, 0.469, 0.028], atol=0.02)
    np.testing.assert_allclose(N, [0.071, 0.088, 0.841], atol=0.03)


def test_tilt_keeps_frames_orthonormal_and_has_the_stated_size():
    n = 4000
    p, r = tilted(np.tile([1.0, 0, 0], (n, 1)), np.tile([0.0, 0, 1], (n, 1)), np.full(n, 0.1), np.full(n, 0.2))
    np.testing.assert_allclose(p[0], [np.cos(0.1), 0, np.sin(0.1)])
    assert np.abs(np.sum(p * r, axis=1)).max() < 1e-15
    assert r[0, 2] == pytest.approx(np.cos(0.1) * np.cos(0.2))
    assert abs(r[0, 1]) == pytest.approx(np.sin(0.2))


def test_sizes():
    generator = np.random.default_rng(0)
    normal = draw_sizes(NormalSizes(mean=10, deviation=4), 20_000, generator)
    assert normal.min() >= 1 and normal.max() <= 20 and normal.mean() == pytest.approx(10, abs=0.2)
    listed = draw_sizes(ListedSizes(values=[5, 10], shares=[3, 1]), 20_000, generator)
    assert np.mean(listed == 5) == pytest.approx(0.75, abs=0.02)
    assert np.all(draw_sizes(6.35, 5, generator) == 6.35)
    with pytest.raises(ValueError, match="give one each"):
        ListedSizes(values=[5, 10], shares=[1])


def test_platelets_smaller_than_particles_are_refused():
    lattice = box_lattice((0, 0, 0), (10, 10, 2), (1, 1, 1))
    with pytest.raises(SceneError, match=r"smaller than the particle\s+spacing 1 mm"):
        platelets(lattice, length=0.2, width=0.2)


def test_incomplete_platelets_are_counted_in_platelets_and_volume():
    lattice = box_lattice((0, 0, 0), (40, 20, 1), (0.5, 0.5, 0.5))
    section = PlateletsOrientation(length=8, width=4)
    frames = random_platelets(section, lattice, np.random.default_rng(0))
    counts = [frames.notes[f"platelets_{k}"] for k in ("complete", "cut_by_wall", "incomplete", "on_edge")]
    assert sum(counts) == frames.notes["platelets"] == len(np.unique(frames.platelet_id))
    assert counts[2] > 0 and counts[3] == 0
