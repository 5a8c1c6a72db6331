"""Gap acceptance on a hand-made crossing, and the people of the stress test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.people import models
from scex_sumo.people.expectation import expected
from scex_sumo.people.models import (
    KeepsWalking,
    Person,
    PersonProfile,
    StepsOut,
    Stops,
    StressProfile,
    Walker,
)
from scex_sumo.people.parameters import people_parameters
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, Plan, SceneHistory, SeedScene, States, VehicleIndex

WALKS_MPS, DRIVES_MPS = 1.4, 10.0
PARAMETERS = replace(people_parameters("pedestrian"), gap_s=1.0)
EXPECTED = PersonProfile(spread=0.0)


@pytest.fixture
def steadily(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let people expect to keep their velocity."""
    steady = {"beyond": np.zeros((2, 2)), "scale": np.ones((2, 2))}
    monkeypatch.setattr(models, "expected", lambda scene: replace(expected(scene), **steady))


def crossing(vehicle_x: float, person_y: float, *, speed: float = DRIVES_MPS) -> SeedScene:
    """A car along +x on y = 0, and a pedestrian that walks along +y on x = 0."""
    back = 0.1 * np.arange(-HISTORY_STEPS, 1)
    history = States(
        x=np.stack([vehicle_x + speed * back, np.zeros(11)]),
        y=np.stack([np.zeros(11), person_y + WALKS_MPS * back]),
        heading=np.repeat([[0.0], [np.pi / 2]], 11, axis=1),
        speed=np.repeat([[speed], [WALKS_MPS]], 11, axis=1),
    )
    return SeedScene(
        name="crossing",
        location="nowhere",
        time_s=0.0,
        track_ids=np.array([1, 2]),
        types=("car", "pedestrian"),
        length=np.array([4.5, 0.6]),
        width=np.array([1.8, 0.6]),
        history=history,
        recorded_steps=np.full(2, 10),
        people=np.array([False, True]),
    )


def plan_of(model: Person | KeepsWalking, scene: SeedScene) -> Plan:
    who = VehicleIndex(future=np.array([0]), vehicle=np.array([1]))
    history = SceneHistory.of_scene(scene)
    return model.plan(history, Road(name="none", lanes={}), who, [np.random.default_rng(0)])


def arrival_s(person_y: float) -> float:
    """Return when the car may arrive at the earliest, if the person is to go first: closed form, s."""
    band_m = 1.8 / 2 + 0.3 + PARAMETERS.margin_m
    return (band_m - person_y) / WALKS_MPS + PARAMETERS.gap_s


@pytest.mark.usefixtures("steadily")
@pytest.mark.parametrize("person_y", [-3.0, -2.5])
@pytest.mark.parametrize("later_s", [-0.1, 0.1])
def test_one_goes_first_exactly_if_the_gap_is_long_enough(person_y: float, later_s: float) -> None:
    body_m = 4.5 / 2 + 0.3
    x = -(body_m + DRIVES_MPS * (arrival_s(person_y) + later_s))
    plan = plan_of(Walker(EXPECTED, PARAMETERS), crossing(x, person_y))
    edge = -(1.8 / 2 + 0.3 + PARAMETERS.margin_m)
    assert (plan.y[0, -1] > edge) == (later_s > 0)
    if later_s > 0:
        assert plan.y[0, -1] == pytest.approx(person_y + 3 * WALKS_MPS)
    else:
        assert plan.y[0, -1] == pytest.approx(edge - PARAMETERS.stop_m, abs=0.15)
        assert plan.speed[0, -1] == pytest.approx(0.0, abs=0.1)


@pytest.mark.usefixtures("steadily")
def test_one_walks_on_behind_a_vehicle_that_has_passed() -> None:
    plan = plan_of(Walker(EXPECTED, PARAMETERS), crossing(3.0, -2.5))
    assert plan.y[0, -1] == pytest.approx(-2.5 + 3 * WALKS_MPS)


@pytest.mark.usefixtures("steadily")
def test_a_cautious_one_waits_where_another_goes() -> None:
    scene = crossing(-(2.55 + DRIVES_MPS * (arrival_s(-2.5) + 0.5)), -2.5)
    goes, waits = (
        plan_of(Walker(replace(EXPECTED, gap=gap), PARAMETERS), scene).y[0, -1] for gap in (0.0, 1.0)
    )
    assert goes > 1.5 and waits < -1.5


@pytest.mark.usefixtures("steadily")
def test_draws_differ_between_futures_and_follow_from_the_route_draw() -> None:
    scene, count = crossing(-200.0, -3.0), 200
    history = SceneHistory(
        scene=scene,
        states=scene.history.repeat(count),
        futures=np.arange(count),
        step=0,
        route_draw=np.repeat((np.arange(count)[:, None] + 0.5) / count, 2, axis=1),
    )
    who = VehicleIndex(future=np.arange(count), vehicle=np.ones(count, dtype=np.int64))
    model, road = Walker(PersonProfile()), Road(name="none", lanes={})
    plan = model.plan(history, road, who, [])
    assert plan.y[:, -1].std() > 0.2 and plan.x[:, -1].std() > 0.2
    alone = model.plan(history, road, who[7:8], [])
    assert np.array_equal(alone.y[0], plan.y[7])


def test_people_of_the_stress_test_go_on_stop_and_step_out() -> None:
    scene, stress = crossing(-20.0, -5.0), StressProfile()
    along = replace(scene, history=scene.history[:, :])
    along.history.heading[1], along.history.speed[1] = 0.0, 1.0
    keeps, stops, out = (plan_of(model(stress), along) for model in (KeepsWalking, Stops, StepsOut))
    assert (keeps.x[0, -1], keeps.y[0, -1]) == pytest.approx((3.0, -5.0))
    assert stops.speed[0, -1] == 0.0 and stops.x[0, -1] == pytest.approx(1.0 / 6, abs=0.06)
    # From 5 m beside it crosses the way of the car.
    assert out.x[0, -1] == pytest.approx(0.0, abs=1e-9) and out.y[0, -1] > -1.0
    assert out.speed[0, -1] == pytest.approx(stress.speed)
