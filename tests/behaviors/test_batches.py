"""All models: whole, finite, pure, and the same in any batch."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.drivers.listing import known_entries
from scex_sumo.drivers.registry import build, entry_of, parse_models
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States, VehicleIndex
from tests.behaviors import roads
from tests.learned import nets
from tests.seeds import going_on

OURS = [name for name, entry in known_entries().items() if entry.profile is not None]
NAMES = [*OURS, "sumo:EIDM", "constant_velocity:guard=true", "risky_driver:path=random:guard=true"]
ROAD = roads.fork()


def crowd() -> SeedScene:
    """Nine vehicles on and beside the fork, one far off, with a recorded future."""
    rng = np.random.default_rng(5)
    x = np.array([5.0, 14.0, 23.0, 31.0, 44.0, 56.0, 70.0, 90.0, 30.0])
    y = rng.normal(0, 0.4, 9)
    y[8] = 60.0
    scene = roads.scene_of(*zip(x, y, rng.normal(0, 0.05, 9), rng.uniform(0, 15, 9), strict=True))
    future = going_on(replace(scene.now, heading=np.zeros(9)), 0.1 * np.arange(1, 31))
    future = replace(future, heading=np.repeat(scene.now.heading[:, None], 30, axis=1))
    valid = np.arange(30) < np.array([30, 30, 0, 5, 12, 30, 1, 29, 30])[:, None]
    return replace(scene, future=future, future_valid=valid)


SCENE = crowd()


def history(futures: int = 7) -> SceneHistory:
    """Futures that have come apart, as after some steps."""
    rng = np.random.default_rng(11)
    whole = roads.present(SCENE, futures, rng.random((futures, SCENE.vehicles)))
    states = States(
        x=whole.states.x + rng.normal(0, 0.5, (futures, SCENE.vehicles, 1)),
        y=whole.states.y + rng.normal(0, 0.3, (futures, SCENE.vehicles, 1)),
        heading=whole.states.heading + rng.normal(0, 0.03, (futures, SCENE.vehicles, 1)),
        speed=whole.states.speed,
    )
    return replace(whole, states=states, step=5)


def rows(made: Plan) -> np.ndarray:
    return np.stack([made.x, made.y, made.heading, made.speed])


@pytest.fixture(params=NAMES)
def model(request: pytest.FixtureRequest, tmp_path: Path) -> BatchBehavior:
    name = request.param
    if name in OURS and entry_of(name).may_fail:
        name = f"{name}:weights={nets.untrained(tmp_path, name, SCENE, ROAD)}"
    return build(parse_models(name)[0])


def test_a_plan_has_a_row_per_vehicle_thirty_steps_and_only_finite_numbers(model: BatchBehavior) -> None:
    whole = history()
    made = roads.plan(model, ROAD, whole)
    assert rows(made).shape == (4, 7 * 9, 30)
    assert np.isfinite(rows(made)).all()
    assert np.all(made.speed >= 0)
    assert np.abs(made.heading).max() <= np.pi


def test_planning_changes_nothing_and_repeats_itself(model: BatchBehavior) -> None:
    whole = history()
    before = [whole.states.x.copy(), whole.states.heading.copy(), whole.route_draw.copy()]
    first = rows(roads.plan(model, ROAD, whole))
    assert np.array_equal(rows(roads.plan(model, ROAD, whole)), first)
    after = [whole.states.x, whole.states.heading, whole.route_draw]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_some_of_the_vehicles_get_the_very_plans_they_get_among_all(model: BatchBehavior) -> None:
    whole = history()
    everyone = rows(roads.plan(model, ROAD, whole)).reshape(4, 7, 9, 30)
    for keep in (np.array([3]), np.array([0, 8]), np.array([1, 2, 4, 5, 6, 7])):
        future, vehicle = (a.ravel() for a in np.meshgrid(np.arange(7), keep, indexing="ij"))
        some = rows(roads.plan(model, ROAD, whole, VehicleIndex(future=future, vehicle=vehicle)))
        assert np.array_equal(some, everyone[:, future, vehicle])


def test_a_future_gets_the_very_plans_in_any_batch(model: BatchBehavior) -> None:
    whole = history()
    everyone = rows(roads.plan(model, ROAD, whole)).reshape(4, 7, 9, 30)
    for keep in (np.array([6]), np.array([2, 0]), np.array([1, 3, 5])):
        part = replace(
            whole, states=whole.states[keep], futures=whole.futures[keep], route_draw=whole.route_draw[keep]
        )
        assert np.array_equal(rows(roads.plan(model, ROAD, part)).reshape(4, -1, 9, 30), everyone[:, keep])
