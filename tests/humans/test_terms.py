"""Terms of the human-like driver, each by hand, and their combination."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.behaviors.models.idm import IdmParameters, idm_acceleration
from scex_sumo.humans import parameters, terms
from scex_sumo.humans.parameters import HumanParameters, human_parameters, simulated
from scex_sumo.humans.terms import Drivers, Expectation, Situation, Trailers

HUMAN = human_parameters()


def situation(speed: list[float], *, expects: dict[str, Any] | None = None, **given: Any) -> Situation:
    """Drivers at a speed that they showed, at the limit of 20 m/s; values of drivers and steps as given."""
    v = np.array(speed)
    own = {field.name for field in fields(Drivers)} & set(given)
    driver = {"acceleration": 0 * v, "headway": 0 * v + 0.5, "braking": 0 * v + 1.2}
    driver |= {name: given.pop(name) for name in own}
    return Situation(
        driver=Drivers(speed=v, **driver),
        expects=Expectation(headway=0 * v + 0.5, **(expects or {})),
        speed=v,
        limit=0 * v + 20.0,
        **given,
    )


def test_at_the_limit_nobody_accelerates_and_a_standing_vehicle_fully() -> None:
    # The motion of a standing vehicle is no habit: it aims at the limit at once.
    assert terms.free(situation([20.0, 0.0]), HUMAN) == pytest.approx([0.0, 1.61], abs=0.1)


def test_a_driver_at_the_limit_of_a_turn_speeds_up_to_that_of_the_road_behind_it() -> None:
    # 10 m/s in the seed scene: below a limit of 20 that is a habit, at a limit of 10 it is not.
    habit, turned = (terms.free(situation([10.0], limit=np.full(1, there)), HUMAN) for there in (20.0, 10.0))
    assert habit == pytest.approx(0.0, abs=0.3)
    assert turned == pytest.approx(1.61 * (1 - 0.5**4), abs=0.1)


def test_drivers_of_sumo_start_as_fast_as_its_default_type() -> None:
    assert terms.free(situation([0.0]), simulated(HUMAN)) == pytest.approx([2.6])


def test_nobody_brakes_much_harder_for_a_leader_than_it_takes() -> None:
    # Near at the same speed; near and closing by 4 m/s; far; about to hit, where it takes more.
    speed, gap, leader = [14.0] * 4, np.array([5.0, 9.0, 200.0, 3.0]), np.array([14.0, 10.0, 10.0, 2.0])
    asked = terms.following(situation(speed, gap=gap, leader_speed=leader), HUMAN)
    profile = IdmParameters.of(HUMAN.idm, time_headway=np.full(4, 0.5), comfort_deceleration=np.full(4, 1.2))
    formula = idm_acceleration(profile, np.array(speed), np.full(4, np.inf), gap, leader)
    harder = -((speed - leader) ** 2) / (2 * (gap - HUMAN.idm.minimum_gap)) - asked
    assert (harder[:2] > 0).all() and (harder[:2] <= HUMAN.extra_braking_mps2).all()
    assert (asked[:2] > formula[:2]).all()
    assert asked[2] > 0 and asked[3] == -HUMAN.idm.max_deceleration


def test_a_driver_that_looks_away_does_not_follow_and_does_not_speed_up_towards_its_leader() -> None:
    now = situation([10.0] * 3, gap=np.array([5.0, 5.0, 80.0]), aware=np.array([True, False, False]))
    assert np.isfinite(terms.following(now, HUMAN)).tolist() == [True, False, False]
    assert terms.looking_away(now, HUMAN).tolist() == [4.0, 0.0, 4.0]


def test_before_a_curve_drivers_brake_gently() -> None:
    now = situation([15.0, 5.0], curve_speed=np.array([5.0, 5.4]))
    assert terms.curve(now, HUMAN) == pytest.approx([-HUMAN.idm.comfort_deceleration, 0.5])


def test_shown_accelerations_fade() -> None:
    now = situation([10.0], habit=1.0, sudden=1.0, plan_step=5, step=2)
    assert terms.habit(now, HUMAN) == pytest.approx(np.exp(-0.7 / HUMAN.habit_s))
    assert terms.sudden(now, HUMAN) == pytest.approx(np.exp(-0.7 / HUMAN.sudden_s))


def test_variation_is_linear_between_its_times_and_none_of_a_waiting_vehicle() -> None:
    drawn = np.array([[0.0, 3.0, 1.0], [0.0, 3.0, 1.0]])
    now = situation([10.0, 0.0], variation=drawn, expects={"waits_s": np.array([0.0, 0.1])}, step=5)
    assert terms.variation(now, HUMAN) == pytest.approx([1.0, 0.0])


def test_a_driver_that_must_brake_adds_no_acceleration() -> None:
    asked = np.array([0.0, -1.5, -3.0, -3.0])
    assert terms.relieved(np.array([1.0, 1.0, 1.0, -1.0]), asked, HUMAN).tolist() == [1.0, 0.5, 0.0, -1.0]


def test_a_creeping_vehicle_stops_in_its_time() -> None:
    now = situation([2.0, 2.0], stop_s=np.array([4.0, np.inf]))
    assert terms.stopping(now, HUMAN).tolist() == [-0.5, np.inf]
    assert terms.stopping(replace(now, plan_step=40), HUMAN).tolist() == [np.inf, np.inf]


def test_a_standing_vehicle_crawls_but_not_into_its_leader() -> None:
    now = situation([0.1, 0.1], crawl=0.3, rest=1.0, gap=np.array([5.0, 0.9]))
    assert terms.standing(now, HUMAN) == pytest.approx([0.4, -0.2])


def test_drivers_come_to_rest_at_their_own_gap_however_eager_they_are() -> None:
    # 2 m/s, 3 m behind a standing leader: to rest 2 m behind it takes 2 m/s²; 0.5 m behind it, no
    # noticeable braking; 3.5 m behind it, the approach ends.
    rest = np.array([2.0, 0.5, 3.5])
    now = situation([2.0] * 3, rest=rest, gap=3.0, variation=np.full((3, 3), 5.0))
    assert terms.resting(now, HUMAN) == pytest.approx([-2.0, np.inf, -4.0])
    assert (terms.acceleration(now, HUMAN) <= [-2.0, 4.0, -4.0]).all()
    follows = situation([2.0] * 3, rest=rest, gap=3.0, leader_speed=2.0)
    assert np.isinf(terms.resting(follows, HUMAN)).all()


def test_trailers_keep_the_gap_to_their_leaders() -> None:
    # The second is towed by the first, the third by a vehicle that plans elsewhere and brakes with 1 m/s².
    tow = Trailers(
        row=np.array([1, 2]), leader=np.array([0, -1]), gap=np.array([0.6, 0.5]), drawbar=np.full(2, 0.5)
    )
    now = situation([10.0] * 3, expects={"acceleration": -1.0, "speed": 10.0, "trailers": tow})
    assert terms.towed(np.array([0.7, 4.0, 4.0]), now) == pytest.approx([0.7, 0.8, -1.0])


def test_a_leader_is_expected_to_go_on_braking_but_not_to_reverse() -> None:
    expects = Expectation(headway=np.full(2, 0.5), gap=20.0, speed=np.array([10.0, 1.0]), slowing=-2.0)
    gap, speed = expects.leader(10, 0.0, HUMAN)
    assert speed == pytest.approx([10.0 - 2.0 * (1.0 + HUMAN.anticipation_s), 0.0])
    assert gap == pytest.approx([20.0 + 10.0 - 4.0 / 2, 20.0 + 1.0 - 1.0 / 2])


def test_the_least_demand_counts_and_the_own_accelerations_are_added_within_limits() -> None:
    habit, waits = np.array([1.0, -9.0, 9.0, 1.0]), {"waits_s": np.array([0.0, 0.0, 0.0, 9.0])}
    now = situation([20.0, 20.0, 20.0, 0.0], habit=habit, expects=waits)
    asked = terms.demanded(now, HUMAN)
    assert (asked == np.minimum(terms.free(now, HUMAN), terms.curve(now, HUMAN))).all()
    assert terms.acceleration(now, HUMAN) == pytest.approx([asked[0] + 1.0, -4.0, 4.0, 0.0])


def test_every_parameter_has_a_unit_a_meaning_and_a_source() -> None:
    text = Path(parameters.__file__).read_text(encoding="utf-8")
    for field in fields(HumanParameters):
        (line,) = [line for line in text.splitlines() if line.startswith(f"    {field.name}: ")]
        unit, meaning, source = line.split("  # ")[1].split(" | ")
        assert unit and meaning and any(word in source for word in ("chosen", "fitted", "20")), line


def test_a_file_can_set_any_number(tmp_path: Path) -> None:
    file = tmp_path / "parameters.json"
    file.write_text(parameters.SHIPPED.read_text().replace("{", '{"glance_s": 1.5,', 1))
    assert HumanParameters.read(file).glance_s == 1.5
