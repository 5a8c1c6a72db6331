"""People on a hand-made crossing: they keep their way and wait for vehicles, stop, or step out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.people.models import WAIT_M, KeepsWay, KeepsWayProfile, StepsOut, Stops
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, VehicleIndex
from tests.seeds import seed_of, steady

WALKS_MPS, DRIVES_MPS = 1.4, 10.0
PROFILE = KeepsWayProfile(gap=1.0)
EDGE_M = -(1.8 / 2 + 0.3)  # of the car's way, for the centre of a person 0.6 m wide


def crossing(
    vehicle_x: float, person: tuple[float, float, float, float], *, drives: float = DRIVES_MPS
) -> SeedScene:
    """A car along +x on y = 0, and a person at x, y, heading and speed."""
    return seed_of(
        steady((vehicle_x, 0.0, 0.0, drives), person),
        types=("car", "pedestrian"),
        length=np.array([4.5, 0.6]),
        width=np.array([1.8, 0.6]),
        people=np.array([False, True]),
    )


def walks_up(vehicle_x: float, person_y: float, drives: float = DRIVES_MPS) -> SeedScene:
    """The person walks along +y on x = 0."""
    return crossing(vehicle_x, (0.0, person_y, np.pi / 2, WALKS_MPS), drives=drives)


def plan_of(scene: SeedScene, model: KeepsWay | Stops | StepsOut | None = None) -> Plan:
    vehicles = VehicleIndex(future=np.array([0]), vehicle=np.array([1]))
    road = Road(name="none", lanes={})
    return (model or KeepsWay(PROFILE)).plan(SceneHistory.of_scene(scene), road, vehicles, [])


@pytest.mark.parametrize("person_y", [-3.0, -2.5])
@pytest.mark.parametrize("later_s", [-0.15, 0.15])
def test_one_goes_first_exactly_if_the_gap_is_long_enough(person_y: float, later_s: float) -> None:
    arrival_s = (-EDGE_M - person_y) / WALKS_MPS + PROFILE.gap
    x = -(4.5 / 2 + 0.3 + DRIVES_MPS * (arrival_s + later_s))
    plan = plan_of(walks_up(x, person_y))
    if later_s > 0:
        assert plan.y[0, -1] == pytest.approx(person_y + 3 * WALKS_MPS)
    else:
        assert plan.y[0, -1] == pytest.approx(EDGE_M - WAIT_M, abs=0.2)
        assert plan.speed[0, -1] == pytest.approx(0.0, abs=0.1)


def test_one_walks_on_behind_a_vehicle_that_has_passed() -> None:
    plan = plan_of(walks_up(3.0, -2.5))
    assert plan.y[0, -1] == pytest.approx(-2.5 + 3 * WALKS_MPS)


def test_one_that_waited_walks_on_when_the_way_is_free() -> None:
    scene = walks_up(4.0, EDGE_M - WAIT_M)
    stood = replace(scene.history, speed=scene.history.speed.copy())
    history = SceneHistory.of_scene(scene)
    stood.speed[1] = 0.0
    history = replace(history, states=stood[None], step=10)
    plan = KeepsWay(PROFILE).plan(
        history, Road(name="none", lanes={}), VehicleIndex(future=np.array([0]), vehicle=np.array([1])), []
    )
    assert plan.speed[0, -1] == pytest.approx(WALKS_MPS) and plan.y[0, -1] > 0


@pytest.mark.parametrize("car_x", [0.0, 1.5, -2.0])
def test_one_does_not_walk_into_the_side_of_a_standing_car(car_x: float) -> None:
    assert plan_of(walks_up(car_x, -2.5, drives=0.0)).y[0, -1] < EDGE_M
    assert plan_of(walks_up(car_x, -2.5, drives=0.0), Stops()).y[0, -1] < EDGE_M


def test_one_passes_a_standing_car() -> None:
    assert plan_of(walks_up(4.0, -2.5, drives=0.0)).y[0, -1] == pytest.approx(-2.5 + 3 * WALKS_MPS)
    beside = crossing(0.0, (-4.0, -1.3, 0.0, WALKS_MPS), drives=0.0)
    assert plan_of(beside).x[0, -1] == pytest.approx(-4.0 + 3 * WALKS_MPS)


@pytest.mark.parametrize("drives", [0.0, 2.0])
def test_a_cyclist_stays_behind_a_slower_car(drives: float) -> None:
    scene = crossing(0.0, (-12.0, 0.2, 0.0, 5.0), drives=drives)
    plan = plan_of(scene)
    rear = -(4.5 / 2 + 0.3) + drives * 0.1 * np.arange(1, 31)
    assert (plan.x[0] < rear).all() and plan.speed[0, -1] < 5.0


def test_one_in_the_way_of_a_car_that_comes_goes_on() -> None:
    plan = plan_of(walks_up(-20.0, -0.5))
    assert plan.y[0, -1] == pytest.approx(-0.5 + 3 * WALKS_MPS)


def test_people_stop_and_step_out() -> None:
    along = crossing(-20.0, (0.0, -5.0, 0.0, 1.0))
    stops, out = (plan_of(along, model) for model in (Stops(), StepsOut()))
    assert stops.speed[0, -1] == 0.0 and stops.x[0, -1] == pytest.approx(1.0 / 6, abs=0.06)
    # From 5 m beside it crosses the way of the car.
    assert out.x[0, -1] == pytest.approx(0.0, abs=1e-9) and out.y[0, -1] > -1.0
    assert out.speed[0, -1] == pytest.approx(1.5)
