"""Plans from predictions: where they go, and where they must not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.driving.motion import driven
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.humans.guard.guarded import Guarded
from scex_sumo.learned.decoding import EDGE_MARGIN_M, intent_along, plan_freely
from scex_sumo.learned.inputs.surface import CELL_M
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene
from tests.behaviors import roads
from tests.learned import nets
from tests.seeds import same_bytes

WIDE = roads.road(roads.lane(1, [(0.0, 0.0), (600.0, 0.0)], width=12.0))
TIMES = 0.1 * np.arange(1, 31)


def along(
    road: Road,
    scene: SeedScene | SceneHistory,
    acceleration: FloatArray,
    offset: FloatArray,
    *,
    clear: bool = False,
) -> Plan:
    history = scene if isinstance(scene, SceneHistory) else roads.present(scene)
    vehicles = roads.every(history)
    paths, row = chosen_paths(history, road, vehicles, "straight")
    rows = np.broadcast_to(acceleration, (len(vehicles), 30))
    wanted = np.broadcast_to(offset, (len(vehicles), 30))
    return driven(history, [intent_along(history, vehicles, paths, row, rows, wanted, road, clear=clear)])[0]


@pytest.mark.parametrize("speed", [8.0, 15.0, 30.0])
@pytest.mark.parametrize("aim", [1.75, -1.75])
def test_a_smooth_change_of_the_offset_is_followed(speed: float, aim: float) -> None:
    u = TIMES / 3
    wanted = aim * u**3 * (10 - 15 * u + 6 * u**2)
    made = along(WIDE, roads.scene_of((50.0, 0.0, 0.0, speed)), np.zeros(30), wanted)
    # The third derivative is not fed forward: at 8 m/s, 0.15 m of 1.75 m.
    assert np.abs(made.y[0] - wanted).max() < 0.2
    lateral = np.diff(made.y[0], 2) / 0.01
    assert np.abs(lateral).max() < 1.6  # the wanted one has 1.1 m/s²


@pytest.mark.parametrize("aim", [8.0, -8.0])
def test_the_box_stays_on_the_road_whatever_the_network_wants(aim: float) -> None:
    made = along(WIDE, roads.scene_of((50.0, 0.0, 0.0, 10.0)), np.zeros(30), aim * TIMES / 3)
    assert np.abs(made.y).max() + 0.9 < 6.0
    assert np.abs(made.y).max() > 6.0 - 0.9 - EDGE_MARGIN_M - 1.5 * CELL_M - 0.3  # but uses what there is


def test_a_driver_makes_way_before_the_road_narrows() -> None:
    narrowing = roads.road(
        roads.lane(1, [(0.0, 0.0), (100.0, 0.0)], width=10.0, successors=(2,)),
        roads.lane(2, [(100.0, 0.0), (300.0, 0.0)], width=3.5, predecessors=(1,)),
    )
    made = along(narrowing, roads.scene_of((80.0, 2.5, 0.0, 10.0)), np.zeros(30), np.full(30, 2.5))
    inside = made.x[0] > 101.0
    assert inside.sum() > 5
    assert np.abs(made.y[0, inside]).max() + 0.9 < 1.75 + CELL_M


def least_distance(scene: SeedScene, made: Plan) -> float:
    sizes = scene.length[0], scene.width[0]
    return float(rectangle_distance(*(Rectangles.of(made[k], *sizes) for k in (0, 1))).min())


@pytest.mark.parametrize("behind", [0.0, 3.0, 12.0])
@pytest.mark.parametrize("apart", [2.4, 3.0])
def test_two_who_head_for_each_other_side_by_side_do_not_touch(behind: float, apart: float) -> None:
    scene = roads.scene_of(
        (60.0, apart / 2, -0.04, 12.0), (60.0 - behind, -apart / 2, 0.04, 12.0 + behind / 1.5)
    )
    # Both aim at the middle of the road, and go on as they are at first.
    u = TIMES / 3
    fades, drifts = 1 - u**3 * (10 - 15 * u + 6 * u**2), 0.48 * 3 * (u - u**3 * (6 - 8 * u + 3 * u**2))
    wanted = np.array([[1.0], [-1.0]]) * (apart / 2 * fades - drifts)
    assert least_distance(scene, along(WIDE, scene, np.zeros(30), wanted)) == 0.0
    made = along(WIDE, scene, np.zeros(30), wanted, clear=True)
    assert least_distance(scene, made) > 0.15
    assert np.abs(np.diff(made.y, 2, axis=1)).max() < 0.04  # 4 m/s²


@pytest.mark.parametrize("name", ["graph_predictor", "graph_image_predictor"])
def test_with_the_guard_a_driver_steers_clear_of_who_is_beside_it_and_without_it_does_not(
    tmp_path: Path, name: str
) -> None:
    close = roads.scene_of((50.0, 1.1, -0.04, 10.0), (50.0, -1.1, 0.04, 10.0))
    alone = roads.scene_of((50.0, 1.1, -0.04, 10.0), (90.0, -1.1, 0.04, 10.0))
    raw = build(parse_models(f"{name}:weights={nets.untrained(tmp_path, name, close, roads.fork())}")[0])
    models = raw, Guarded(raw).inner
    before, after = (roads.plan(model, WIDE, roads.present(close)) for model in models)
    assert np.all(after.y[0] - after.y[1] > before.y[0] - before.y[1] - 1e-9)
    assert after.y[0, 20] - after.y[1, 20] > 2.1
    one, other = (roads.plan(model, WIDE, roads.present(alone)) for model in models)
    assert same_bytes(one, other)


def test_a_free_trajectory_is_taken_as_it_is_in_the_vehicles_own_frame() -> None:
    history = roads.present(roads.scene_of((50.0, 7.0, np.pi / 2, 4.0)))
    free = np.stack([4 * TIMES, TIMES**2], -1)[None]
    made = plan_freely(history, roads.every(history), free)
    assert made.x[0] == pytest.approx(50 - TIMES**2)
    assert made.y[0] == pytest.approx(7 + 4 * TIMES)
    middle = TIMES - 0.05
    assert made.heading[0] == pytest.approx(np.pi / 2 + np.arctan(2 * middle / 4))
    assert made.speed[0] == pytest.approx(np.hypot(4, 2 * middle))


def test_a_replan_continues_the_plan() -> None:
    scene = roads.scene_of((50.0, 1.0, 0.0, 10.0))
    whole = along(WIDE, scene, np.full(30, -1.0), np.exp(-TIMES / 3))
    history = roads.present(scene)
    states = history.states.map(np.copy)
    states.assign((slice(None), slice(None), slice(0, 6)), history.states[:, :, 5:])
    states.assign((0, 0, slice(6, None)), whole[0, :5])
    history = replace(history, states=states, step=5)
    further = along(WIDE, history, np.full(30, -1.0), whole.y[0, 4] * np.exp(-TIMES / 3))
    assert further.y[0, :20] == pytest.approx(whole.y[0, 5:25], abs=0.03)
    assert further.x[0, :20] == pytest.approx(whole.x[0, 5:25], abs=0.01)
