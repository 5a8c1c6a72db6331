"""The example seeds as they are shipped: read like recordings, and busy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shapely import STRtree
from shapely.geometry import Point, Polygon

from example_maps.make_examples import make
from scex_sumo.converters.datasets.recordings import recorded_scene
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.scenarios import EXAMPLES, example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SeedScene


def corners(scene: SeedScene, k: int) -> Polygon:
    half = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [scene.length[k] / 2, scene.width[k] / 2]
    c, s = np.cos(scene.now.heading[k]), np.sin(scene.now.heading[k])
    return Polygon(half @ np.array([[c, s], [-s, c]]) + [scene.now.x[k], scene.now.y[k]])


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_read_without_options_and_without_repairs(name: str):
    scene = recorded_scene(example_path(name))
    assert 8 <= scene.vehicles <= 14
    assert scene.notes == ()
    assert np.all(scene.recorded_steps == 10)
    assert scene.future is not None
    assert scene.future.shape[1] >= 30


@pytest.mark.parametrize("name", EXAMPLES)
def test_vehicles_stand_on_lanes_and_apart_from_each_other(name: str):
    scene, road = recorded_scene(example_path(name)), read_road(example_path(name))
    lanes = STRtree([Polygon([*a.left_bound, *a.right_bound[::-1]]) for a in road.vehicle_lanes.values()])
    boxes = [corners(scene, k) for k in range(scene.vehicles)]
    for k, box in enumerate(boxes):
        assert len(lanes.query(Point(scene.now.x[k], scene.now.y[k]), predicate="within"))
        assert not any(box.intersects(other) for other in boxes[:k])


@pytest.mark.parametrize("name", EXAMPLES)
def test_histories_agree_with_speeds(name: str):
    states = recorded_scene(example_path(name)).history
    moved = np.hypot(np.diff(states.x), np.diff(states.y)) / 0.1
    # Positions are rounded to 1 mm: 0.014 m/s; a turning car's centre is faster than its axis by up to 4 %.
    assert np.abs(moved - states.speed[:, 1:]).max() < 0.1


@pytest.mark.parametrize(
    ("name", "limit_kmh"), [("roundabout", 50), ("urban_intersection", 50), ("motorway_merge", 120)]
)
def test_speeds_are_those_of_the_road(name: str, limit_kmh: float):
    speed = recorded_scene(example_path(name)).now.speed
    assert speed.max() < 1.25 * limit_kmh / 3.6  # the fastest driver there is
    assert speed.max() > 0.6 * limit_kmh / 3.6
    assert (speed > 1.0).mean() > 0.5  # some wait, most drive


def test_somebody_walks_and_somebody_cycles_at_the_intersection():
    scene = recorded_scene(example_path("urban_intersection"))
    assert scene.obstacles is not None
    speeds = sorted(scene.obstacles.states.speed[scene.obstacles.present[:, 10], 10])
    assert len(speeds) == 2
    assert speeds[0] < 2.0 < speeds[1] < 6.5


def test_the_script_makes_the_shipped_roundabout(tmp_path: Path):
    make("roundabout", tmp_path)
    for suffix in (".osm", ".csv"):
        assert (tmp_path / f"roundabout{suffix}").exists()
    shipped, made = recorded_scene(example_path("roundabout")), recorded_scene(tmp_path / "roundabout.osm")
    # Another version of SUMO may drive differently; the number and the kind of scene stay.
    assert abs(shipped.vehicles - made.vehicles) <= 4


def test_the_moment_has_one_value_by_either_word() -> None:
    scene = read_seed(example_path("roundabout"), time=4.0)
    assert scene.time == scene.time_s == 4.0
