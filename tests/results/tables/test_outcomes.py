"""Collisions as rows, encounters that parts keep, and values of two vehicles that had collided."""

from __future__ import annotations

import numpy as np

from scex_sumo.metrics.collisions import find_collisions
from scex_sumo.results.tables.outcomes import after_collision
from tests.results.tables.test_encounters import LEVELS, futures


def test_values_are_flagged_from_the_step_of_the_collision_on_whatever_the_order_of_the_two() -> None:
    hits = find_collisions(futures(LEVELS))
    future, step = np.full(4, hits.future[0]), hits.step[0] + np.array([-1, 0, 5, 5])
    one, two = np.array([0, 1, 1, 0]), np.array([1, 0, 0, 2])
    assert after_collision(hits, future, step, one, two).tolist() == [False, True, True, False]
    assert not after_collision(hits, future, step, one, None).any()
