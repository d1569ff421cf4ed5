"""What must not change the orientations, and volumes whose answer is known exactly."""

import itertools

import numpy as np
import pytest

from ppmc.ct.phantom import Phantom
from ppmc.orientation import angle_between_axes
from ppmc.scene.sections.phantom import PhantomSection

INSIDE = np.s_[8:-8, 8:-8, 8:-8]
ROUND = {"fibre_window": 2.0, "normal_window": 4.0}
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def sound(result):
    for name in ("fibre_direction", "platelet_normal"):
        assert np.isfinite(result[name]).all()
        assert np.max(np.abs(np.linalg.norm(result[name].astype(float), axis=-1) - 1.0)) < 1e-5
    assert np.max(np.abs(np.sum(result["fibre_direction"] * result["platelet_normal"], axis=-1))) < 1e-5
    for name in ("eigenvalues", "confidence", "planarity"):
        assert np.isfinite(result[name]).all()


@pytest.mark.parametrize("direction", [(1, 2, 0.5), (0.3, -1, 2), (1, 1, 1), (-2, 1, 0)])
def test_plane_waves_give_their_direction(solve, texture, direction):
    result = solve(texture(direction), **ROUND)
    sound(result)
    error = angle_between_axes(result["fibre_direction"][INSIDE], np.array(direction, float))
    assert np.median(error) < 0.02
    assert error.max() < 0.1
    assert result["confidence"][INSIDE].min() > 0.99


@pytest.mark.parametrize("axis", AXES)
def test_fibre_exactly_along_an_axis(solve, texture, axis):
    result = solve(texture(AXES[axis]), **ROUND)
    sound(result)
    assert angle_between_axes(result["fibre_direction"], np.array(AXES[axis], float)).max() < 0.01
    assert result["valid"].all()


def noisy(texture):
    grey = texture((1, 2, 0.5), n=40)
    return grey + 0.5 * np.random.default_rng(3).standard_normal(grey.shape).astype(np.float32)


