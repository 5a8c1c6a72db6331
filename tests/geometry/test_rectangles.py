"""What a vehicle sees of others, by hand."""

from __future__ import annotations

import numpy as np

from scex_sumo.geometry.rectangles import seen_from
from scex_sumo.scene import States


def states(x: object, y: object, heading: object, speed: object) -> States:
    return States(x=np.array(x), y=np.array(y), heading=np.array(heading), speed=np.array(speed))


def test_who_heads_north_sees_what_is_north_ahead_and_what_is_west_on_the_left() -> None:
    now = states([10.0], [20.0], [np.pi / 2], [3.0])
    looked_at = states([[10.0, 6.0]], [[25.0, 20.0]], [[np.pi / 2, np.pi]], [[1.0, 2.0]])
    seen = seen_from(now, looked_at)
    # Five metres ahead, same heading; four metres to the left, heading a quarter turn to the left.
    np.testing.assert_allclose(seen, [[[5, 0, 1, 0, 1], [0, 4, 0, 1, 2]]], atol=1e-12)  # cos(pi/2) is 6e-17


def test_each_vehicle_of_each_future_has_its_own_frame() -> None:
    now = states([[0.0, 1.0], [2.0, 3.0]], np.zeros((2, 2)), [[0.0, np.pi], [0.0, np.pi]], np.ones((2, 2)))
    past = states(np.zeros((2, 2, 1)), np.zeros((2, 2, 1)), np.zeros((2, 2, 1)), np.zeros((2, 2, 1)))
    seen = seen_from(now, past)
    np.testing.assert_allclose(seen[..., 0, 0], [[0, 1], [-2, 3]], atol=1e-12)  # who looks west sees it ahead
