"""Generated scenes: free of overlap, on the road, able to go on, and the same for the same seed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from scex_sumo.base.errors import InputError, SimulationError, UsageError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.generate import generated_scene
from scex_sumo.scenarios.scene_context import NO_VEHICLES, Placed, lane_cells, placed_on_lanes, states_of
from scex_sumo.scenarios.scene_model import FORMAT, KINDS, SHIPPED, SceneModel, load_scenes, save_scenes
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import STEP_S
from tests.converters.maps import straight, write_map

MODEL = load_scenes()


@pytest.fixture(scope="module")
def road() -> Road:
    return read_road(example_path("urban_intersection"))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_vehicles_are_on_lanes_apart_and_move_as_their_speeds_say(road: Road, seed: int) -> None:
    scene = generated_scene(road, MODEL, vehicles=10, seed=seed)
    assert scene.vehicles == 10 and not off_road(road, scene)
    first, second = np.triu_indices(10, 1)
    boxes = (
        Rectangles.of(scene.history[k], scene.length[k, None], scene.width[k, None]) for k in (first, second)
    )
    assert rectangle_distance(*boxes).min() > 0.0
    h = scene.history
    driven = np.hypot(np.diff(h.x), np.diff(h.y)) / STEP_S
    assert np.abs(driven - h.speed[:, 1:]).max() < 0.1  # m/s; what is driven sideways
    assert np.abs(np.diff(h.speed)).max() < 1.0  # at a kink of the lane


def test_vehicles_stay_in_the_region(road: Road) -> None:
    x, y, _ = lane_cells(road).cell_pose
    cells = np.hypot(x - x.mean(), y - y.mean()) < 40.0
    now = generated_scene(road, MODEL, vehicles=5, cells=cells).now
    assert np.hypot(now.x - x.mean(), now.y - y.mean()).max() < 42.5  # a cell and an offset further
    with pytest.raises(UsageError, match="no lane for vehicles in the region"):
        generated_scene(road, MODEL, vehicles=5, cells=cells & False)


def test_a_scene_depends_on_seed_and_number_only(road: Road) -> None:
    one, same, other, next_one = (
        generated_scene(road, MODEL, vehicles=6, seed=seed, number=number).now.x
        for seed, number in ((3, 0), (3, 0), (4, 0), (3, 1))
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other) and not np.array_equal(one, next_one)


def test_the_number_is_drawn_by_density(road: Road) -> None:
    numbers = {MODEL.count(1000.0, np.random.default_rng(k)) for k in range(20)}
    assert len(numbers) > 3
    assert np.mean([MODEL.count(10_000.0, np.random.default_rng(k)) for k in range(20)]) > max(numbers)


def test_the_mean_speed_is_the_one_given_or_that_of_similar_scenes(road: Road) -> None:
    for speed in (4.0, 16.0):
        scenes = [generated_scene(road, MODEL, vehicles=6, speed=speed, number=k) for k in range(4)]
        assert np.mean([scene.now.speed.mean() for scene in scenes]) == pytest.approx(speed, rel=0.5)
    table = {"scenes": np.array([[2.0, np.log(5.0), 1.0], [2.0, np.log(20.0), 9.0], [4.0, np.log(2.0), 1.0]])}
    model = SceneModel(tensors={**table, "spread": np.ones(2)}, meta={})
    paces = [model.pace(np.array([1.0]), np.exp(2.0), np.random.default_rng(k)) for k in range(9)]
    assert paces == pytest.approx([5.0] * 9)  # like the first in both


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"vehicles": 0}, "got 0, needs 1 to 500"),
        ({"vehicles": 501}, "got 501, needs 1 to 500"),
        ({"seed": -1}, "--seed: got -1"),
        ({"speed": float("nan")}, "--speed: got nan, needs 0 to 70"),
    ],
)
def test_impossible_requests_are_refused(road: Road, options: dict[str, int], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        generated_scene(road, MODEL, **options)


def test_a_map_without_lanes_or_room_says_so(tmp_path: Path, road: Road) -> None:
    with pytest.raises(UsageError, match="the map has no lane for vehicles"):
        generated_scene(dataclasses.replace(road, lanes={}), MODEL, vehicles=2)
    short = read_road(write_map(tmp_path / "short.osm", [straight(1, 0, 30)]))
    with pytest.raises(SimulationError, match=r"no room for vehicle \d+ of 30 on 0.03 km of lanes"):
        generated_scene(short, MODEL, vehicles=30)


def test_files_of_another_version_or_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file; train again with: scex-sumo train scenes"):
        load_scenes(tmp_path / "none.safetensors")
    text = tmp_path / "text.safetensors"
    text.write_text("no tensors")
    with pytest.raises(InputError, match="not a file that 'scex-sumo train scenes' wrote"):
        load_scenes(text)
    old = tmp_path / "old.safetensors"
    old.write_bytes(safetensors.numpy.save({"mean": np.zeros(3)}, {"scex_sumo": '{"format": "scenes 0"}'}))
    with pytest.raises(InputError, match=f"'scenes 0' of another version, needs '{FORMAT}'"):
        load_scenes(old)
    broken = {name: value for name, value in MODEL.tensors.items() if name != "bins.turn"}
    save_scenes(old, broken, {})
    load_scenes.cache_clear()
    with pytest.raises(InputError, match=r"bins.turn is missing"):
        load_scenes(old)


def test_the_shipped_model_is_small() -> None:
    assert SHIPPED.stat().st_size < 300_000


def test_recorded_vehicles_keep_their_poses_on_lanes() -> None:
    scene = read_seed(example_path("roundabout"), time=4.0, cache=False)
    assert scene.road is not None
    placed, vehicle = placed_on_lanes(scene, KINDS, np.random.default_rng(0))
    states = states_of(lane_cells(scene.road), placed, np.zeros(1))
    now = scene.now[vehicle]
    assert len(vehicle) == scene.vehicles
    off = np.hypot(states.x[:, 0] - now.x, states.y[:, 0] - now.y)
    assert np.median(off) < 0.05 and off.max() < 1.5  # more only where a lane ends
    assert np.abs(np.cos(states.heading[:, 0] - now.heading) - 1).max() < 1e-3  # a curve within that


def test_the_last_second_follows_from_speed_and_acceleration(tmp_path: Path) -> None:
    table = lane_cells(read_road(write_map(tmp_path / "road.osm", [straight(1, 0, 300)])))
    columns = {f.name: np.zeros(3, getattr(NO_VEHICLES, f.name).dtype) for f in dataclasses.fields(Placed)}
    columns |= {"s": np.full(3, 100.0), "speed": np.array([10.0, 1.0, 0.0])}
    columns |= {"acceleration": np.array([-2.0, 2.0, 0.0])}
    states = states_of(table, Placed(**columns), np.array([-1.0, 0.0]))
    assert states.speed[:, 0] == pytest.approx([12.0, 0.0, 0.0])
    # 11 m at 11 m/s on average; from rest half a second ago 0.25 m; none.
    assert np.hypot(np.diff(states.x), np.diff(states.y))[:, 0] == pytest.approx([11.0, 0.25, 0.0], abs=1e-6)


def test_scores_and_draws_are_those_of_the_networks(road: Road) -> None:
    two = {name: value.copy() for name, value in MODEL.tensors.items()}
    for name in [name for name in two if name.startswith("speed.") and name.endswith("weight")]:
        two[name][:] = 0
    last = max(int(name.split(".")[1]) for name in two if name.startswith("speed."))
    two[f"speed.{last}.bias"][:] = np.where(np.arange(len(two["bins.speed"])) == 5, 50.0, -50.0)
    drawn = SceneModel(tensors=two, meta={}).draw(np.zeros((50, len(two["mean"]))), np.random.default_rng(0))
    low, high = two["bins.speed"][5]
    assert ((drawn["speed"] >= low) & (drawn["speed"] <= high)).all()
