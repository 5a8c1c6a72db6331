"""Futures of a case: people collide as often as critical responses say, and draws are those of the suite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.response.answer import any_of, critical_responses
from scex_sumo.certainty.response.critical import DECELERATIONS
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.scene import SceneHistory, VehicleIndex
from scex_sumo.suites.simulate import FewFutures, Outcomes, draws_of, simulate
from scex_sumo.suites.situation import STEPS, Situation, situation_of
from scex_sumo.suites.testing.tasks import by_level, expected_contacts, record_of, touch_and_go
from tests.queues import queues


@pytest.fixture(scope="module")
def following() -> Situation:
    return situation_of(queues(2, gap_m=9.0, speed=12.0), 1, 2)


def run(situation: Situation, model: str, futures: int = 64, seed: int = 0) -> Outcomes:
    (spec,) = parse_models(model)
    return simulate(situation, spec, futures, seed=seed)


def test_people_collide_as_critical_responses_say(following: Situation) -> None:
    rows = critical_responses(queues(2, gap_m=9.0, speed=12.0)).to_pylist()
    own = [row["probability"] for row in rows if (row["track_id"], row["other_id"]) == (1, 2)]
    assert following.human_like == pytest.approx(any_of(own), rel=1e-9)


def test_the_human_like_driver_under_test_collides_as_often(following: Situation) -> None:
    """Steps of 0.1 s and R* to 0.05 s decide contacts otherwise at the edge: 15 %."""
    found = []
    for seed in range(3):
        outcomes = run(following, "likely_driver", seed=seed)
        shares = by_level(following, outcomes.draws.weight * outcomes.hit, outcomes.draws.row)
        found.append(following.probability(shares))
    assert np.mean(found) == pytest.approx(following.human_like, rel=0.15)


def test_draws_do_not_depend_on_the_function(following: Situation) -> None:
    one, other = (run(following, name) for name in ("constant_velocity", "standard_driver"))
    assert one.draws.row.tolist() == other.draws.row.tolist()
    assert np.array_equal(one.draws.route, other.draws.route)
    again = run(following, "constant_velocity")
    assert np.array_equal(one.states.x, again.states.x)


def test_a_driver_in_few_futures_plans_as_among_all() -> None:
    scene, rng = queues(2, gap_m=9.0, speed=12.0), np.random.default_rng(0)
    assert scene.road is not None
    draw, states = rng.random((3, 2)), scene.history.repeat(3)
    history = SceneHistory(scene=scene, states=states, futures=np.arange(3), step=0, route_draw=draw)
    who = VehicleIndex(future=np.array([2, 0]), vehicle=np.array([0, 1]))
    driver = build(parse_models("likely_driver")[0])
    plans = [d.plan(history, scene.road, who, [rng] * 3) for d in (driver, FewFutures(driver))]
    assert np.array_equal(plans[0].x, plans[1].x) and np.array_equal(plans[0].speed, plans[1].speed)


def test_the_initiator_acts_and_a_function_that_goes_on_hits_it(following: Situation) -> None:
    outcomes = run(following, "constant_velocity")
    acts = outcomes.draws.row >= 0
    assert (~acts).sum() == 16
    assert outcomes.hit[acts].all()
    assert not outcomes.hit[~acts].any()
    hard = outcomes.draws.row == following.levels - 1  # brakes with 9 m/s²: gap 9 m, so √(2·9/9) s
    assert outcomes.contact_s[hard] == pytest.approx(np.sqrt(2.0), abs=0.1)
    assert outcomes.closing_mps[hard] == pytest.approx(9 * np.sqrt(2.0), abs=1.0)
    assert following.injuries(outcomes.closing_mps)[hard].min() > 0


def test_a_driver_that_brakes_hits_less(following: Situation) -> None:
    going, braking = (
        record_of(following, run(following, m)) for m in ("constant_velocity", "standard_driver")
    )
    assert braking["probability"] < going["probability"]
    assert braking["chance"]["more"] > going["chance"]["more"]
    assert going["severity"] > braking["severity"] >= 0


def test_parts_of_the_response_times_have_the_whole_probability(following: Situation) -> None:
    draws = draws_of(following, 64, seed=0, human_like=True)
    for row in range(following.levels):
        own = draws.row == row
        assert draws.weight[own].sum() == pytest.approx(1.0)
        assert draws.high[own].max() == 1.0
        assert draws.low[own].min() == 0.0
    assert set(draws.braking.tolist()) == set(range(len(DECELERATIONS)))
    late = (following.late.ravel()[draws.row] * (draws.row >= 0)).sum()
    assert late > 0


def test_expected_contacts_of_people_are_those_of_the_map(following: Situation) -> None:
    outcomes = run(following, "constant_velocity")
    typical = outcomes.draws.row < 0
    expected = expected_contacts(following, outcomes)
    assert expected[~typical] == pytest.approx(following.late.ravel()[outcomes.draws.row[~typical]])


def test_people_are_equal_to_people_where_nobody_can_respond_in_time() -> None:
    situation = situation_of(queues(2, gap_m=1.0, speed=12.0), 1, 2)
    assert (situation.late == 1).any()
    record = record_of(situation, run(situation, "likely_driver"))
    assert min(record["chance"].values()) > 0.05
    assert record["people_contacts"] == pytest.approx(record["contacts"], abs=4)


def test_people_that_pass_within_10_cm_may_as_well_touch(following: Situation) -> None:
    outcomes = run(following, "likely_driver")
    misses = replace(
        outcomes, contact_s=np.full(len(outcomes.hit), np.inf), gap_m=np.full(len(outcomes.hit), 0.09)
    )
    people = (outcomes.draws.row >= 0) & (outcomes.draws.high - outcomes.draws.low < 1)
    assert touch_and_go(following, misses).tolist() == people.tolist()
    far = touch_and_go(following, replace(misses, gap_m=misses.gap_m + 0.1))
    assert far.sum() < people.sum()


def test_a_pair_without_an_action_is_one_line() -> None:
    scene = queues(2, gap_m=9.0, speed=12.0)
    with pytest.raises(UsageError, match="no vehicle 7 in the seed scene"):
        situation_of(scene, 1, 7)
    far = replace(scene, history=replace(scene.history, y=scene.history.y + np.array([[0.0], [500.0]])))
    with pytest.raises(UsageError, match="can do nothing that concerns"):
        situation_of(far, 1, 2)


def test_all_steps_are_simulated(following: Situation) -> None:
    assert run(following, "constant_velocity").states.shape == (64, 2, STEPS + 1)
