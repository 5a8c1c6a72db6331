"""Poses of a car from the path of its front bumper."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.generators.drive import REAR_AXLE_SHARE, body_states

LENGTH = 4.5


def test_a_car_on_a_straight_road_keeps_its_heading_and_speed():
    front = np.column_stack([np.arange(50) * 1.2, np.zeros(50)])
    states = body_states([front], [0.0], [LENGTH])[0]
    assert states.heading == pytest.approx(np.zeros(50))
    assert states.speed == pytest.approx(np.full(50, 12.0))
    assert states.x == pytest.approx(front[:, 0] - LENGTH / 2)


def test_on_a_circle_the_rear_axle_runs_inside():
    # Steady turn: rear radius² + lever² = front radius²; the car points where the rear axle rolls.
    radius, lever = 20.0, REAR_AXLE_SHARE * LENGTH
    angle = np.arange(300) * 0.04
    front = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    states = body_states([front], [np.pi / 2], [LENGTH])[0]
    rear = np.sqrt(radius**2 - lever**2)
    assert states.speed[-10] == pytest.approx(0.4 * rear, rel=4e-3)  # 0.04 rad in 0.1 s; smoothing cuts cm
    bumper = np.array([np.cos(angle[-10]), np.sin(angle[-10])])
    along = np.array([np.cos(states.heading[-10]), np.sin(states.heading[-10])])
    assert float(bumper @ along) == pytest.approx(lever / radius, abs=8e-3)  # half a substep: 0.1 m / 20 m


def test_a_kink_in_the_lane_does_not_turn_the_car_at_once():
    # 20 degrees at a point, taken at 10 m/s: a car turns over some metres.
    front = np.concatenate(
        [
            np.column_stack([np.arange(-30, 0.0), np.zeros(30)]),
            np.arange(31)[:, None] * [np.cos(0.35), np.sin(0.35)],
        ]
    )
    states = body_states([front], [0.0], [LENGTH])[0]
    assert np.abs(np.diff(states.heading)).max() < 0.2 * 1.0  # 0.2 1/m over a step of 1 m
    assert states.heading[-1] == pytest.approx(0.35, abs=0.01)
