"""Synthetic seeds: what SUMO drove, as scenes that could have been recorded."""

from __future__ import annotations

import subprocess
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shapely import STRtree
from shapely.geometry import LineString, Point, Polygon

from scex_sumo.base.errors import SimulationError
from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.generators import synthetic
from scex_sumo.generators.drive import Drive
from scex_sumo.generators.synthetic import synthetic_scene
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from scex_sumo.scenarios import example_path
from scex_sumo.scene import SeedScene, States
from tests.behaviors import roads as roads_of_tests
from tests.converters.maps import DASHED, Lanelet, straight, write_map

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
    return synthetic_scene(road, net.path, vehicles=vehicles, seed=seed, name="test")


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


@pytest.mark.parametrize("name", REAL)
def test_seeds_on_real_maps_look_like_recordings(name: str, data: Path, folder: Path):
    road, net = converted(data / "interaction" / "maps" / f"{name}.osm", folder)
    scene = synthetic_scene(road, net.path, vehicles=REAL[name], seed=0, name="test")
    assert scene.vehicles == REAL[name]
    assert_like_a_recording(scene, road)


ONE_ROAD = {
    "one lane": [straight(1, 0, 300)],
    "three lanes": [
        straight(1, 0, 300, left_tags=DASHED),
        straight(2, 0, 300, y=3.5, left_tags=DASHED, right_tags=DASHED),
        straight(3, 0, 300, y=7.0, right_tags=DASHED),
    ],
    "both ways": [straight(1, 0, 300), Lanelet(2, left=[(300, 3.5), (0, 3.5)], right=[(300, 7), (0, 7)])],
}


@pytest.mark.parametrize("name", ONE_ROAD)
def test_a_map_of_one_road_is_populated(name: str, tmp_path: Path):
    road, net = converted(write_map(tmp_path / "road.osm", ONE_ROAD[name]), tmp_path)
    scene = synthetic_scene(road, net.path, vehicles=4, seed=0, name="test")
    assert scene.vehicles == 4
    assert_like_a_recording(scene, road)


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


def zigzag(lanelet_id: int, x: float) -> Lanelet:
    """A road with kinks that no car can follow."""
    line = LineString([(x, 0), (x + 60, 0), (x + 10, 14), (x + 60, 28), (x + 10, 42), (x + 100, 70)])
    left, right = (line.offset_curve(side, join_style="mitre") for side in (1.75, -1.75))
    return Lanelet(lanelet_id, left=list(left.coords), right=list(right.coords))


def test_a_map_of_kinks_is_populated_soon_and_says_how_far_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("scex_sumo.base.sumo.programs.WAIT_S", 0.01)
    road, net = converted(
        write_map(tmp_path / "kinks.osm", [zigzag(k, 120 * k) for k in range(1, 5)]), tmp_path
    )
    told: list[tuple[int, int]] = []
    begin = time.process_time()
    scene = synthetic_scene(
        road, net.path, vehicles=10, name="test", progress=lambda done, total: told.append((done, total))
    )
    assert time.process_time() - begin < 10.0  # without SUMO itself; all moments are tried
    assert scene.vehicles == 10
    assert len(told) > 2
    assert sorted(told) == told and {total for _, total in told} == {3900}
    assert told[-1] == (3900, 3900)


def test_where_vehicles_always_overlap_that_is_the_reason(tmp_path: Path):
    nodes, edges = tmp_path / "n.nod.xml", tmp_path / "e.edg.xml"
    ends = [
        f'<node id="{end}{k}" x="{x}" y="{0.1 * k}"/>' for k in range(6) for end, x in (("a", 0), ("b", 200))
    ]
    nodes.write_text(f"<nodes>{''.join(ends)}</nodes>")
    roads = [f'<edge id="r{k}" from="a{k}" to="b{k}" numLanes="1" speed="9"/>' for k in range(6)]
    edges.write_text(f"<edges>{''.join(roads)}</edges>")
    net = tmp_path / "one_over_another.net.xml"
    command = [program("netconvert"), "-n", nodes, "-e", edges, "-o", net]
    subprocess.run(command, check=True, capture_output=True, env=environment())
    with pytest.raises(
        SimulationError, match=r"one: some of 24 vehicles overlap at all \d+ moments tried"
    ) as error:
        synthetic_scene(replace(roads_of_tests.straight(), name="one"), net, vehicles=24, name="test")
    assert "\n" not in str(error.value)


def test_of_thousands_of_vehicles_few_moments_are_tried() -> None:
    steps = 500
    alone = Drive(
        number=np.arange(2), trips=[], present=np.ones((steps, 2), bool), front=np.zeros((steps, 2, 2)),
        angle=np.zeros((steps, 2)), speed=np.ones((steps, 2)),
    )  # fmt: skip
    ready, rng = np.ones((steps, 5000), bool), np.random.default_rng(0)
    crowd = replace(alone, present=ready, speed=ready.astype(float))
    assert len(list(synthetic._moments(alone, ready[:, :2], 2, rng))) == 100
    assert len(list(synthetic._moments(crowd, ready, 5000, rng))) == 40
