"""Samples by hand: what drivers should do on straight and curved roads, at forks, and adrift."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.learned.training.data.perturb import moved
from scex_sumo.learned.training.data.samples import TrainingSamples, learnable, scene_samples
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene, States
from tests.behaviors import roads

TIMES = 0.1 * np.arange(1, 51)


def with_future(scene: SeedScene, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> SeedScene:
    """A scene of one vehicle that keeps its speed along given points, 5 s."""
    states = States(
        x=x[None], y=y[None], heading=heading[None], speed=np.full((1, len(x)), scene.now.speed[0])
    )
    return replace(scene, future=states, future_valid=np.ones((1, len(x)), dtype=np.bool_))


def going_straight(y: float = 0.5, speed: float = 10.0) -> SeedScene:
    scene = roads.scene_of((50.0, y, 0.0, speed))
    return with_future(scene, 50.0 + speed * TIMES, np.full(50, y), np.zeros(50))


def samples_of(scene: SeedScene, where: Road, states: States | None = None, step: int = 0) -> TrainingSamples:
    found = scene_samples(scene, where, scene.history.repeat(1) if states is None else states, step=step)
    assert found is not None
    return found


def test_in_a_curve_the_way_is_that_along_the_curve() -> None:
    radius = 60.0
    where = roads.road(roads.lane(1, roads.arc(radius, np.pi, step=0.5)))
    angle = 0.3 + 10.0 * TIMES / radius
    scene = roads.scene_of((radius * np.sin(0.3), radius * (1 - np.cos(0.3)), 0.3, 10.0))
    scene = with_future(scene, radius * np.sin(angle), radius * (1 - np.cos(angle)), angle)
    found = samples_of(scene, where)
    # The table has the chords of 0.5 m of the circle, smoothed: centimetres off over 30 m.
    np.testing.assert_allclose(found.s[0], 10.0 * TIMES[:30], atol=0.05)
    np.testing.assert_allclose(found.d[0], 0.0, atol=0.05)
    # In its own frame it bends to the left: the sagitta of 30 m on this circle.
    assert found.xy[0, -1, 1] == pytest.approx(radius * (1 - np.cos(0.5)), abs=0.05)


def test_who_turned_left_was_on_the_left_path() -> None:
    where = roads.fork()
    x = np.minimum(40.0 + 10.0 * TIMES, 65.0)
    y = np.where(TIMES < 2.5, 0.0, 10.0 * (TIMES - 2.5))
    scene = with_future(roads.scene_of((40.0, 0.0, 0.0, 10.0)), x, y, np.where(TIMES < 2.5, 0.0, np.pi / 2))
    assert samples_of(scene, where).right.tolist() == [True, False, False]  # left to right


def test_who_is_put_off_comes_back_to_where_it_drove() -> None:
    scene = going_straight(y=0.0)
    off = moved(scene.history, np.array([0.6]), np.array([0.0]))
    found = samples_of(scene, roads.straight(), States.stack([scene.history, off], 0))
    assert found.pairs.tolist() == [1, 1]
    np.testing.assert_allclose(found.s[1], found.s[0], atol=1e-3)
    assert found.start[1, 1] == pytest.approx(0.6, abs=1e-3)
    assert found.d[1, 0] == pytest.approx(0.6, abs=0.01)  # after a tenth of a second, 1 m of 25
    assert found.d[1, -1] == pytest.approx(0.0, abs=1e-3)  # after 30 m of 25
    assert (np.diff(found.d[1]) <= 1e-6).all()


def test_who_drove_too_far_is_caught_up_with() -> None:
    scene = going_straight(y=0.0)
    driven = States.concatenate([scene.history, scene.future[:, :10]], 1)[:, 10:]
    ahead = replace(driven, x=driven.x + 2.0)
    found = samples_of(scene, roads.straight(), ahead[None], step=10)
    # The recorded one gets 30 m on in 3 s; who is 2 m ahead needs less than that, and never reverses.
    assert 28.0 < found.s[0, -1] < 29.0
    assert (np.diff(found.s[0]) > 0).all()


def test_who_leaves_the_recording_is_seen_but_not_learned_from() -> None:
    scene = roads.scene_of((50.0, 0.0, 0.0, 10.0), (80.0, 0.0, 0.0, 10.0))
    there = np.ones((2, 50), dtype=np.bool_)
    there[1, 29] = False
    way = np.array([[50.0], [80.0]]) + 10.0 * TIMES
    future = States(x=way, y=0.0 * way, heading=0.0 * way, speed=np.full(way.shape, 10.0))
    scene = replace(scene, future=future, future_valid=there)
    assert learnable(scene).tolist() == [0]
    found = samples_of(scene, roads.straight())
    assert found.nodes.tolist() == [2]
    assert found.pair_node.tolist() == [0]
