"""A model that fails is stood in for, vehicle by vehicle, and it is said why."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import ScexError
from scex_sumo.behaviors.models.idm import IdmDriver
from scex_sumo.drivers.registry import build, entry_of, parse_models
from scex_sumo.plug_in.fallback import Fallible, follow_path, is_ours, source_file
from scex_sumo.plug_in.user_model import SingleVehicle
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, States, VehicleIndex
from tests.behaviors import roads
from tests.seeds import Straight

TWO = roads.scene_of((10.0, 0.0, 0.0, 5.0), (60.0, 0.0, 0.0, 5.0))
ROAD = roads.straight()


class Forward(Straight):
    """Plans more steps than are asked for."""

    steps = 40


def asked(model: Forward, futures: int = 1) -> tuple[Plan, Plan]:
    """What a fallible model plans for everybody, and what the path-following driver would."""
    history = roads.present(TWO, futures)
    return roads.plan(Fallible(model, "mine"), ROAD, history), follow_path(
        history, ROAD, roads.every(history)
    )


def test_a_usable_plan_stands_as_it_is() -> None:
    made, _ = asked(Forward())
    assert made.x[0] == pytest.approx(10.0 + 0.5 * np.arange(1, 31))
    assert made.fallback is not None and not made.fallback.any()
    assert made.reasons == ("", "")


def test_only_the_vehicle_without_a_finite_plan_falls_back() -> None:
    def spoil(made: Plan, vehicles: VehicleIndex) -> Plan:
        made.speed[1, 7] = np.nan
        return made

    made, path = asked(Forward(spoil))
    assert made.fallback is not None and made.fallback.tolist() == [False, True]
    assert made.reasons == ("", "plan.speed is not finite")
    assert made.x[0] == pytest.approx(10.0 + 0.5 * np.arange(1, 31))
    assert np.array_equal(made.x[1], path.x[1]) and np.isfinite(made.speed).all()


@pytest.mark.parametrize(
    ("step", "words"),
    [(0, "plan starts 6.0 m from where the vehicle's motion leads"), (10, "plan jumps at step 11 to 6.0 m")],
)
def test_a_plan_that_jumps_falls_back(step: int, words: str) -> None:
    def spoil(made: Plan, vehicles: VehicleIndex) -> Plan:
        made.y[1, step:] += 6.0
        return made

    made, path = asked(Forward(spoil))
    assert made.reasons[0] == "" and made.reasons[1].startswith(words)
    assert np.array_equal(made.y[1], path.y[1])


def keys(**values: float) -> Callable[[Plan, VehicleIndex], Plan]:
    """The plan of the second vehicle with other values throughout."""

    def spoil(made: Plan, vehicles: VehicleIndex) -> Plan:
        for key, value in values.items():
            getattr(made, key)[1] = value
        return made

    return spoil


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (keys(speed=1e308), "plan.speed is 1e+308 at step 1; needs -20 to 120"),
        (keys(heading=1e300), "plan.heading is 1e+300 at step 1; needs -10000 to 10000"),
        (keys(speed=-5.0), "plan.speed leads -14.5 m ahead, its positions 14.5 m along plan.heading; needs"),
        (keys(speed=18.0), "plan.speed leads 52.2 m ahead, its positions 14.5 m along plan.heading; needs"),
        (keys(heading=90.0), "plan.speed leads 14.5 m ahead, its positions -6.5 m along plan.heading; needs"),
    ],
)
def test_a_plan_beyond_what_a_vehicle_can_do_falls_back(
    change: Callable[[Plan, VehicleIndex], Plan], words: str
) -> None:
    made, path = asked(Forward(change))
    assert made.reasons[0] == "" and made.reasons[1].startswith(words)
    assert np.array_equal(made.speed[1], path.speed[1])


def test_turns_beyond_a_whole_one_and_reversing_are_plans() -> None:
    def backwards(made: Plan, vehicles: VehicleIndex) -> Plan:
        return replace(made, heading=made.heading + 5 * np.pi, speed=-made.speed)

    made, _ = asked(Forward(backwards))
    assert made.reasons == ("", "")


def test_the_hardest_stop_that_a_vehicle_can_make_is_no_jump() -> None:
    def stop(made: Plan, vehicles: VehicleIndex) -> Plan:
        made.x[:] = made.x[:, :1]  # from 5 m/s to 0 within one step
        return replace(made, speed=np.zeros_like(made.x))

    made, _ = asked(Forward(stop))
    assert made.reasons == ("", "")


def test_a_model_that_ends_the_program_does_not() -> None:
    def leave(made: Plan, vehicles: VehicleIndex) -> Plan:
        raise SystemExit(3)

    made, path = asked(Forward(leave))
    assert made.reasons[0].startswith("raised SystemExit: 3 (test_fallback.py")
    assert np.array_equal(made.x, path.x)


class OneAtATime:
    def plan_one(
        self, history: SceneHistory, road: Road, future: int, vehicle: int, rng: np.random.Generator
    ) -> States:
        if vehicle == 1:
            raise RuntimeError
        now = history.now[future, vehicle]
        return States(x=float(now.x) + 0.5 * np.arange(1, 31), y=np.zeros(30), heading=np.zeros(30),
                      speed=np.full(30, 5.0))  # fmt: skip


def test_a_driving_function_that_fails_for_one_vehicle_is_asked_once_for_each() -> None:
    history = roads.present(TWO, 2)
    made = roads.plan(Fallible(SingleVehicle(OneAtATime()), "mine"), ROAD, history)
    assert made.fallback is not None and made.fallback.tolist() == [False, True] * 2
    assert made.reasons[1].startswith("raised RuntimeError: no message (test_fallback.py")


def test_a_model_that_fails_for_everybody_is_an_error_before_anything_runs() -> None:
    history = roads.present(TWO)
    model = Forward(lambda made, vehicles: replace(made, y=made.y[:, :7]))
    with pytest.raises(
        ScexError,
        match=r"^mine: no usable plan for any of 2 vehicles of the seed scene: plan.y has shape \(1, 7\), "
        r"needs \(1, 30\) or more steps; it is class Forward of .*test_fallback.py; a Plan has x, y",
    ) as caught:
        Fallible(model, "mine").try_on(history, ROAD, roads.every(history), roads.generators(history))
    assert "\n" not in str(caught.value)


def test_the_path_following_driver_is_the_calibrated_driver_on_the_straight_path() -> None:
    scene = roads.scene_of((30.0, 0.4, 0.0, 8.0))
    history = roads.present(scene)
    expected = roads.plan(IdmDriver(entry_of("calibrated_driver").profile), roads.fork(), history)
    made = follow_path(history, roads.fork(), roads.every(history))
    assert np.array_equal(made.x, expected.x) and np.array_equal(made.y, expected.y)


@pytest.mark.parametrize("name", ["graph_predictor", "joint_predictor"])
def test_a_learned_driver_is_ours_and_no_file_of_a_user(name: str) -> None:
    model = build(parse_models(name)[0])
    assert is_ours(model)
    assert source_file(model) == Path(inspect.getfile(type(model)))
