"""The Intelligent Driver Model: formula, equilibrium, stopping, speed limits, curves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import MIN_PARAMETER
from scex_sumo.behaviors.models.idm import IdmDriver, IdmProfile, idm_acceleration
from scex_sumo.drivers.registry import entry_of
from scex_sumo.scene import States
from tests.behaviors import roads
from tests.seeds import people_of, steady

PROFILE = IdmProfile(
    comfort_deceleration=2.0, time_headway=1.5, minimum_gap=2.0, max_acceleration=1.5, path=0
)
DRIVER = IdmDriver(PROFILE)


def acceleration(v: float, v0: float, gap: float, leader: float, profile: IdmProfile = PROFILE) -> float:
    columns = (np.array([value]) for value in (v, v0, gap, leader))
    return float(idm_acceleration(profile, *columns)[0])


@pytest.mark.parametrize("name", ["standard_driver", "risky_driver", "calibrated_driver"])
@pytest.mark.parametrize(("v", "v0", "gap", "leader"), [(10, 15, 30, 8), (0, 15, 5, 0), (14, 15, 60, 14)])
def test_the_acceleration_is_that_of_the_formula(
    name: str, v: float, v0: float, gap: float, leader: float
) -> None:
    p = entry_of(name).profile
    root = 2 * np.sqrt(p.max_acceleration * p.comfort_deceleration)
    wanted = p.minimum_gap + v * p.time_headway + v * (v - leader) / root
    by_hand = p.max_acceleration * (1 - (v / v0) ** 4 - (wanted / gap) ** 2)
    assert acceleration(v, v0, gap, leader, p) == pytest.approx(by_hand, rel=1e-12)


def follow(*vehicles: roads.Vehicle, seconds: float = 3.0, profile: IdmProfile = PROFILE) -> States:
    """First vehicle an IDM driver, the others standing still or driving on at constant speed."""
    scene = roads.scene_of(*vehicles)
    made = roads.plan(IdmDriver(profile), roads.straight(), roads.present(scene))
    return made[0, : round(seconds * 10)]


def test_a_follower_in_equilibrium_stays_in_it_through_the_whole_plan() -> None:
    gap = (2.0 + 10.0 * 1.5) / np.sqrt(1 - (10 / 15) ** 4)
    track = follow((30.0, 0.0, 0.0, 10.0), (34.5 + gap, 0.0, 0.0, 10.0))
    assert track.speed == pytest.approx(10.0, abs=1e-6)


def test_a_driver_stops_smoothly_behind_something_standing_and_never_reverses() -> None:
    track = one_against_standing(DRIVER, 12.0, 70.0, seconds=30)
    assert np.all(track.speed >= 0)
    assert track.speed[-1] == pytest.approx(0.0, abs=0.05)
    # It ends s0 = 2 m behind the rear bumper at 100 - 2.25, give or take the crawl of the last seconds.
    assert 100.0 - 4.5 - track.x[-1] == pytest.approx(2.0, abs=0.4)
    assert np.diff(track.speed).min() / 0.1 > -3.5
    assert np.all(np.diff(track.x) >= 0)


def one_against_standing(driver: IdmDriver, speed: float, gap: float, seconds: float) -> States:
    """Closed loop of one driver towards an obstacle that stands at x = 30 + gap: (steps,)."""
    wall = people_of(steady((30.0 + gap, 0.0, 0.0, 0.0)), length=4.5, width=1.8)
    scene = roads.scene_of((30.0, 0.0, 0.0, speed), obstacles=wall)
    return roads.closed_loop(driver, roads.straight(), scene, steps=round(seconds * 10), replan=5)[0, 0]


def test_the_speed_limit_of_the_lane_is_the_desired_speed_and_can_be_replaced() -> None:
    scene = roads.scene_of((30.0, 0.0, 0.0, 5.0))

    def end(limit: float, **parameters: float) -> float:
        driver = IdmDriver(replace(PROFILE, max_acceleration=3.0, **parameters))  # type: ignore[arg-type]
        track = roads.closed_loop(driver, roads.straight(2000.0, limit=limit), scene, steps=400, replan=10)
        return float(track.speed[0, 0, -1])

    assert end(10.0) == pytest.approx(10.0, abs=0.01)
    assert end(10.0, speed=7.0) == pytest.approx(7.0, abs=0.01)
    assert end(10.0, speed_factor=1.2) == pytest.approx(12.0, abs=0.01)


def test_the_calibrated_driver_goes_on_as_the_seed_scene_shows() -> None:
    scene = roads.scene_of((30.0, 0.0, 0.0, 8.0))
    speed = 8.0 + 0.1 * 1.0 * np.arange(-10, 1)[None]
    speeding = replace(scene, history=replace(scene.history, speed=speed))
    driver = IdmDriver(entry_of("calibrated_driver").profile)
    steady, faster = (
        roads.plan(driver, roads.straight(), roads.present(one)).speed[0] for one in (scene, speeding)
    )
    assert steady[-1] - 8.0 < 1.0 < faster[-1] - 8.0
    assert np.abs(np.diff(steady)).max() / 0.1 < 0.5


def test_with_a_curve_limit_a_driver_is_slow_enough_when_it_gets_there_without_one_it_is_not() -> None:
    bend = roads.arc(20.0, np.pi, (150.0, 0.0), step=0.5)
    where = roads.road(
        roads.lane(1, [(0.0, 0.0), (150.0, 0.0)], successors=(2,)), roads.lane(2, bend, predecessors=(1,))
    )
    scene = roads.scene_of((40.0, 0.0, 0.0, 15.0))

    def fastest_in_curve(curve_acceleration: float) -> tuple[float, float]:
        driver = IdmDriver(replace(PROFILE, curve_acceleration=curve_acceleration))
        track = roads.closed_loop(driver, where, scene, steps=150, replan=5)[0, 0]
        return float(track.speed[track.x > 152.0].max()), float(np.diff(track.speed).min() / 0.1)

    slow, braking = fastest_in_curve(2.5)
    # √(2.5·20) = 7.07 m/s; the model follows a falling desired speed with some lag.
    assert slow**2 / 20 <= 1.4 * 2.5
    assert braking >= -2.5
    fast, _ = fastest_in_curve(0.0)
    assert fast == pytest.approx(15.0, abs=0.1)


@pytest.mark.parametrize(
    ("parameter", "value"),
    [("time_headway", -1.0), ("max_acceleration", 0.0), ("comfort_deceleration", float("nan")),
     ("radius", float("inf")), ("minimum_gap", "2"), ("habit_memory", -1.0), ("habit_lead", float("nan"))],
)  # fmt: skip
def test_parameters_that_make_no_sense_are_refused(parameter: str, value: object) -> None:
    with pytest.raises(UsageError, match=f"{parameter}: got"):
        replace(PROFILE, **{parameter: value})  # type: ignore[arg-type]


def test_a_driver_with_the_least_comfortable_braking_that_may_be_given_drives() -> None:
    driver = IdmDriver(replace(PROFILE, comfort_deceleration=MIN_PARAMETER))
    made = roads.plan(driver, roads.straight(), roads.present(roads.scene_of((30.0, 0.0, 0.0, 8.0))))
    assert np.isfinite(made.speed).all()
