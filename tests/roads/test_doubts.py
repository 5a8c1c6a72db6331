"""Doubts about pairs of vehicles, from their boxes, lanes and recording."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from scex_sumo.roads.doubts import doubts_of
from scex_sumo.scene import SeedScene
from tests.queues import queues


def doubt(scene: SeedScene) -> str | None:
    (found,) = doubts_of(scene, np.array([0]), np.array([1]))
    return found


def moved(scene: SeedScene, **shift: Any) -> SeedScene:
    history = {name: getattr(scene.history, name) + np.array(by)[:, None] for name, by in shift.items()}
    return dataclasses.replace(scene, history=dataclasses.replace(scene.history, **history))


@pytest.mark.parametrize(
    ("gap_m", "speed", "words"),
    [(-0.5, 0.0, "overlap"), (0.05, 0.0, "nearly touch"), (1.0, 12.0, "nearly touch"), (1.0, 2.0, "")],
)
def test_boxes_that_touch_or_nearly_are(gap_m: float, speed: float, words: str) -> None:
    found = doubt(queues(2, gap_m=gap_m, speed=speed))
    assert found == (f"1 and 2 {words} at the seed moment" if words else None)


def test_a_vehicle_off_the_lanes_is() -> None:
    scene = moved(queues(2, gap_m=5.0), y=[0.0, 30.0])
    assert doubt(scene) == "2 is off the mapped lanes"
    assert doubt(dataclasses.replace(scene, people=np.array([False, True]))) is None
    named = doubts_of(scene, np.array([0]), np.array([1]), names=["1", "bicycle P2"])
    assert named == ["bicycle P2 is off the mapped lanes"]


def test_a_vehicle_that_leaves_within_a_second_and_before_the_others_is() -> None:
    scene = queues(2, gap_m=5.0)
    valid = np.ones((2, 20), dtype=np.bool_)
    for steps, words in ((9, "2 leaves the recording within a second"), (10, None)):
        valid[1] = np.arange(20) < steps
        assert doubt(dataclasses.replace(scene, future_valid=valid)) == words
    ended = dataclasses.replace(scene, future_valid=valid[:, :5])
    assert doubt(ended) is None


@pytest.mark.parametrize(("told", "doubted"), [(5.0, False), (9.0, False), (11.0, True), (2.4, True)])
def test_a_vehicle_whose_positions_and_speeds_contradict_each_other_is(told: float, doubted: bool) -> None:
    """Both vehicles move at 5 m/s."""
    scene = queues(2, gap_m=9.0, speed=5.0)
    scene.history.x[:] = scene.history.x[:, -1:] + 0.5 * np.arange(-10, 1)
    scene.history.speed[:] = np.array([[5.0], [told]])
    assert doubt(scene) == ("positions and speeds of 2 contradict each other" if doubted else None)
