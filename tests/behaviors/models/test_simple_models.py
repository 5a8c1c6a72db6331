"""Constant velocity, emergency brake, replay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE
from scex_sumo.behaviors.models.simple import (
    ConstantVelocity,
    ConstantVelocityProfile,
    EmergencyBrake,
    EmergencyBrakeProfile,
    Replay,
)
from scex_sumo.scene import SeedScene, States
from tests.behaviors import roads

CONSTANT = ConstantVelocity(ConstantVelocityProfile(path=0))


def test_constant_velocity_covers_the_same_arc_length_in_a_curve() -> None:
    where = roads.road(roads.lane(1, roads.arc(30.0, 3.0, step=0.5)))
    scene = roads.scene_of((30 * np.sin(0.5), 30 - 30 * np.cos(0.5), 0.5, 10.0))
    made = roads.plan(CONSTANT, where, roads.present(scene))
    # Speed and path are the rear axle's.
    back = REAR_AXLE_SHARE * 4.5
    x = made.x[0] - back * np.cos(made.heading[0])
    y = made.y[0] - back * np.sin(made.heading[0])
    step = np.hypot(np.diff(x), np.diff(y))
    # A chord of 1 m on 30 m is shorter than its arc by 1/(24·30²) = 5e-5.
    assert step == pytest.approx(1.0, abs=1e-4)
    assert made.heading[0, -1] - made.heading[0, 0] == pytest.approx(29 * 1.0 / 30, abs=0.02)


@pytest.mark.parametrize("speed", [4.3, 10.0, 14.99])
def test_the_emergency_brake_stops_after_v_squared_over_twice_the_deceleration(speed: float) -> None:
    made = roads.plan(
        EmergencyBrake(EmergencyBrakeProfile(path=0)),
        roads.straight(),
        roads.present(roads.scene_of((30.0, 0.0, 0.0, speed))),
    )
    assert made.x[0, -1] - 30.0 == pytest.approx(speed**2 / (2 * 5.0), abs=1e-9)
    assert made.speed[0] == pytest.approx(np.maximum(0.0, speed - 0.5 * np.arange(1, 31)))
    assert np.all(np.diff(made.x[0]) >= 0)


def with_future(scene: SeedScene, steps: int, speed: float) -> SeedScene:
    """A recorded future that goes sideways, which no path does."""
    now, ahead = scene.now, 0.1 * np.arange(1, steps + 1)
    shape = (scene.vehicles, steps)
    future = States(
        x=np.broadcast_to(now.x[:, None], shape).copy(),
        y=now.y[:, None] + speed * ahead,
        heading=np.full(shape, np.pi / 2),
        speed=np.full(shape, speed),
    )
    valid = np.ones(shape, dtype=bool)
    return replace(scene, future=future, future_valid=valid)


def test_replay_repeats_the_recording_and_goes_on_with_its_last_speed() -> None:
    scene = with_future(roads.scene_of((30.0, 50.0, np.pi / 2, 4.0)), 12, 4.0)
    made = roads.plan(Replay(), roads.straight(), roads.present(scene))
    # Off the road, so straight on along the heading it had in the seed scene.
    assert made.x[0] == pytest.approx(30.0)
    assert made.y[0] == pytest.approx(50.0 + 0.4 * np.arange(1, 31))
    assert made.speed[0] == pytest.approx(4.0)


def test_replay_of_a_vehicle_that_left_the_recording_follows_its_path() -> None:
    scene = with_future(roads.scene_of((30.0, 0.0, 0.0, 6.0)), 20, 4.0)
    assert scene.future_valid is not None
    gone = replace(scene, future_valid=np.zeros_like(scene.future_valid))
    made = roads.plan(Replay(), roads.straight(), roads.present(gone))
    assert made.x[0] == pytest.approx(30.0 + 0.6 * np.arange(1, 31))
    assert made.y[0] == pytest.approx(0.0)
