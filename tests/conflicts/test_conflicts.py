"""Needed braking and time margins of two vehicles, by hand."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from scex_sumo.conflicts.braking import MOST_MPS2
from scex_sumo.conflicts.pairs import Conflicts, find_conflicts, least_braking
from scex_sumo.scene import States

LENGTH, WIDTH = 4.5, 1.8
NOW, STEPS = 10, 41
STEP_S = 0.1
Motion = tuple[float, float, float, float, float]  # x, y, heading, speed now, acceleration


def driven(*vehicles: Motion) -> States:
    """Vehicles on straight lines, (1, T, V), from 1 s before the moment to 3 s after it."""
    x, y, heading, speed, acceleration = np.array(vehicles).T
    time = STEP_S * (np.arange(STEPS) - NOW)[:, None]
    rest = np.where(acceleration < 0, speed / np.maximum(-acceleration, 1e-9), np.inf)
    t = np.minimum(time, rest)
    way = speed * t + acceleration * t**2 / 2
    shape = np.ones((STEPS, len(x)))
    return States(
        x=(x + way * np.cos(heading))[None],
        y=(y + way * np.sin(heading))[None],
        heading=(heading * shape)[None],
        speed=np.maximum(speed + acceleration * t, 0.0)[None],
    )


def conflict(*vehicles: Motion) -> Conflicts:
    """The conflict of the first two vehicles."""
    size = np.full(len(vehicles), 1.0)
    found = find_conflicts(driven(*vehicles), LENGTH * size, WIDTH * size, now=NOW)
    return found.take((found.one == 0) & (found.two == 1))


@given(speed=st.floats(5.0, 30.0), gap=st.floats(40.0, 120.0))
def test_a_standing_obstacle_needs_the_speed_squared_over_twice_the_way(speed: float, gap: float) -> None:
    # It keeps its speed, so that the need grows; what lasts for 0.8 s is that of 2.2 s.
    later = gap - 2.2 * speed
    if gap < 3.1 * speed or 2 * later / speed > 7.5:  # reaches it, or stops later than vehicles look
        return
    found = conflict((0, 0, 0, speed, 0), (gap + LENGTH, 0, 0, 0, 0))
    assert found.braking[0] == pytest.approx(min(speed**2 / (2 * later), MOST_MPS2), rel=0.02)
    assert found.brakes_one[0] and found.meets_rad[0] == 0


@given(closing=st.floats(2.0, 10.0), gap=st.floats(30.0, 60.0))
def test_a_slower_leader_needs_the_closing_speed_squared_over_twice_the_gap(
    closing: float, gap: float
) -> None:
    found = conflict((0, 0, 0, 5 + closing, 0), (gap + LENGTH, 0, 0, 5, 0))
    later = gap - 2.2 * closing
    if gap < 3.1 * closing or 2 * later / closing > 7.5:  # reaches it, or avoided later than vehicles look
        return
    # The time of the least distance is looked for every 0.2 s.
    assert found.braking[0] == pytest.approx(closing**2 / (2 * later), rel=0.05)


def _hundredths(low: float, high: float) -> st.SearchStrategy[float]:
    return st.integers(round(100 * low), round(100 * high)).map(lambda count: count / 100)


_motion = st.tuples(
    *(_hundredths(low, high) for low, high in ((-15, 15), (-15, 15), (-3.1, 3.1), (0, 8), (-3, 2)))
)


@example(
    motions=[(0, 0, 0, 0, 0), (-4.9, -3.82, 1.71, 0, 0.02), (-7.6, 0.41, 1.85, 0.47, -0.78), (0, 0, 0, 0, 0)],
    reverses=[False, False, True, False],  # it ends on a sample of its path
)
@given(
    motions=st.lists(_motion, min_size=4, max_size=4),
    reverses=st.lists(st.booleans(), min_size=4, max_size=4),
)
def test_what_is_left_out_as_out_of_reach_needs_no_braking(
    motions: list[Motion], reverses: list[bool]
) -> None:
    states, size = driven(*motions), np.full(4, 1.0)
    backwards = np.array(reverses)
    turned = replace(
        states,
        heading=states.heading + np.where(backwards, np.pi, 0.0),
        speed=np.where(backwards, -states.speed, states.speed),
    )
    found = find_conflicts(turned, LENGTH * size, WIDTH * size, now=NOW)
    with pytest.MonkeyPatch.context() as patch:
        everything = lambda ways, shared, acceleration, steps: np.ones((len(shared.own), len(steps)), bool)  # noqa: E731
        patch.setattr("scex_sumo.conflicts.braking._in_reach", everything)
        whole = find_conflicts(turned, LENGTH * size, WIDTH * size, now=NOW)
    assert (found.braking == whole.braking).all() and (found.braking_step == whole.braking_step).all()


def test_behind_a_braking_leader_both_stop_in_time() -> None:
    found = conflict((0, 0, 0, 15, 0), (20 + LENGTH, 0, 0, 15, -5))
    # The leader needs 22.5 m to stop, so the follower has 42.5 m. 2.2 s later it has driven 33 m of these.
    assert found.braking[0] == pytest.approx(15**2 / (2 * (42.5 - 33)), rel=0.02)


def test_one_that_is_ahead_can_do_nothing_about_the_one_behind() -> None:
    swapped = conflict((30 + LENGTH, 0, 0, 0, 0), (0, 0, 0, 10, 0))
    assert not swapped.brakes_one[0] and swapped.braking[0] > 1


def test_two_that_face_each_other_both_brake() -> None:
    found = conflict((0, 0, 0, 10, 0), (100 + LENGTH, 0, np.pi, 10, 0))
    later = 100 - 2.2 * 20
    assert found.braking[0] == pytest.approx(200 / (2 * later), rel=0.02)
    assert found.meets_rad[0] == pytest.approx(np.pi)


def test_those_that_pass_beside_each_other_need_no_braking() -> None:
    found = conflict((0, 0, 0, 10, 0), (30, 3.5, np.pi, 10, 0))
    assert found.braking[0] == 0 and found.margin[0] == np.inf and np.isinf(found.meets_rad[0])
    assert found.gap[0] == pytest.approx(3.5 - WIDTH, abs=1e-6)


@pytest.mark.parametrize("behind_s", [0.2, 0.5, 1.0, 1.33])
def test_the_margin_is_the_time_between_leaving_and_entering(behind_s: float) -> None:
    speed = 10.0
    # The first one's rear leaves the common area at x = 0.9 m; the second one's front enters at y = -0.9 m.
    first = 5.0
    leaves_s = (first + WIDTH / 2 + LENGTH / 2) / speed
    way = (leaves_s + behind_s) * speed + WIDTH / 2 + LENGTH / 2
    found = conflict((-first, 0, 0, speed, 0), (0, -way, np.pi / 2, speed, 0))
    assert found.margin[0] == pytest.approx(behind_s, abs=1e-6)
    assert not found.later_one[0] and found.margin_step[0] == pytest.approx(10 * (leaves_s + behind_s), abs=1)
    assert found.braking[0] == 0


def test_two_that_reach_a_crossing_at_once_collide_and_either_may_brake() -> None:
    found = conflict((-25, 0, 0, 10, 0), (0, -25, np.pi / 2, 10, 0))
    assert found.gap[0] == 0 and found.braking[0] > 5


def test_a_need_that_lasts_shorter_than_it_takes_to_see_it_counts_for_nothing() -> None:
    moved = driven((0, 0, 0, 10, 0), (30, 0, 0, 10, 0))
    moved.speed[0, 20:23, 1] = 0.0  # noise of the leader's speed
    size = np.full(2, 1.0)
    assert find_conflicts(moved, LENGTH * size, WIDTH * size, now=NOW).braking[0] < 0.5


def test_least_braking_is_that_of_the_one_which_can() -> None:
    one = np.array([3.0, 3.0, MOST_MPS2, MOST_MPS2, 0.0])
    two = np.array([0.0, 2.0, 4.0, MOST_MPS2, MOST_MPS2])
    assert least_braking(one, two).tolist() == [3.0, 2.0, 4.0, MOST_MPS2, 0.0]


def test_a_vehicle_farther_away_changes_nothing_between_two_others() -> None:
    two = conflict((0, 0, 0, 12, 0), (40, 0, 0, 6, 0))
    three = conflict((0, 0, 0, 12, 0), (40, 0, 0, 6, 0), (0, 500, 0, 10, 0))
    for field in fields(Conflicts):
        assert np.array_equal(getattr(two, field.name), getattr(three, field.name)), field.name


def test_people_have_no_conflict_with_each_other() -> None:
    size, people = np.full(3, 1.0), np.array([False, True, True])
    states = driven((0, 0, 0, 10, 0), (20, 0, np.pi / 2, 1, 0), (20, 1, np.pi / 2, 1, 0))
    found = find_conflicts(states, LENGTH * size, WIDTH * size, now=NOW, people=people)
    assert sorted(zip(found.one.tolist(), found.two.tolist(), strict=True)) == [(0, 1), (0, 2)]
