"""Which tools close on a charge, and when one has lost it: in the record alone, without a flow."""

import numpy as np
import pytest

from ppmc.solver.run.coverage import LET_GO, LOST_WAY, Coverage
from ppmc.solver.step.model import Touched

DOWN, UP = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
REST = np.zeros(3)


def record(*tools):
    """Record of tools that press in given directions, by forces of given size, each covered by 64 mm^2."""
    out = Coverage(len(tools), 1e-6)
    force = -np.array([size * np.asarray(direction) for direction, size in tools])
    out.add(0.1, np.full(len(tools), 64.0), force, np.zeros(len(tools)), 0.1)
    return out


def closing(out, *velocities):
    return out.closing(np.array(velocities))


def test_a_ram_and_what_it_presses_against_close():
    plates = record((UP, 100.0), (DOWN, 100.0))
    np.testing.assert_allclose(closing(plates, REST, 3.0 * DOWN), [3.0, 3.0])


def test_both_may_move():
    plates = record((UP, 100.0), (DOWN, 100.0))
    np.testing.assert_allclose(closing(plates, UP, 3.0 * DOWN), [4.0, 4.0])
    np.testing.assert_array_equal(closing(plates, 2.0 * DOWN, 2.0 * DOWN), [0.0, 0.0])


def test_a_tool_that_parts_or_rests_is_not_judged():
    plates = record((UP, 100.0), (DOWN, 100.0))
    np.testing.assert_array_equal(closing(plates, REST, 3.0 * UP), [0.0, 0.0])
    np.testing.assert_array_equal(closing(plates, REST, REST), [0.0, 0.0])


def test_side_walls_and_what_hardly_bears_are_not_judged():
    tools = record((UP, 100.0), (DOWN, 100.0), ([1.0, 0.0, 0.0], 80.0), (UP, 10.0))
    np.testing.assert_allclose(closing(tools, REST, 3.0 * DOWN, REST, REST), [3.0, 3.0, 0.0, 0.0])


@pytest.mark.parametrize("angle", [10.0, 30.0, 50.0])
def test_an_oblique_ram_closes_at_its_speed_along_the_push(angle):
    a = np.radians(angle)
    push = np.array([np.sin(a), 0.0, -np.cos(a)])
    tools = record((-push, 100.0), (push, 100.0))
    np.testing.assert_allclose(closing(tools, REST, 3.0 * DOWN), 3.0 * np.cos(a))


def test_a_plate_that_slides_does_not_close():
    tools = record((UP, 100.0), (DOWN, 100.0))
    np.testing.assert_array_equal(closing(tools, REST, [5.0, 0.0, 0.0]), [0.0, 0.0])


def test_a_ram_that_nothing_opposes_closes():
    np.testing.assert_allclose(closing(record((DOWN, 100.0)), 3.0 * DOWN), [3.0])


def test_a_tool_that_never_touched_is_not_judged():
    out = Coverage(2, 1e-6)
    np.testing.assert_array_equal(closing(out, REST, DOWN), [0.0, 0.0])
    assert np.isnan(out.share(np.zeros(2), np.ones(2))).all()


def test_a_charge_is_lost_once_its_tools_have_closed_uncovered_for_a_part_of_a_spacing():
    plates = record((UP, 100.0), (DOWN, 100.0))
    speed, few = np.full(2, 2.0), np.array([0.9, 2.0]) * LET_GO * 64.0
    steps = int(np.ceil(LOST_WAY / (2.0 * 0.01)))
    for k in range(steps):
        assert len(plates.lost(1.0)) == 0
        plates.add(0.2 + 0.01 * k, few, np.zeros((2, 3)), speed, 0.01)
    plates.add(0.9, few, np.zeros((2, 3)), speed, 0.01)
    assert plates.lost(1.0).tolist() == [0]
    assert plates.since[0] == 0.2
    assert plates.share(few, speed)[0] == pytest.approx(0.9 * LET_GO)
    # One step in which it is covered again, or parts, and the record starts anew.
    plates.add(1.0, np.full(2, 64.0), np.zeros((2, 3)), speed, 0.01)
    assert len(plates.lost(1.0)) == 0


def test_the_direction_is_that_of_the_fullest_contact():
    out = record((DOWN, 100.0), (UP, 100.0))
    sideways = np.array([[50.0, 0.0, 0.0], [-50.0, 0.0, 0.0]])
    out.add(0.2, np.array([20.0, 20.0]), sideways, np.zeros(2), 0.1)
    np.testing.assert_allclose(out.direction, [DOWN, UP])


def test_only_faces_that_look_where_a_tool_presses_cover_it():
    """A pin under a ram: its top counts, its sides do not; a plate that has not pressed yet presses by its force."""
    tools = record((UP, 100.0), (DOWN, 100.0))
    normal = np.array([UP, [1.0, 0.0, 0.0], [0.0, 0.6, 0.8], DOWN])
    faces = Touched(np.array([0, 0, 0, 1], dtype=np.int32), normal, np.array([1.0, 2.0, 4.0, 8.0]))
    np.testing.assert_array_equal(tools.cover(faces, np.zeros((2, 3))), [5.0, 8.0])
    np.testing.assert_array_equal(Coverage(2, 1e-6).cover(faces, np.array([DOWN, UP])), [5.0, 8.0])
    np.testing.assert_array_equal(Coverage(2, 1e-6).cover(faces, np.zeros((2, 3))), [0.0, 0.0])


def test_a_force_that_turns_round_does_not_turn_the_tool():
    """Forces of a stiff charge may be noise: a pull says nothing of where a tool presses, and the cover goes on."""
    tools = record((UP, 100.0), (DOWN, 100.0))
    pulled = np.array([UP, DOWN]) * 50.0
    tools.add(0.3, np.full(2, 80.0), pulled, np.full(2, 2.0), 0.1)
    np.testing.assert_allclose(tools.direction, [UP, DOWN])
    faces = Touched(np.array([0, 1], dtype=np.int32), np.array([UP, DOWN]), np.array([3.0, 4.0]))
    np.testing.assert_array_equal(tools.cover(faces, pulled), [3.0, 4.0])


def test_a_tool_that_lifts_and_comes_back_has_lost_nothing():
    tools = record((UP, 100.0), (DOWN, 100.0))
    tools.add(0.3, np.zeros(2), np.zeros((2, 3)), np.zeros(2), 0.1)  # it parts: nothing closes
    for k in range(20):
        tools.add(0.4 + 0.1 * k, np.zeros(2), np.zeros((2, 3)), np.full(2, 2.0), 0.1)  # through the air
    assert len(tools.lost(1.0)) == 0
    assert np.isnan(tools.share(np.zeros(2), np.full(2, 2.0))).all()