TURNS = {
    # volume turned, result turned back, and its components in the old axes
    "mirror z": (lambda g: g[::-1], lambda v: v[::-1] * [1, 1, -1]),
    "quarter turn about z": (
        lambda g: np.rot90(g, axes=(1, 2)),
        lambda v: np.rot90(v, -1, axes=(1, 2))[..., [1, 0, 2]] * [-1, 1, 1],
    ),
    "quarter turn about x": (
        lambda g: np.rot90(g, axes=(0, 1)),
        lambda v: np.rot90(v, -1, axes=(0, 1))[..., [0, 2, 1]] * [1, -1, 1],
    ),
    "cyclic swap": (lambda g: np.transpose(g, (2, 0, 1)), lambda v: np.transpose(v, (1, 2, 0, 3))[..., [2, 0, 1]]),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("steps", [0, 2])
def test_rotation_by_right_angles_and_swap_of_axes(solve, texture, turn, steps):
    """Turning the volume turns the vectors, to float32 rounding."""
    options = {**ROUND, "side_steps": steps}
    grey = noisy(texture)
    base = solve(grey, **options)
    forth, back = TURNS[turn]
    result = solve(np.ascontiguousarray(forth(grey)), **options)
    for name in ("fibre_direction", "platelet_normal"):
        assert angle_between_axes(back(result[name]), base[name]).max() < 0.01, name


ORDERS = list(itertools.permutations(range(3)))
FLIPS = list(itertools.product((1, -1), repeat=3))


def turned(grey, order, flip):
    """Return a volume with its axes in another order, some of them reversed: all 48 turns and mirrors of a cube."""
    return np.ascontiguousarray(np.transpose(grey, order)[:: flip[0], :: flip[1], :: flip[2]])


def turned_back(vectors, order, flip):
    components = vectors[:: flip[0], :: flip[1], :: flip[2], ::-1] * np.array(flip)  # z, y, x as the axes are
    old = np.argsort(order)
    return np.transpose(components, (*old, 3))[..., old][..., ::-1]


@pytest.fixture(scope="module")
def tilted_plies():
    """Plies of 5 voxels, tilted about two axes, with noise: interfaces everywhere, at no rounded place."""
    section = PhantomSection(
        cavity=(40, 37, 32), voxel_size=1.0, layup="plies", angles=[0, 45, 90, -45, 30], tilt=(16, 11), noise=0.3,
        platelet={"length": 20, "width": 10, "thickness": 5}, void_fraction=0.0, streak_wavelength=7.0,
        resin_thickness=1.0, grey_type="float32",
    )  # fmt: skip
    return np.concatenate([slab.fields["grey"] for slab in Phantom(section, 2).slabs()])


@pytest.mark.parametrize("order", ORDERS)
def test_all_turns_and_mirrors_at_interfaces_with_default_windows(solve, tilted_plies, order):
    """Steered and displaced windows turn with the volume: nothing jumps, and what differs is rounding.

    Rounding is what one part in ten million of the grey values does; where p is all but undetermined it turns p more.
    """
    base = solve(tilted_plies, thickness=5.0)
    rng = np.random.default_rng(0)
    shaken = tilted_plies * (1.0 + 1e-7 * rng.standard_normal(tilted_plies.shape)).astype(np.float32)
    rounding = angle_between_axes(solve(shaken, thickness=5.0)["fibre_direction"], base["fibre_direction"])
    sure = base["confidence"] > 0.3
    for flip in FLIPS:
        result = solve(turned(tilted_plies, order, flip), thickness=5.0)
        assert np.array_equal(turned(base["valid"], order, flip), result["valid"])
        for name in ("fibre_direction", "platelet_normal"):
            error = angle_between_axes(turned_back(result[name], order, flip), base[name])
            assert np.median(error) < 1e-4, (name, flip)
            assert error[sure].max() < 0.1, (name, flip)
        error = angle_between_axes(turned_back(result["fibre_direction"], order, flip), base["fibre_direction"])
        for share in (99.0, 99.9):
            assert np.percentile(error, share) < 3.0 * np.percentile(rounding, share) + 1e-4, (share, flip)


@pytest.mark.parametrize(
    ("gain", "offset"), [(1e-4, 0.0), (1e4, 0.0), (1.0, 3e4), (1e3, -1e6), (1e-12, 0.0), (1e12, 0.0)]
)
def test_grey_scale_does_not_matter(solve, texture, gain, offset):
    grey = noisy(texture)
    base = solve(grey, **ROUND)
    result = solve((gain * grey.astype(float) + offset).astype(np.float32), **ROUND)
    sound(result)
    error = angle_between_axes(result["fibre_direction"], base["fibre_direction"])
    assert np.median(error) < 2e-3
    assert error.max() < 0.3
    assert np.array_equal(result["valid"], base["valid"])


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "float64", ">u2"])
def test_number_types(solve, texture, dtype):
    grey = np.rint(128.0 + 12.0 * texture((1, 2, 0.5)))
    base = solve(grey.astype(np.float32), **ROUND)
    result = solve(grey.astype(dtype), **ROUND)
    assert angle_between_axes(result["fibre_direction"], base["fibre_direction"]).max() < 1e-3


@pytest.mark.parametrize("value", [0, 200, 1e6])
def test_constant_volume_is_invalid_but_sound(solve, value):
    result = solve(np.full((24, 24, 24), value, np.float32), **ROUND)
    sound(result)
    assert not result["valid"].any()
    assert not result["eigenvalues"].any()
    assert not result["confidence"].any()


def test_single_bright_voxel(solve):
    grey = np.zeros((33, 33, 33), np.uint8)
    grey[16, 16, 16] = 255
    result = solve(grey, **ROUND)
    sound(result)
    assert not result["valid"][0, 0, 0]


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 1, 0), (1, 0, 0), (1, 1, 0)])
def test_planar_step_knows_its_normal_and_admits_that_p_is_unknown(solve, normal):
    z, y, x = np.meshgrid(*(np.arange(32) - 15.5,) * 3, indexing="ij")
    grey = (normal[0] * x + normal[1] * y + normal[2] * z > 0).astype(np.float32)
    result = solve(grey, **ROUND)
    sound(result)
    near = np.abs(normal[0] * x + normal[1] * y + normal[2] * z) < 2
    near[:8], near[-8:], near[:, :8], near[:, -8:], near[:, :, :8], near[:, :, -8:] = (False,) * 6
    assert angle_between_axes(result["platelet_normal"][near], np.array(normal, float)).max() < 0.1
    assert result["planarity"][near].min() > 0.99
    assert result["confidence"][near].max() < 0.05
    assert not result["valid"][near].any()


