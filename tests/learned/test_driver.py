"""The learned drivers as behaviour models, with random weights."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import InputError
from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.learned.driver import LearnedDriver, choice_of, loaded
from scex_sumo.learned.inputs.surface import surface_of
from scex_sumo.plug_in.fallback import follow_path
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States, VehicleIndex
from tests.behaviors import roads
from tests.learned import nets
from tests.seeds import same_bytes

NAMES = ("graph_predictor", "graph_image_predictor")
ALL = (*NAMES, "joint_predictor")
DRAWN = "graph_predictor:mode=draw"
ROAD = roads.fork()


def crowd() -> SeedScene:
    """Eleven vehicles on the fork's lanes."""
    rng = np.random.default_rng(3)
    x = np.linspace(2.0, 105.0, 11)
    return roads.scene_of(*zip(x, rng.normal(0, 0.3, 11), rng.normal(0, 0.03, 11), rng.uniform(0, 14, 11)))  # noqa: B905


SCENE = crowd()


def driver(folder: Path, text: str, scene: SeedScene = SCENE) -> BatchBehavior:
    name = text.partition(":")[0]
    file = nets.untrained(folder, name, scene, ROAD)
    return build(parse_models(f"{text}:weights={file}")[0])


def apart(futures: int) -> SceneHistory:
    """Futures that have come apart, with draws of their own."""
    rng = np.random.default_rng(4)
    history = roads.present(SCENE, futures, rng.random((futures, SCENE.vehicles)))
    for values, spread in ((history.states.x, 0.5), (history.states.y, 0.2), (history.states.heading, 0.02)):
        values += rng.normal(0, spread, (futures, SCENE.vehicles, 1))
    return replace(history, step=5)


def same(one: Plan, other: Plan, rows: slice | np.ndarray = slice(None)) -> bool:
    return same_bytes(one[rows], other)


@pytest.mark.parametrize("name", NAMES)
def test_who_stands_starts_behind_one_that_moves_or_after_three_seconds(tmp_path: Path, name: str) -> None:
    alone = roads.scene_of((10.0, 0.0, 0.0, 0.0))
    behind = roads.scene_of((10.0, 0.0, 0.0, 0.0), (25.0, 0.0, 0.0, 5.0))
    model = driver(tmp_path, f"{name}:path=straight", behind)
    assert isinstance(model, LearnedDriver)

    def starts(scene: SeedScene, step: int = 0) -> bool:
        history = replace(roads.present(scene), step=step)
        plan = model.plan(history, ROAD, VehicleIndex(future=np.zeros(1, int), vehicle=np.zeros(1, int)), [])
        return bool((plan.speed > 0).any())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scex_sumo.learned.driver.START_LIKELY", 0.0)  # the network always starts
        patch.setattr("scex_sumo.learned.driver.rounded", lambda values: np.ones(values.shape))
        assert not starts(alone)
        assert starts(behind)
        assert starts(alone, step=30)


@pytest.mark.parametrize("text", [*ALL, "graph_image_predictor:attention=0", "graph_predictor:mode=draw"])
def test_nobody_reverses_and_every_box_stays_on_the_road(tmp_path: Path, text: str) -> None:
    straight = roads.straight()
    scene = roads.scene_of(*[(20.0 + 15 * k, 0.1 * (k % 5 - 2), 0.0, float(k)) for k in range(12)])
    made = roads.plan(driver(tmp_path, text, scene), straight, roads.present(scene))
    assert made.speed.min() >= 0
    assert made.x.shape == (12, 30)
    assert np.abs(made.y).max() < 1.75 - 0.9 + 0.25  # a cell of the surface
    assert surface_of(straight).at(made.x, made.y).min() > 0


@pytest.mark.parametrize(
    "text",
    [*ALL, "joint_predictor:mode=best", "graph_image_predictor:head=free", DRAWN, f"{DRAWN}:guard=true"],
)
def test_a_future_gets_the_same_bytes_in_any_batch_from_any_process(tmp_path: Path, text: str) -> None:
    model = driver(tmp_path, text)
    history = apart(24)
    whole = roads.plan(model, ROAD, history)
    again = pickle.loads(pickle.dumps(model))
    for size in (1, 7):
        for first in range(0, 24 if size > 1 else 6, size):
            some = slice(first, min(first + size, 24))
            part = replace(
                history,
                states=history.states[some],
                futures=history.futures[some],
                route_draw=history.route_draw[some],
            )
            rows = slice(some.start * SCENE.vehicles, some.stop * SCENE.vehicles)
            assert same(whole, roads.plan(again, ROAD, part), rows)


@pytest.mark.parametrize("name", NAMES)
def test_vehicles_off_the_map_are_left_to_the_path_following_driver_and_counted(
    tmp_path: Path, name: str
) -> None:
    scene = roads.scene_of((8.0, 0.0, 0.0, 6.0), (20.0, 60.0, 1.0, 5.0), (35.0, 0.0, 0.0, 4.0))
    history = roads.present(scene, 2)
    made = roads.plan(driver(tmp_path, name, scene), ROAD, history)
    assert made.fallback is not None
    assert made.fallback.tolist() == [False, True, False] * 2
    assert made.reasons[1] == "was not on a mapped lane in the seed scene"
    assert made.reasons[0] == ""
    alone = follow_path(history, ROAD, VehicleIndex(future=np.arange(2), vehicle=np.ones(2, dtype=int)))
    assert same(made, alone, np.array([1, 4]))


