"""Room to react: obstacles that stand, come, or cross, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scex_sumo.certainty.response.room import (
    needed_braking,
    needed_swerve,
    time_to_brake,
    time_to_react,
    time_to_steer,
)
from tests.certainty.response.meetings import LENGTH, WIDTH, meeting, states

GRID_S = 0.02  # contact is looked for at these times


@pytest.mark.parametrize(("gap", "speed"), [(30.0, 12.0), (10.0, 8.0), (45.0, 20.0)])
def test_a_standing_obstacle_needs_v2_over_2s(gap: float, speed: float) -> None:
    met = meeting(states(0, 0, 0, speed), states(gap + LENGTH, 0, 0, 0))
    assert needed_braking(met) == pytest.approx(speed**2 / (2 * gap), rel=1e-3)
    assert time_to_brake(met) == pytest.approx(gap / speed - speed / 16, abs=1e-2)


def test_a_swerve_past_a_standing_obstacle_takes_both_half_widths() -> None:
    gap, speed, beside = 30.0, 12.0, 0.5
    met = meeting(states(0, 0, 0, speed), states(gap + LENGTH, beside, 0, 0))
    aside, until = WIDTH - beside, gap / speed  # to the right
    assert time_to_steer(met) == pytest.approx(until - math.sqrt(2 * aside / 7), abs=GRID_S)
    assert needed_swerve(met) == pytest.approx(2 * aside / until**2, rel=3 * GRID_S / until)
    assert time_to_react(met) == np.maximum(time_to_brake(met), time_to_steer(met))


def test_no_swerve_helps_without_room() -> None:
    met = meeting(states(0, 0, 0, 12), states(34, 0.5, 0, 0), room=1.0)
    assert np.isinf(needed_swerve(met)) and time_to_steer(met) == -np.inf
    assert time_to_react(met) == time_to_brake(met)


def test_braking_does_not_stop_one_that_comes() -> None:
    met = meeting(states(0, 0, 0, 10), states(54, 0, math.pi, 15))
    assert np.isinf(needed_braking(met)) and time_to_brake(met) == -np.inf
    until = 50 / 25
    assert time_to_steer(met) == pytest.approx(until - math.sqrt(2 * WIDTH / 7), abs=GRID_S)
    assert time_to_react(met) == time_to_steer(met)


def test_one_that_crosses_needs_a_stop_before_its_side_or_a_later_arrival() -> None:
    # The other one occupies the way from 2.7 s to 3.3 s: half lengths and half widths are 2 m and 1 m.
    met = meeting(states(-30, 0, 0, 10), states(0, -30, math.pi / 2, 10))
    before = 30 - WIDTH / 2 - LENGTH / 2
    leaves = (30 + LENGTH / 2 + WIDTH / 2) / 10
    # Arriving at the edge when the other has left: before = v t - a t² / 2.
    expected = 2 * (10 * leaves - before) / leaves**2
    assert needed_braking(met) == pytest.approx(expected, rel=0.03)
    assert time_to_brake(met) == pytest.approx(_latest_braking(before, leaves, 10.0), abs=GRID_S)


def _latest_braking(before: float, leaves: float, speed: float) -> float:
    # Brakes with 8 m/s² from t on, so that it has driven `before` when the other leaves: or stops.
    tries = np.arange(0, 3, 1e-3)
    braking = np.minimum(leaves - tries, speed / 8)
    driven = speed * tries + speed * braking - 4 * braking**2
    return float(tries[driven <= before].max())


def test_nothing_is_needed_where_nothing_is_met() -> None:
    met = meeting(states(0, 0, 0, 10), states(30, 5, 0, 0))
    for measure in (needed_braking, needed_swerve, time_to_brake, time_to_steer, time_to_react):
        assert np.isnan(measure(met))


def test_a_faster_leader_needs_nothing_and_a_slower_one_the_difference() -> None:
    assert np.isnan(needed_braking(meeting(states(0, 0, 0, 10), states(14, 0, 0, 11))))
    met = meeting(states(0, 0, 0, 15), states(24, 0, 0, 5))
    assert needed_braking(met) == pytest.approx(10**2 / (2 * 20), rel=1e-2)
