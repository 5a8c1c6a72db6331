"""Critical response: the oracles with closed forms, and a point mass of actions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import norm

from scex_sumo.certainty.response import critical
from scex_sumo.certainty.response.critical import DECELERATIONS, critical_response, hard_contact
from scex_sumo.certainty.response.motion import actions
from scex_sumo.certainty.response.motion.actions import (
    ACTIONS,
    BRAKES,
    CUTS_IN,
    DRIFTS,
    GOES_ON,
    GRAZE_M,
    SHOWN_M,
    STEPS_AT_S,
    STEPS_OUT,
    cases_of,
    contexts,
    pairs_of,
)
from scex_sumo.certainty.response.motion.blocked import Blocked
from scex_sumo.certainty.response.motion.expected import with_people
from scex_sumo.certainty.response.people import people_of, probabilities
from tests.certainty.response.scenes import LENGTH, PERSON_M, WIDTH, beside, cases, steady

BISECTED_S = 0.05
RAMP_S = [a / critical.JERK_MPS3 / 2 for a in DECELERATIONS]
"""A ramp of the deceleration costs half of its duration, up to a small term of the way in it."""


@pytest.fixture
def no_ramp(monkeypatch: pytest.MonkeyPatch) -> None:
    """Braking begins with its full deceleration, as in the closed forms."""
    monkeypatch.setattr(critical, "JERK_MPS3", 1e6)


@pytest.mark.usefixtures("no_ramp")
@pytest.mark.parametrize(("speed", "gap"), [(10.0, 10.0), (15.0, 12.0), (20.0, 35.0)])
def test_a_follower_that_brakes_as_hard_as_its_leader_has_its_time_gap(speed: float, gap: float) -> None:
    found = critical_response(cases(steady((0, 0, 0, speed), (gap + LENGTH, 0, 0, speed)), BRAKES))
    four, six = 4, 6  # index of the leader's 4 m/s² and 6 m/s²
    assert found[four, 0] == pytest.approx(gap / speed, abs=BISECTED_S)
    assert found[six, 1] == pytest.approx(gap / speed, abs=BISECTED_S)


@pytest.mark.usefixtures("no_ramp")
@pytest.mark.parametrize("level", [3, 5, 8])
def test_a_leader_that_brakes_to_rest_leaves_its_braking_way_besides(level: int) -> None:
    speed, gap = 12.0, 10.0
    tested = cases(steady((0, 0, 0, speed), (gap + LENGTH, 0, 0, speed)), BRAKES)
    strength = tested.value[level]
    for column, own in enumerate(DECELERATIONS):
        if own >= strength:  # contact while both move: the least gap is when both are equally fast
            reach = _moving(speed, gap, strength, own)
        else:
            reach = (gap + speed**2 / (2 * strength) - speed**2 / (2 * own)) / speed
        assert critical_response(tested)[level, column] == pytest.approx(reach, abs=0.06)


def _moving(speed: float, gap: float, leader: float, own: float) -> float:
    """Largest r without contact by the closed form of both motions, on a fine grid of time."""
    time = np.arange(0, 12, 1e-3)

    def way(a: float, r: float) -> np.ndarray:
        braking = np.clip(time - r, 0, speed / a)
        return speed * np.minimum(time, r) + speed * braking - a * braking**2 / 2

    tries = np.arange(0, 4, 0.005)
    free = [r for r in tries if (gap + way(leader, 0) - way(own, r) > 0).all()]
    return float(max(free))


@pytest.mark.usefixtures("no_ramp")
def test_a_standing_obstacle_leaves_s_over_v_less_the_braking_time() -> None:
    # An initiator that brakes with 9 m/s² from 0.6 m/s stands at once.
    speed, gap = 10.0, 30.0
    found = critical_response(cases(steady((0, 0, 0, speed), (gap + LENGTH, 0, 0, 0.6)), BRAKES))[-1]
    expected = [(gap + 0.6**2 / 18) / speed - speed / (2 * a) for a in DECELERATIONS]
    assert found == pytest.approx(expected, abs=BISECTED_S)


def test_the_ramp_of_a_response_costs_half_its_time() -> None:
    speed, gap = 10.0, 30.0
    found = critical_response(cases(steady((0, 0, 0, speed), (gap + LENGTH, 0, 0, 0.6)), BRAKES))[-1]
    expected = [gap / speed - speed / (2 * a) - r for a, r in zip(DECELERATIONS, RAMP_S, strict=True)]
    assert found == pytest.approx(expected, abs=0.07)


@pytest.fixture
def no_graze(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(actions, "GRAZE_M", 0.0)


@pytest.mark.usefixtures("no_ramp", "no_graze")
def test_a_crossing_is_occupied_as_long_as_the_other_needs_to_pass() -> None:
    # The initiator waits 20 m before the crossing; if it goes on with 8 m/s, it occupies it from 17/8 s on.
    scene = steady((-30, 0, 0, 10), (0, -20, math.pi / 2, 8), waits=(1,))
    tested = cases(scene, GOES_ON)
    edge = 30 - LENGTH / 2 - WIDTH / 2
    enters = (20 - LENGTH / 2 - WIDTH / 2) / 8
    leaves = (20 + LENGTH / 2 + WIDTH / 2) / 8
    assert tested.value[0] == 0.0
    # At 10 m/s it would be there at 2.7 s, between both times: it has to arrive later than `leaves`.
    assert enters < edge / 10 < leaves
    onset = (20 - LENGTH / 2 - WIDTH / 2 - 8**2 / 6) / 8
    assert tested.onset_s[0] == pytest.approx(onset, abs=0.2)  # place and time are those of whole steps
    for column, own in enumerate(DECELERATIONS):
        tries = np.arange(0, 3, 1e-3)
        braking = np.clip(leaves - tries, 0, 10 / own)
        latest = tries[10 * np.minimum(tries, leaves) + 10 * braking - own * braking**2 / 2 <= edge].max()
        found = critical_response(tested)[0, column]
        assert found + tested.onset_s[0] == pytest.approx(latest, abs=0.1)


def test_one_that_cuts_in_leaves_less_time_the_closer_it_is() -> None:
    near, far = (
        critical_response(cases(steady((0, 0, 0, 15), (gap + LENGTH, 3.5, 0, 8)), CUTS_IN))[5, 1]
        for gap in (12.0, 25.0)
    )
    assert near < far < np.inf


def test_drifting_from_the_opposing_lane_is_hopeless_late_and_none_without_contact() -> None:
    found = critical_response(cases(steady((0, 0, 0, 15), (60, 3.5, math.pi, 15)), DRIFTS))
    assert (found == np.inf).any() and (found[np.isfinite(found)] < 3).all()


@pytest.mark.usefixtures("no_ramp")
@pytest.mark.parametrize(("level", "ahead"), [(0, 20.0), (3, 26.0), (8, 15.0)])
def test_one_stops_before_a_person_that_steps_out(level: int, ahead: float) -> None:
    speed, aside = 8.0, 3.0
    tested = cases(with_people(beside(steady((0, 0, 0, speed)), (ahead, aside, 0.0))), STEPS_OUT)
    found = critical_response(tested)
    walk = ACTIONS[STEPS_OUT].values[level]
    onset = STEPS_AT_S[level] + SHOWN_M / walk
    assert tested.onset_s[level] == pytest.approx(onset)
    # Contact if it is there before the person has crossed: it has to stop in time, or to pass before.
    edge = ahead - LENGTH / 2 - PERSON_M / 2
    half = (WIDTH - GRAZE_M + PERSON_M) / 2
    enters, leaves = (STEPS_AT_S[level] + (aside + sign * half) / walk for sign in (-1, 1))
    passes = (ahead + LENGTH / 2 + PERSON_M / 2) / speed
    assert passes > enters and edge / speed < leaves
    for column, own in enumerate(DECELERATIONS):
        tries = np.arange(0, 4, 1e-3)
        begins = onset + tries
        braking = np.clip(leaves - begins, 0, speed / own)
        reach = speed * np.minimum(begins, leaves) + speed * braking - own * braking**2 / 2
        assert found[level, column] == pytest.approx(tries[reach <= edge].max(), abs=0.1)


def test_a_person_in_the_lane_or_far_from_it_does_not_step_out() -> None:
    scene = with_people(beside(steady((0, 0, 0, 8)), (20, 0.5, 0), (20, 7, 0), (-5, 3, 0), (25, 3, 0)))
    found = cases_of(pairs_of(scene))
    assert set(found.pairs.initiator[found.pair].tolist()) == {4}
    assert set(found.action.tolist()) == {STEPS_OUT}


def test_a_person_approaches_that_walks_towards_the_line() -> None:
    scene = with_people(beside(steady((0, 0, 0, 8)), (20, 3, -math.pi / 2, 1.0), (20, -3, -math.pi / 2, 1.0)))
    pairs = pairs_of(scene)
    assert contexts(pairs)[pairs.initiator == 1].all()
    assert not contexts(pairs)[pairs.initiator == 2].any()


def test_who_grazes_by_less_than_lines_are_known_does_not_touch() -> None:
    near = steady((0, 0, 0, 15), (16, WIDTH - GRAZE_M / 2, 0, 15))
    assert not len(cases(near, BRAKES))


def test_a_hard_impact_takes_a_later_response() -> None:
    tested = cases(steady((0, 0, 0, 15), (16, 0, 0, 15)), BRAKES)
    assert (critical_response(tested, hard_contact) >= critical_response(tested) - BISECTED_S).all()


def test_a_vehicle_behind_is_no_initiator_of_braking() -> None:
    found = cases_of(pairs_of(steady((0, 0, 0, 15), (20, 0, 0, 15))))
    assert found.pairs.initiator[found.pair].tolist() == [1] * 10


def test_a_point_mass_and_a_lognormal_response_have_a_closed_form() -> None:
    people = dataclasses.replace(people_of(), away_share=0.0, growth=0.0, close_response=0.0)
    often = np.array([[1.0] * 6 + [0.0] * 4])
    response = np.full((1, 10), 2.0)
    late = people.later(response, np.zeros((1, 10), dtype=int), np.full((1, 10), 2.0), np.ones((1, 10)))
    expected = 1 - norm.cdf((math.log(2.0) - math.log(people.response_s[0])) / people.response_spread)
    assert probabilities(often, late, np.zeros(1, dtype=int)) == pytest.approx(expected, abs=1e-8)


def test_probability_is_exact_for_a_line_and_an_exponential() -> None:
    values = np.arange(10.0)
    often, late = np.exp(-values)[None], (values / 20)[None]
    # ∫ exp(-x) x / 20 dx from 0 to 9, and the rest of the mass at 9
    expected = (1 - 10 * math.exp(-9)) / 20 + math.exp(-9) * 9 / 20
    assert probabilities(often, late, np.zeros(1, dtype=int)) == pytest.approx(expected, rel=1e-9)


def test_other_actions_have_the_lower_value_of_each_step() -> None:
    often, late = np.linspace(0.1, 0.01, 10)[None], np.array([[0.0, 1.0] * 5])
    assert probabilities(often, late, np.ones(1, dtype=int)) == pytest.approx(4 * 0.01 + 0.01)


def test_no_response_is_certain_and_never_too_late() -> None:
    people = people_of()
    given = np.array([-np.inf, 0.0, 1.0, 3.0, np.inf])
    late = people.later(given, np.zeros(5, dtype=int), np.full(5, 1.0), np.ones(5))
    assert late[0] == 1 and late[-1] == 0 and (np.diff(late) <= 0).all()


def test_a_line_that_comes_back_to_the_same_place_is_not_blocked_all_the_way() -> None:
    """In a roundabout: 78 m ahead first, then 22 m behind, which the vehicle at 1 m has passed long ago."""
    s = np.array([[0.7, 0.83]])
    jumps = Blocked(enter=np.array([[78.0, -22.0]]), leave=np.array([[88.0, -6.5]]))
    assert not jumps.touches(s).any()
    fast = Blocked(enter=np.array([[0.75, -0.5]]), leave=np.array([[2.0, 0.8]]))  # through it in one step
    assert fast.touches(s).any()