def modes_driven(model: BatchBehavior, history: SceneHistory) -> np.ndarray:
    """(n,) which mode each vehicle drives, as the driver chooses it."""
    assert isinstance(model, LearnedDriver)
    vehicles = roads.every(history)
    paths, row = model._paths(history, ROAD, vehicles)
    _, modes = model.predict(history, ROAD, vehicles, paths, row)
    return model._modes(history, ROAD, vehicles, row, modes)


@pytest.mark.parametrize("name", NAMES)
def test_a_drawn_mode_is_as_frequent_as_it_is_probable_and_stays(tmp_path: Path, name: str) -> None:
    model = driver(tmp_path, f"{name}:mode=draw")
    assert isinstance(model, LearnedDriver)
    futures = 500
    draw = np.random.default_rng(0).random((futures, SCENE.vehicles))
    history = roads.present(SCENE, futures, draw)
    driven = modes_driven(model, history).reshape(futures, SCENE.vehicles)
    upper = choice_of(SCENE, model, ROAD).modes
    _, row = model._paths(history, ROAD, roads.every(history))
    shares = np.diff(upper[row[: SCENE.vehicles]], axis=1, prepend=0.0)
    counted = np.stack([(driven == mode).mean(0) for mode in range(shares.shape[1])], 1)
    assert np.abs(counted - shares).max() < 4 * np.sqrt(0.25 / futures)
    later = replace(apart(64), route_draw=draw[:64])
    assert np.array_equal(modes_driven(model, later), driven[:64].ravel())


def test_paths_are_drawn_as_often_as_the_network_holds_them_probable(tmp_path: Path) -> None:
    model = driver(tmp_path, "graph_predictor:path=likeliest:mode=draw")
    assert isinstance(model, LearnedDriver)
    futures = 400
    draw = np.random.default_rng(0).random((futures, SCENE.vehicles))
    history = roads.present(SCENE, futures, draw)
    paths, row = model._paths(history, ROAD, roads.every(history))
    edges = choice_of(SCENE, model, ROAD).paths
    shares = np.diff(edges, prepend=0.0)
    shares[paths.first] = edges[paths.first]
    taken = row.reshape(futures, -1) - paths.first
    assert (taken < paths.count).all()
    counted = np.bincount(row, minlength=len(edges)) / futures
    assert np.abs(counted - shares).max() < 4 * np.sqrt(0.25 / futures)
    assert (paths.count > 1).any()


def test_attention_changes_what_is_driven(tmp_path: Path) -> None:
    plans = [
        roads.plan(driver(tmp_path, f"graph_image_predictor:attention={w}"), ROAD, roads.present(SCENE)).x
        for w in (0, 0.5, 1)
    ]
    assert np.abs(plans[0] - plans[1]).max() > 0.01
    assert np.abs(plans[1] - plans[2]).max() > 0.01


def test_weights_that_change_while_a_run_goes_on_are_not_mixed(tmp_path: Path) -> None:
    model = driver(tmp_path, "graph_predictor")
    assert isinstance(model, LearnedDriver)
    before, sha256 = roads.plan(model, ROAD, roads.present(SCENE)), model.weights_sha256
    file = nets.untrained(tmp_path, "graph_predictor", SCENE, ROAD, modes=3)
    assert same(before, roads.plan(model, ROAD, roads.present(SCENE)))
    assert model.weights_sha256 == sha256
    loaded.cache_clear()  # as in another process
    with pytest.raises(InputError, match=f"{file}: has changed since the run began; run again"):
        roads.plan(pickle.loads(pickle.dumps(model)), ROAD, roads.present(SCENE))


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("guard", ["", ":guard=true"])
@pytest.mark.parametrize(("speed", "gap"), [(5.0, 15.0), (13.0, 50.0)])
def test_the_shipped_drivers_stop_behind_a_standing_vehicle_and_need_no_guard_for_it(
    name: str, speed: float, gap: float, guard: str
) -> None:
    scene = roads.scene_of((50.0, 0.0, 0.0, speed), (50.0 + gap + 4.5, 0.0, 0.0, 0.0))
    model = build(parse_models(f"{name}{guard}")[0])
    history = roads.present(scene)
    first = VehicleIndex(future=np.zeros(1, dtype=int), vehicle=np.zeros(1, dtype=int))
    for step in range(0, 60, 5):
        made = roads.plan(model, roads.straight(), history, first)
        driven = made[None, :, :5]
        standing = history.states[:, 1:, 6:]
        window = States.concatenate([history.states[:, :1, 5:], driven], axis=2)
        still = States.concatenate([standing, standing], axis=2)[:, :, :10]
        still = States.concatenate([still, standing[:, :, :1]], axis=2)
        history = replace(history, states=States.concatenate([window, still], axis=1), step=step + 5)
        assert history.now.x[0, 0] < 50.0 + gap
