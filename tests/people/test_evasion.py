"""Evasion: people do not walk into vehicles that stand, and leave the way of one that comes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.arrays import BoolArray
from scex_sumo.people.evasion import STEPS, first_touch
from scex_sumo.people.models import KeepsWalking, StressProfile, Walker
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, VehicleIndex
from tests.people.test_gaps import EXPECTED, PARAMETERS, WALKS_MPS, crossing, plan_of, steadily

__all__ = ["steadily"]  # a fixture
PERSON = VehicleIndex(future=np.array([0]), vehicle=np.array([1]))


def touching(plan: Plan, scene: SeedScene) -> BoolArray:
    """Return at which of the steps ahead the person is in the car, a disc of 0.3 m as a square."""
    car = scene.now.x[0] + scene.now.speed[0] * STEP_S * np.arange(1, STEPS + 1)
    inside = (np.abs(plan.x[0, :STEPS] - car) < 2.25 + 0.3) & (np.abs(plan.y[0, :STEPS]) < 0.9 + 0.3)
    return np.asarray(inside)


def test_the_first_touch_is_when_one_has_walked_to_the_side_of_a_standing_car() -> None:
    scene = crossing(0.0, -2.5, speed=0.0)
    plan = plan_of(KeepsWalking(StressProfile()), scene)
    until = first_touch(plan, SceneHistory.of_scene(scene), PERSON)
    assert until == [np.ceil((2.5 - 0.9 - 0.3) / WALKS_MPS / STEP_S)]
    passes = crossing(4.0, -2.5, speed=0.0)
    assert np.isinf(first_touch(plan, SceneHistory.of_scene(passes), PERSON)).all()


@pytest.mark.usefixtures("steadily")
@pytest.mark.parametrize("car_x", [0.0, 1.5, -2.0])
def test_one_does_not_walk_into_the_side_of_a_standing_car(car_x: float) -> None:
    scene = crossing(car_x, -2.5, speed=0.0)
    assert touching(plan_of(KeepsWalking(StressProfile()), scene), scene).any()
    plan = plan_of(Walker(EXPECTED, PARAMETERS), scene)
    assert not touching(plan, scene).any()


@pytest.mark.usefixtures("steadily")
def test_one_goes_round_the_corner_of_a_standing_car_without_a_stop() -> None:
    plan = plan_of(Walker(EXPECTED, PARAMETERS), crossing(2.4, -2.5, speed=0.0))
    assert plan.speed[0] == pytest.approx(WALKS_MPS) and plan.x[0, STEPS] < -0.1


@pytest.mark.usefixtures("steadily")
def test_one_that_stands_before_a_car_that_comes_leaves_its_way() -> None:
    scene = crossing(-16.0, 0.0)
    scene.history.y[1], scene.history.speed[1] = 0.0, 0.0
    stays = plan_of(KeepsWalking(StressProfile()), scene)
    assert touching(stays, scene).any()
    assert not touching(plan_of(Walker(EXPECTED, PARAMETERS), replace(scene)), scene).any()
