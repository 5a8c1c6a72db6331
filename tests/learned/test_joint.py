"""The joint predictor: all vehicles of a future are rolled out together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.behaviors.driving.paths import chosen_paths, seed_paths
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.humans.observed.observations import path_edges
from scex_sumo.humans.parameters import human_parameters
from scex_sumo.learned import joint
from scex_sumo.learned.driver import choice_of
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS, path_inputs
from scex_sumo.learned.joint import _ahead, _near, _yielding
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States
from tests.behaviors import roads
from tests.learned import nets
from tests.seeds import same_bytes

ROAD = roads.fork()
SCENE = roads.scene_of(
    (8.0, 0.3, 0.02, 6.0), (20.0, -0.2, 0.0, 5.0), (35.0, 0.0, 0.0, 4.0), (50.0, 0.0, 0.0, 9.0)
)
DRAWS = np.random.default_rng(5).random((6, SCENE.vehicles))


def model(folder: Path, text: str = "joint_predictor", **numbers: int) -> BatchBehavior:
    file = nets.untrained(folder, "joint_predictor", SCENE, ROAD, **numbers)
    return build(parse_models(f"{text}:weights={file}")[0])


def drawn(scene: SeedScene = SCENE, draws: np.ndarray = DRAWS) -> SceneHistory:
    return roads.present(scene, len(draws), draws)


def ends(plan: Plan, futures: int) -> np.ndarray:
    """(C, V) ways of the vehicles in 3 s, along x."""
    return plan.x[:, -1].reshape(futures, -1)


def test_the_plan_is_what_closed_loop_then_drives(tmp_path: Path) -> None:
    driver = model(tmp_path)
    planned = roads.plan(driver, ROAD, roads.present(SCENE))
    driven = roads.closed_loop(driver, ROAD, SCENE, steps=30, replan=5)
    assert same_bytes(driven[0], planned)


@pytest.mark.parametrize(("turn", "shift"), [(0.0, (1000.0, -500.0)), (2.0, (30.0, 7.0))])
def test_the_place_of_the_map_does_not_matter(
    tmp_path: Path, turn: float, shift: tuple[float, float]
) -> None:
    cos, sin = np.cos(turn), np.sin(turn)

    def line(points: np.ndarray) -> np.ndarray:
        return points @ np.array([[cos, sin], [-sin, cos]]) + shift

    def moved(states: States) -> States:
        x, y = np.moveaxis(line(np.stack([states.x, states.y], -1)), -1, 0)
        return States(x=x, y=y, heading=wrap(states.heading + turn), speed=states.speed)

    lanes = {
        key: replace(
            one,
            centreline=line(one.centreline),
            left_bound=line(one.left_bound),
            right_bound=line(one.right_bound),
        )
        for key, one in ROAD.lanes.items()
    }
    driver = model(tmp_path, "joint_predictor:mode=best")
    here = moved(roads.plan(driver, ROAD, drawn()))
    scene = replace(SCENE, history=moved(SCENE.history))
    there = roads.plan(driver, Road(name="moved", lanes=lanes), drawn(scene))
    # Rounded numbers of the network may fall to the other side, and the surface is a grid.
    assert np.hypot(here.x - there.x, here.y - there.y).max() < 0.15
    assert np.abs(here.speed - there.speed).max() < 0.1


def test_the_shipped_follower_goes_with_its_leader_and_drawn_modes_do_not() -> None:
    scene = roads.scene_of((60.0, 0.0, 0.0, 8.0), (68.5, 0.0, 0.0, 6.0))
    draws = np.random.default_rng(0).random((300, 2))
    history = roads.present(scene, len(draws), draws)

    def agreement(text: str) -> float:
        follower, leader = ends(roads.plan(build(parse_models(text)[0]), roads.straight(), history), 300).T
        return float(np.corrcoef(follower, leader)[0, 1])

    assert agreement("joint_predictor") > 0.2
    assert abs(agreement("graph_predictor:mode=draw")) < 0.12


@pytest.mark.parametrize(
    "ahead",
    [(71.0, 0.0, 0.0, 0.0), (80.0, 0.0, 0.0, 0.0), (69.0, 0.0, 0.0, 7.0)],
    ids=["standing", "standing further away", "moving"],
)
def test_drawn_followers_stop_behind_whatever_their_leaders_do(ahead: tuple[float, ...]) -> None:
    scene = roads.scene_of((60.0, 0.0, 0.0, 8.0), ahead)
    draws = np.random.default_rng(0).random((400, 2))
    history = roads.present(scene, len(draws), draws)
    made = roads.plan(build(parse_models("joint_predictor")[0]), roads.straight(), history)
    follower, leader = (made[k::2] for k in range(2))
    size = scene.length[0], scene.width[0]
    boxes = (
        Rectangles.of(one.map(np.ravel), *(np.full(one.x.size, s) for s in size))
        for one in (follower, leader)
    )
    assert rectangle_distance(*boxes).min() > 0


def test_whoever_comes_first_at_a_crossing_the_other_waits(tmp_path: Path) -> None:
    """An untrained network draws any motion; both vehicles can stop at first."""
    crossing = roads.road(
        roads.lane(1, [(0.0, 0.0), (300.0, 0.0)]), roads.lane(2, [(100.0, -100.0), (100.0, 200.0)])
    )
    scene = roads.scene_of((86.0, 0.0, 0.0, 8.0), (100.0, -15.0, np.pi / 2, 8.0))
    draws = np.random.default_rng(0).random((300, 2))
    driver = build(
        parse_models(
            f"joint_predictor:weights={nets.untrained(tmp_path, 'joint_predictor', scene, crossing)}"
        )[0]
    )
    made = roads.plan(driver, crossing, roads.present(scene, len(draws), draws))
    first, second = (made[k::2] for k in range(2))
    size = [np.full(first.x.size, s) for s in (scene.length[0], scene.width[0])]
    boxes = (Rectangles.of(each.map(np.ravel), *size) for each in (first, second))
    assert rectangle_distance(*boxes).min() > 0
    through = first.x[:, -1] > 110.0, second.y[:, -1] > 10.0
    assert all((some & ~other).any() for some, other in (through, through[::-1]))


@pytest.mark.parametrize("prior", [1.0, 0.25])
def test_paths_are_as_probable_as_network_and_likely_driver_agree(tmp_path: Path, prior: float) -> None:
    scene = roads.scene_of((8.0, 0.3, 0.02, 6.0))
    network, driver = (model(tmp_path, f"joint_predictor:prior={weight}") for weight in (0.0, prior))
    alone = choice_of(scene, network, ROAD).paths
    edges = path_edges(scene, seed_paths(scene, ROAD), human_parameters())
    both = np.diff(alone, prepend=0.0) * np.diff(edges, prepend=0.0) ** prior
    assert len(both) > 1 and 0.01 < both[0] / both.sum() < 0.99
    assert np.allclose(choice_of(scene, driver, ROAD).paths, np.cumsum(both) / both.sum(), atol=1e-3)


@pytest.mark.parametrize(
    ("aside", "both", "yields"),
    [(2.3, False, []), (1.85, False, [0]), (1.85, True, [0, 1]), (-1.85, False, [0])],
)
def test_of_two_boxes_that_come_too_near_the_rear_one_yields(
    aside: float, both: bool, yields: list[int]
) -> None:
    history = roads.present(roads.scene_of((0.0, 0.0, 0.0, 5.0), (2.0, 2.3 * np.sign(aside), 0.0, 5.0)))
    x = np.array([[0.0], [2.0]]) + 0.5 * np.arange(1, 6)
    y = np.array([[0.0], [aside]]) + np.zeros(5)
    made = Plan(x=x, y=y, heading=np.zeros((2, 5)), speed=np.full((2, 5), 5.0))
    assert _yielding(history, made, _near(history, made), both=both).tolist() == yields


def test_vehicles_side_by_side_touch_less_often_if_one_yields_or_their_future_is_drawn_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two lanes become one; the motions of an untrained network do not depend on the other vehicle."""
    ahead = [(130.0, 0.0), (300.0, 0.0)]
    lanes = (roads.lane(k, [(0.0, y), (80.0, y), *ahead]) for k, y in ((1, 1.05), (2, -1.05)))
    merge, scene = roads.road(*lanes), roads.scene_of((78.0, 1.05, 0.0, 4.0), (80.0, -1.05, 0.0, 4.0))
    draws = np.random.default_rng(0).random((200, 2))
    file = nets.untrained(tmp_path, "joint_predictor", scene, merge)
    driver = build(parse_models(f"joint_predictor:weights={file}")[0])

    def touching() -> int:
        made = roads.plan(driver, merge, roads.present(scene, len(draws), draws))
        boxes = [Rectangles.of(made[k::2], scene.length[0], scene.width[0]) for k in range(2)]
        return int((rectangle_distance(*boxes) == 0).any(axis=1).sum())

    few = touching()
    monkeypatch.setattr(joint, "REDRAWS", 0)
    some = touching()
    assert 3 * few < some
    monkeypatch.setattr(joint, "_yielding", lambda *_, both: np.empty(0, dtype=int))
    assert 0 < 2 * some < touching()


@pytest.mark.parametrize(("heading", "counts"), [(-0.3, True), (0.0, False), (0.3, False)])
def test_a_vehicle_that_comes_into_the_way_counts_as_ahead(heading: float, counts: bool) -> None:
    history = roads.present(roads.scene_of((60.0, 0.0, 0.0, 8.0), (66.0, 3.0, heading, 6.0)))
    vehicles = roads.every(history)
    inputs = path_inputs(
        history, roads.straight(), vehicles, *chosen_paths(history, roads.straight(), vehicles, "straight")
    )
    pairs = _ahead(history, inputs)
    assert list(zip(pairs.follower, pairs.leader, strict=True)) == [(0, 1)] * counts
    bound = pairs.bound(inputs.features[:, PATH_COLUMNS.index("speed")], np.zeros(2))
    assert np.isfinite(bound).tolist() == [counts, False]
