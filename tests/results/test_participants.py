"""People of a seed scene as participants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.participants import with_people
from scex_sumo.scene import SeedScene
from tests.seeds import people_of, steady, straight_seed


def scene_with(*types: str, speed: float = 1.0, length: float = 0.6) -> SeedScene:
    walking = ((20.0, 5.0 + k, 0.0, speed) for k in range(len(types)))
    states = steady(*walking, time_s=0.1 * np.arange(-10, 31))
    ids = tuple(f"P{k}" for k in range(len(types)))
    return replace(straight_seed(2), obstacles=people_of(states, *types, ids=ids, length=length))


def test_people_take_part_are_replayed_or_left_out() -> None:
    scene = scene_with("pedestrian", "bicycle", "tram")
    taking = with_people(scene, "model")
    assert taking.types == ("car", "car", "pedestrian", "bicycle")
    assert taking.track_ids.tolist() == [0, 1, 2, 3]  # P0 and P1 are the numbers of cars
    assert taking.obstacles is not None and taking.obstacles.types == ("tram",)
    assert np.array_equal(taking.history.x[2], scene.obstacles.states.x[0, :11])  # type: ignore[union-attr]
    assert with_people(scene, "replay") is scene
    left = with_people(scene, "none").obstacles
    assert left is not None and left.types == ("tram",)


def test_only_pairs_with_a_vehicle_count() -> None:
    taking = with_people(scene_with("pedestrian", "pedestrian"), "model")
    assert RunSettings(vru="model").vehicles_that_count(taking) == (0, 1)
    assert RunSettings().vehicles_that_count(straight_seed()) is None
