"""Synthetic seeds: what SUMO drove, as scenes that could have been recorded."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shapely import STRtree
from shapely.geometry import Point, Polygon

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.net.convert import SumoNet, convert
from scex_sumo.errors import SimulationError, UsageError
from scex_sumo.road import Road
from scex_sumo.scenarios import EXAMPLES, example_path
from scex_sumo.scenarios.traffic.synthetic import synthetic_scene
from scex_sumo.scene import SeedScene, States

REAL = {"DR_DEU_Roundabout_OF": 11, "DR_DEU_Merging_MT": 11}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("nets")


@cache
def converted(map_path: Path, folder: Path) -> tuple[Road, SumoNet]:
    road = read_road(map_path)
    return road, convert(road, folder / f"{road.name}.net.xml")


def populate(name: str, folder: Path, vehicles: int = 10, seed: int = 0) -> SeedScene:
    road, net = converted(example_path(name), folder)
    return synthetic_scene(road, net, vehicles=vehicles, seed=seed, name="test")


def whole(scene: SeedScene) -> States:
    assert scene.future is not None
    return States.concatenate([scene.history, scene.future], 1)


def arrays(scene: SeedScene) -> list[bytes]:
    states = whole(scene)
    columns = (states.x, states.y, states.heading, states.speed, scene.length, scene.width, scene.track_ids)
    return [column.tobytes() for column in columns]


def assert_like_a_recording(scene: SeedScene, road: Road) -> None:
    """Full histories, on lanes, apart from each other, and moved as cars move."""
    assert scene.future is not None
    assert scene.future_valid is not None
    assert np.all(scene.recorded_steps == 10)
    assert len(set(scene.track_ids)) == scene.vehicles
    states = whole(scene)
    valid = np.concatenate([np.ones((scene.vehicles, 11), bool), scene.future_valid], 1)[:, 1:]
    moved = np.hypot(np.diff(states.x), np.diff(states.y)) / 0.1
    # Centres move along a car's axis, and across it where it turns: 0.3 lengths ahead of the rear axle, with
    # up to 0.2 1/m for cars and 0.12 for a truck of 12 m, 9 % more than along the axis.
    assert np.all((moved > states.speed[:, 1:] - 0.05)[valid])
    assert np.all((moved < 1.09 * states.speed[:, 1:] + 0.05)[valid])
    # SUMO's drivers brake with up to 9 m/s² in an emergency, gently otherwise.
    acceleration = np.diff(states.speed) / 0.1
    assert np.abs(acceleration[valid]).max() < 9.5
    assert np.abs(acceleration[valid]).mean() < 1.5
    turned = np.abs(np.angle(np.exp(1j * np.diff(states.heading))))
    driven = np.maximum(moved * 0.1, 1e-9)
    fast = valid & (moved > 2.0)
    assert (turned / driven)[
        fast
    ].max() < 0.3  # a car's smallest circle has 5 m radius: 0.2 1/m at its rear axle
    lanes = STRtree(
        [Polygon([*a.left_bound, *a.right_bound[::-1]]).buffer(0.3) for a in road.vehicle_lanes.values()]
    )
    for x, y in zip(scene.now.x, scene.now.y, strict=True):
        assert len(lanes.query(Point(x, y), predicate="within"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_seeds_look_like_recordings(name: str, folder: Path):
    scene = populate(name, folder)
    assert scene.vehicles == 10
    assert_like_a_recording(scene, converted(example_path(name), folder)[0])


@pytest.mark.parametrize("name", REAL)
def test_seeds_on_real_maps_look_like_recordings(name: str, data: Path, folder: Path):
    road, net = converted(data / "interaction" / "maps" / f"{name}.osm", folder)
    scene = synthetic_scene(road, net, vehicles=REAL[name], seed=0, name="test")
    assert scene.vehicles == REAL[name]
    assert_like_a_recording(scene, road)


@pytest.mark.parametrize("vehicles", [1, 2, 20])
def test_there_are_as_many_vehicles_as_asked_for(vehicles: int, folder: Path):
    assert populate("roundabout", folder, vehicles).vehicles == vehicles


def test_vehicles_do_not_overlap(folder: Path):
    scene = populate("urban_intersection", folder, 14)
    boxes = []
    for k in range(scene.vehicles):
        half = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [scene.length[k] / 2, scene.width[k] / 2]
        c, s = np.cos(scene.now.heading[k]), np.sin(scene.now.heading[k])
        boxes.append(Polygon(half @ np.array([[c, s], [-s, c]]) + [scene.now.x[k], scene.now.y[k]]))
    for i, box in enumerate(boxes):
        assert not any(box.intersects(other) for other in boxes[:i])


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(folder: Path):
    first, again, other = (populate("roundabout", folder, 8, seed) for seed in (5, 5, 6))
    assert arrays(first) == arrays(again)
    assert first.types == again.types
    assert arrays(first) != arrays(other)


def test_traffic_comes_from_everywhere_and_drivers_differ(folder: Path):
    scenes = [populate("roundabout", folder, 12, seed) for seed in range(3)]
    quadrants = {
        (bool(x > 1000), bool(y > 1000)) for s in scenes for x, y in zip(s.now.x, s.now.y, strict=True)
    }
    assert len(quadrants) == 4
    assert len({length for s in scenes for length in s.length}) > 25  # of 36 vehicles


def test_too_many_vehicles_are_refused_with_the_most_there_were(folder: Path):
    with pytest.raises(
        SimulationError, match=r"motorway_merge: SUMO gets at most \d+ vehicles .* not 400"
    ) as error:
        populate("motorway_merge", folder, 400)
    most = int(str(error.value).split("at most ")[1].split()[0])
    assert 20 < most < 400


@pytest.mark.parametrize("vehicles", [0, -3])
def test_less_than_one_vehicle_is_refused(vehicles: int, folder: Path):
    with pytest.raises(UsageError, match=f"at least 1 vehicle, not {vehicles}"):
        populate("roundabout", folder, vehicles)