def test_anisotropic_voxels(solve, texture):
    spacing = (0.1, 0.1, 0.2)
    direction = (1, 0.5, 0.8)
    grey = texture(direction, n=40, spacing=spacing)
    result = solve(grey, spacing=spacing, fibre_window=0.4, normal_window=0.8)
    error = angle_between_axes(result["fibre_direction"][INSIDE], np.array(direction, float))
    assert np.median(error) < 0.3
    assert error.max() < 0.6


@pytest.mark.parametrize("steps", [0, 1])
@pytest.mark.parametrize("stride", [1, 3])
def test_blocks_and_threads_change_no_bit(solve, texture, steps, stride):
    grey = noisy(texture)
    mask = np.ones(grey.shape, np.uint8)
    mask[:, :7] = 0
    for own_mask in (None, mask):
        options = {
            "fibre_window": (2.0, 2.0, 0.7),
            "normal_window": 5.0,
            "side_steps": steps,
            "stride": stride,
            "mask": own_mask,
        }
        base = solve(grey, **options)
        for threads, cut in ((1, (7, 11, 100)), (2, (13, 5, 9)), (3, (1, 64, 17)), (2, (64, 3, 64))):
            other = solve(grey, threads=threads, cut=cut, **options)
            for name in base:
                assert np.array_equal(other[name], base[name]), (name, threads, cut)


@pytest.mark.parametrize("stride", [1, 4, 7])
def test_blocks_and_threads_change_no_bit_of_steered_windows(solve, tilted_plies, stride):
    mask = np.ones(tilted_plies.shape, np.uint8)
    mask[:, :7] = 0
    for own_mask in (None, mask):
        options = {"thickness": 5.0, "stride": stride, "mask": own_mask}
        base = solve(tilted_plies, **options)
        sound(base)
        for threads, cut in ((1, (7, 11, 100)), (2, (9, 5, 13)), (3, (3, 64, 17))):
            other = solve(tilted_plies, threads=threads, cut=cut, **options)
            for name in base:
                assert np.array_equal(other[name], base[name]), (name, threads, cut)


def test_stride_gives_the_same_bits_with_steered_windows(solve, tilted_plies):
    full = solve(tilted_plies, thickness=5.0)
    for k in (2, 7):
        some = solve(tilted_plies, thickness=5.0, stride=k)
        for name in full:
            assert np.array_equal(some[name], full[name][::k, ::k, ::k]), (name, k)


def test_stride_gives_the_voxels_of_the_full_output(solve, texture):
    grey = noisy(texture)
    options = {"fibre_window": (2.0, 2.0, 0.7), "normal_window": 5.0}
    full = solve(grey, **options)
    for k in (2, 4):
        some = solve(grey, stride=k, **options)
        error = angle_between_axes(some["fibre_direction"], full["fibre_direction"][::k, ::k, ::k])
        assert np.median(error) < 1e-3
        assert error.max() < 0.2


def test_normal_of_a_stack_of_plies(solve, texture):
    """Plies of alternating grey value lie in the x-y plane, whatever their streaks do."""
    directions = [(1, 0, 0), (1, 1, 0), (0, 1, 0), (1, -1, 0)]
    plies = [texture(d, n=40, seed=i)[:6] + 8.0 * (i % 2) for i, d in enumerate(directions * 2)]
    result = solve(np.concatenate(plies), thickness=6.0, normal_window=6.0)
    error = angle_between_axes(result["platelet_normal"], np.array([0.0, 0.0, 1.0]))
    assert np.median(error) < 3.0


def test_mask_hides_the_outside(solve, texture):
    """Bright air and clamps around a specimen change nothing inside it."""
    grey = noisy(texture)
    mask = np.zeros(grey.shape, np.uint8)
    mask[6:34, 6:34, 6:34] = 1
    options = {**ROUND, "mask": mask}
    base = solve(grey, **options)
    other = grey.copy()
    other[mask == 0] = 500.0
    other[:3] = -800.0
    result = solve(other, **options)
    for name in base:
        assert np.array_equal(result[name][mask > 0], base[name][mask > 0]), name
    assert not result["valid"][mask == 0].any()
    error = angle_between_axes(result["fibre_direction"][mask > 0], np.array([1, 2, 0.5]))
    assert np.median(error) < 3.0
