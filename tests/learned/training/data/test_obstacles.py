"""Standing vehicles are put where somebody can stop for them, and that one does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.intention import Intention
from scex_sumo.learned.training.data.perturb import STOP_GAP_M, add_obstacles, stopping_way
from scex_sumo.learned.training.data.samples import scene_samples
from scex_sumo.scene import SeedScene, States
from tests.behaviors import roads

TIMES = 0.1 * np.arange(1, 51)


def coming(*speeds: float) -> SeedScene:
    """Vehicles on one straight lane, 60 m apart, that keep their speeds for 5 s."""
    scene = roads.scene_of(*((50.0 + 60.0 * k, 0.0, 0.0, v) for k, v in enumerate(speeds)))
    speed = np.array(speeds)[:, None] + 0.0 * TIMES
    future = States(x=scene.now.x[:, None] + speed * TIMES, y=0.0 * speed, heading=0.0 * speed, speed=speed)
    return replace(scene, future=future, future_valid=np.ones(speed.shape, dtype=np.bool_))


def test_a_standing_vehicle_is_ahead_of_whom_it_blocks_and_behind_the_next() -> None:
    scene = coming(5.0, 5.0)
    found = add_obstacles(scene, roads.straight(), np.array([0]), np.random.default_rng(0))
    assert found is not None
    blocked, vehicle = found
    assert vehicle.tolist() == [0]
    assert blocked.vehicles == 3
    assert scene.now.x[0] + 4.0 < blocked.now.x[2] < scene.now.x[1] - 4.0
    assert (blocked.history.speed[2] == 0).all()
    assert blocked.future is not None
    np.testing.assert_array_equal(blocked.future.x[2], blocked.now.x[2])


def test_in_a_simulated_scene_a_standing_vehicle_has_no_intention() -> None:
    known = Intention(
        edges=("a",), model="Krauss", vehicle_class="passenger", parameters={}, speed_factor=1.0
    )
    scene = replace(coming(5.0), intentions=(known,))
    found = add_obstacles(scene, roads.straight(), np.array([0]), np.random.default_rng(0))
    assert found is not None and found[0].intentions == (known, None)


def test_the_target_of_a_blocked_vehicle_ends_behind_the_standing_one() -> None:
    scene, road = coming(8.0), roads.straight()
    found = add_obstacles(scene, road, np.array([0]), np.random.default_rng(3))
    assert found is not None
    start, blocked = found
    samples = scene_samples(start, road, start.history.repeat(1), blocked=blocked)
    assert samples is not None
    gap = start.now.x[1] - start.now.x[0] - (start.length[0] + start.length[1]) / 2
    assert samples.s[0, -1] < min(gap, 24.0)
    assert (np.diff(samples.s[0]) >= 0).all()


def test_drivers_come_to_a_stop_short_of_what_stands() -> None:
    speed, gap = np.array([3.0, 10.0, 13.0]), np.array([10.0, 30.0, 50.0])
    way = stopping_way(speed, gap, 150)
    assert (np.diff(way, axis=1) >= 0).all()
    assert (gap - way[:, -1] > 0.7 * STOP_GAP_M).all()
    np.testing.assert_allclose(way[:, -1], way[:, -10], atol=0.2)
