"""Generated scenes: free of overlap, on the road, able to go on, and the same for the same seed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from scex_sumo.base.errors import InputError, UsageError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.generators.generate import generated_scene
from scex_sumo.generators.scene_context import (
    NO_VEHICLES,
    ROAD_COLUMNS,
    Placed,
    demands,
    lane_cells,
    placed_on_lanes,
    states_of,
)
from scex_sumo.generators.scene_model import FORMAT, KINDS, SceneModel, load_scenes, save_scenes
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import STEP_S
from tests.converters.maps import Lanelet, straight, write_map

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


LANES_M = 400.0


def known(density: float, speed: float, **road: float) -> list[float]:
    """Return a row of the known scenes of a model."""
    columns = {"free": 1.4, **road}
    return [np.log(density), np.log(speed), *(columns.get(name, 0.0) for name in ROAD_COLUMNS), LANES_M]


def drawn_paces(
    scenes: list[list[float]], density: float, total_m: float = LANES_M, count: int = 9, **road: float
) -> list[float]:
    """Return mean speeds that a model of these scenes draws; -1 and -10 are its slopes."""
    tensors = {"scenes": np.array(scenes), "slopes": np.array([-1.0, -10.0]), "spread": np.ones(99)}
    model = SceneModel(tensors=tensors, meta={})
    target = np.array(known(1.0, 1.0, **road)[2:-1])
    return [model.pace(target, density, total_m, np.random.default_rng(k)) for k in range(count)]


def drawn_pace(scenes: list[list[float]], density: float, **road: float) -> float:
    """Return the one mean speed that a model of these scenes draws."""
    (pace,) = set(np.round(drawn_paces(scenes, density, **road), 6).tolist())
    return pace


def test_an_unknown_mean_speed_is_that_of_a_similar_scene_scaled_by_the_road() -> None:
    sparse, other_road, dense = known(7.0, 5.0), known(7.0, 9.0, width=9.0), known(50.0, 2.0)
    every = [sparse, other_road, dense]
    assert drawn_pace(every, 7.0) == pytest.approx(5.0)
    assert drawn_pace(every, 50.0) == pytest.approx(2.0)
    assert drawn_pace([sparse], 7.0, free=2.8) == pytest.approx(10.0)
    junction = known(7.0, 5.0, conflicts=1.0)
    assert drawn_pace([junction], 7.0, conflicts=1.0, free=2.8) == pytest.approx(10.0)
    assert drawn_pace([sparse, known(27.0, 5.0, width=9.0)], 17.0) == pytest.approx(5.0 * np.exp(-0.1))
    assert drawn_pace([known(7.0, 20.0)], 7.0, free=0.7) == pytest.approx(1.3 * 7.0)  # not 10 m/s
    assert drawn_pace([known(7.0, 20.0)], 7.0, free=3.0) == pytest.approx(30.0)


def test_long_roads_have_the_mean_speed_of_several_scenes() -> None:
    scenes = [known(7.0, 2.0), known(7.0, 6.0)]
    short, long = (drawn_paces(scenes, 7.0, total, count=200) for total in (LANES_M, 25 * LANES_M))
    assert np.unique(np.round(short, 6)).tolist() == [2.0, 6.0]
    assert np.mean(long) == pytest.approx(4.0, abs=0.2) and np.std(long) == pytest.approx(0.4, abs=0.1)


def left_turn() -> Lanelet:
    """Return 60 m straight, a quarter of a circle of 10 m radius, and 60 m straight."""
    angle = np.linspace(0, np.pi / 2, 12)
    bounds = [
        [(0, -side), *np.stack([60 + r * np.sin(angle), 10 - r * np.cos(angle)], 1).tolist(), (60 + r, 70)]
        for side, r in ((-1.75, 8.25), (1.75, 11.75))
    ]
    return Lanelet(1, left=bounds[0], right=bounds[1])


def test_curves_slow_down_before_and_after_them(tmp_path: Path) -> None:
    road = read_road(write_map(tmp_path / "turn.osm", [left_turn()]))
    table = lane_cells(road)
    free = 10 * table.fixed[:, ROAD_COLUMNS.index("free")]
    limit = table.relations.speed_limit[0]
    assert free[table.cell_s < 5.0] == pytest.approx(limit)
    in_curve = np.abs(table.cell_s - 68.0) < 2.0
    assert free[in_curve] == pytest.approx(np.sqrt(2.5 * 10.0), rel=0.1)
    assert (np.diff(free[(table.cell_s > 25) & (table.cell_s < 60)]) < 0.3).all()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"vehicles": 0}, "got 0, needs 1 to 500"),
        ({"vehicles": 501}, "got 501, needs 1 to 500"),
        ({"seed": -1}, "--seed: got -1"),
    ],
)
def test_impossible_requests_are_refused(road: Road, options: dict[str, int], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        generated_scene(road, MODEL, **options)


def test_files_of_another_version_or_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file; train again with: scex-sumo train scenes"):
        load_scenes(tmp_path / "none.safetensors")
    text = tmp_path / "text.safetensors"
    text.write_text("no tensors")
    with pytest.raises(InputError, match=r"no tensors .*; train again with: scex-sumo train scenes"):
        load_scenes(text)
    old = tmp_path / "old.safetensors"
    old.write_bytes(safetensors.numpy.save({"mean": np.zeros(3)}, {"scex_sumo": '{"format": "scenes 0"}'}))
    with pytest.raises(InputError, match=f"format is \"scenes 0\", needs '{FORMAT}'"):
        load_scenes(old)
    spread, bins = MODEL.tensors["spread"], MODEL.tensors["bins.turn"]
    for name, wrong, says in (
        ("bins.turn", None, "bins.turn"),
        ("bins.turn", bins[:-1], r"turn.2.weight is F32 .*, needs F32"),
        ("mean", np.zeros(3), r"mean is F32 \(3,\), needs F32 \(47,\)"),
        ("spread", np.full_like(spread, np.nan), "spread has values that are not finite"),
        ("spread", 0 * spread, "spread has values below 1e-06"),
    ):
        save_scenes(
            old,
            {**MODEL.tensors, name: wrong}
            if wrong is not None
            else {key: value for key, value in MODEL.tensors.items() if key != name},
            {},
        )
        load_scenes.cache_clear()
        with pytest.raises(InputError, match=says):
            load_scenes(old)


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


def placed(count: int, **values: float | list[float]) -> Placed:
    """Return vehicles with these values; the others are 0."""
    columns = {
        f.name: np.zeros(count, getattr(NO_VEHICLES, f.name).dtype) + np.asarray(values.get(f.name, 0))
        for f in dataclasses.fields(Placed)
    }
    return Placed(**{k: v.astype(getattr(NO_VEHICLES, k).dtype) for k, v in columns.items()})


def test_demands_of_a_vehicle_on_its_lane(tmp_path: Path) -> None:
    crossing = Lanelet(2, left=[(98.25, -50), (98.25, 50)], right=[(101.75, -50), (101.75, 50)])
    table = lane_cells(read_road(write_map(tmp_path / "x.osm", [straight(1, 0, 200), crossing])))
    middle = 100.0
    vehicles = placed(
        4,
        s=[middle, middle, middle - 10, middle],
        speed=[0.0, 7.0, 0.0, 2 * table.relations.speed_limit[0]],
        offset=[0.0, 0.0, 1.5, 0.0],
        length=5.0,
        width=2.0,
    )
    found = demands(table, vehicles)
    assert found["on_crossing"].tolist() == [1, 0, 0, 0]
    assert found["over_limit"][3] == pytest.approx(2.0)
    assert found["off_lane"] == pytest.approx([-0.75, -0.75, 0.75, -0.75])  # a lane is 3.5 m wide
    assert found["lateral"] == pytest.approx(np.zeros(4), abs=1e-6)


@pytest.mark.parametrize("name", ["urban_intersection", "roundabout", "motorway_merge"])
def test_no_vehicle_demands_more_than_nearly_all_recorded_ones(name: str) -> None:
    road = read_road(example_path(name))
    for number in range(3):
        scene = generated_scene(road, MODEL, vehicles=15, number=number)
        on_lanes, _ = placed_on_lanes(scene, KINDS, np.random.default_rng(0))
        assert (on_lanes.speed / lane_cells(road).relations.speed_limit[on_lanes.lane]).max() < 1.7
        found = demands(lane_cells(road), on_lanes)
        assert np.quantile(found["lateral"], 0.9) <= MODEL.meta["bounds"]["lateral"]  # lanes may be others
        assert scene.now.speed.mean() < 1.5 * lane_cells(road).relations.speed_limit.max()


def test_scores_and_draws_are_those_of_the_networks(road: Road) -> None:
    two = {name: value.copy() for name, value in MODEL.tensors.items()}
    for name in [name for name in two if name.startswith("speed.") and name.endswith("weight")]:
        two[name][:] = 0
    last = max(int(name.split(".")[1]) for name in two if name.startswith("speed."))
    two[f"speed.{last}.bias"][:] = np.where(np.arange(len(two["bins.speed"])) == 5, 50.0, -50.0)
    drawn = SceneModel(tensors=two, meta={}).draw(np.zeros((50, len(two["mean"]))), np.random.default_rng(0))
    low, high = two["bins.speed"][5]
    assert ((drawn["speed"] >= low) & (drawn["speed"] <= high)).all()
