"""Terms of the human-like driver, each by hand, and their combination."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.behaviors.models.idm import idm_acceleration
from scex_sumo.humans import parameters, terms
from scex_sumo.humans.parameters import HumanParameters, human_parameters, simulated
from scex_sumo.humans.terms import Drivers, Situation

HUMAN = human_parameters()


def situation(speed: list[float], **given: Any) -> Situation:
    """Drivers at a speed that they showed, at the limit of 20 m/s; values of drivers and steps as given."""
    v = np.array(speed)
    own = {field.name for field in fields(Drivers)} & set(given)
    driver = {"acceleration": 0 * v, "headway": 0 * v + 0.5, "rest": 1.0}
    driver |= {name: given.pop(name) for name in own}
    return Situation(
        driver=Drivers(speed=v, **driver), speed=v, limit=0 * v + 20.0, headway=0 * v + 0.5, **given
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
    profile = replace(HUMAN.idm, time_headway=0.5, comfort_deceleration=HUMAN.following_mps2)
    formula = idm_acceleration(profile, np.array(speed), np.full(4, np.inf), gap, leader)
    harder = -((speed - leader) ** 2) / (2 * (gap - HUMAN.idm.minimum_gap)) - asked
    assert (harder[:2] > 0).all() and (harder[:2] <= HUMAN.extra_braking_mps2).all()
    assert (asked[:2] > formula[:2]).all()
    assert asked[2] > 0 and asked[3] == -HUMAN.idm.max_deceleration


def test_a_driver_that_looks_away_does_not_follow() -> None:
    now = situation([10.0, 10.0], gap=np.full(2, 5.0), aware=np.array([True, False]))
    assert np.isfinite(terms.following(now, HUMAN)).tolist() == [True, False]


def test_before_a_curve_drivers_brake_gently() -> None:
    now = situation([15.0, 5.0], curve_speed=np.array([5.0, 5.4]))
    assert terms.curve(now, HUMAN) == pytest.approx([-HUMAN.idm.comfort_deceleration, 0.5])


def test_shown_accelerations_fade() -> None:
    now = situation([10.0], habit=1.0, sudden=1.0, time_s=0.7)
    assert terms.habit(now, HUMAN) == pytest.approx(np.exp(-0.7 / HUMAN.habit_s))
    assert terms.sudden(now, HUMAN) == pytest.approx(np.exp(-0.7 / HUMAN.sudden_s))


def test_variation_is_linear_between_its_times_and_none_of_a_vehicle_that_stood() -> None:
    drawn = np.array([[0.0, 3.0], [0.0, 3.0]])
    now = situation([10.0, 0.0], variation=drawn, time_s=1.0)
    assert terms.variation(now, HUMAN) == pytest.approx([1.0, 0.0])


def test_a_driver_that_must_brake_adds_no_acceleration() -> None:
    asked = np.array([0.0, -1.5, -3.0, -3.0])
    assert terms.relieved(np.array([1.0, 1.0, 1.0, -1.0]), asked, HUMAN).tolist() == [1.0, 0.5, 0.0, -1.0]


def test_a_standing_vehicle_crawls_but_not_into_its_leader() -> None:
    now = situation([0.1, 0.1], crawl=0.3, rest=1.0, gap=np.array([5.0, 0.9]))
    assert terms.standing(now, HUMAN) == pytest.approx([0.4, -0.2])


def test_nearer_than_its_gap_at_rest_a_driver_ends_its_approach_however_eager_it_is() -> None:
    # 6.5 m/s behind 6 m/s: 1 m/s² within half a second; further away or unaware, nothing.
    gap, aware = np.array([1.0, 3.0, 1.0]), np.array([True, True, False])
    now = situation([6.5] * 3, habit=4.0, rest=1.6, gap=gap, leader_speed=6.0, aware=aware)
    assert terms.resting(now, HUMAN).tolist() == [-1.0, np.inf, np.inf]
    assert terms.acceleration(now, HUMAN)[0] == -1.0


def test_the_least_demand_counts_and_the_own_accelerations_are_added_within_limits() -> None:
    habit, waits = np.array([1.0, -9.0, 9.0, 1.0]), np.array([False, False, False, True])
    now = situation([20.0, 20.0, 20.0, 0.0], habit=habit, waits=waits)
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
