"""People of scenes without tracks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

import scex_sumo as scex
from scex_sumo.base.errors import UsageError
from scex_sumo.generators.people import SPEEDS_MPS
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.scene import HISTORY_STEPS, SeedScene
from tests.command import scex as command

NOW, LATER = HISTORY_STEPS, HISTORY_STEPS + 31


def scene_of(name: str, people: int, seed: int = 0) -> SeedScene:
    return scex.synthetic_seed(
        scex.example_path(name), vehicles=6, like="recorded", people=people, seed=seed, cache=False
    )


def test_people_walk_at_usual_speeds_outside_the_lanes_or_across_them() -> None:
    scene = scene_of("urban_intersection", 8)
    others, road = scene.obstacles, scene.road
    assert others is not None and road is not None
    assert sorted(others.types) == ["bicycle"] * 2 + ["pedestrian"] * 6
    lanes = [np.vstack([lane.left_bound, lane.right_bound[::-1]]) for lane in road.vehicle_lanes.values()]
    driven = shapely.union_all([shapely.polygons(ring).buffer(0.0) for ring in lanes])
    (crossing,) = (lane for lane in road.lanes.values() if lane.kind == "pedestrian")
    for k, kind in enumerate(others.types):
        mean, _, low, high = SPEEDS_MPS[kind]
        states = others.states[k]
        assert low <= states.speed[NOW] <= high and low < mean < high
        moved = np.hypot(states.x[LATER] - states.x[NOW], states.y[LATER] - states.y[NOW])
        assert moved <= 3.1001 * states.speed[NOW]
        at = shapely.points(states.x[NOW], states.y[NOW])
        crosses = shapely.distance(at, shapely.linestrings(crossing.centreline)) < 0.1
        assert driven.contains(at) == (kind == "bicycle" or crosses)


def test_people_touch_no_vehicle_in_the_next_three_seconds() -> None:
    scene = scex.synthetic_seed(scex.example_path("roundabout"), vehicles=8, people=12, seed=3)
    others = scene.obstacles
    assert others is not None and scene.future is not None and len(others.ids) == 12
    for step in range(0, 30, 5):
        cars = Rectangles.of(scene.future[:, step], scene.length, scene.width)
        people = others.states[:, None, NOW + 1 + step]
        bodies = Rectangles.of(people, others.length[:, None], others.width[:, None])
        assert (rectangle_distance(bodies, cars) > 0).all()


def test_wrong_numbers_of_people_are_one_line() -> None:
    with pytest.raises(UsageError, match="--people: got -1, needs 0 to 500"):
        scene_of("roundabout", -1)


def test_generated_cases_have_people(tmp_path: Path) -> None:
    road = scex.example_path("urban_intersection")
    done = command("generate", road, "--vehicles", "4", "--people", "3", "--count", "2", "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    scene = scex.read_seed(tmp_path / "urban_intersection.osm", case="2")
    assert scene.vehicles == 4 and scene.obstacles is not None and len(scene.obstacles.ids) == 3
