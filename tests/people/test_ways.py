"""Ways of people: cyclists along lanes and behind vehicles, pedestrians along footways in both directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.people import models
from scex_sumo.people.expectation import expected, shown
from scex_sumo.people.models import Cyclist, Person, PersonProfile, Walker
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SeedScene, VehicleIndex
from tests.behaviors import roads

RADIUS_M = 20.0
EXPECTED = PersonProfile(spread=0.0)


def bend(kind: str) -> Road:
    """Three quarters of a circle around (0, 20) to the left, from (-20, 20) over (0, 0)."""
    start = (-RADIUS_M, RADIUS_M)
    return roads.road(roads.lane(1, roads.arc(RADIUS_M, 1.5 * np.pi, start, -np.pi / 2), kind=kind))


def scene_of(kind: str, *states: tuple[float, float, float, float]) -> SeedScene:
    """Road users of x, y, heading and speed; the first one is a person of a kind, the others are cars."""
    scene = roads.scene_of(*states)
    size = (0.6, 0.6) if kind == "pedestrian" else (1.8, 0.6)
    length, width = (np.where(np.arange(scene.vehicles) == 0, size[k], (4.5, 1.8)[k]) for k in (0, 1))
    types = (kind, *("car",) * (scene.vehicles - 1))
    return replace(scene, types=types, length=length, width=width, people=np.arange(scene.vehicles) == 0)


def plan_of(model: Person, scene: SeedScene, road: Road, draws: Sequence[float] = (0.5,)) -> Plan:
    history = roads.present(scene, len(draws), np.repeat(np.array(draws)[:, None], scene.vehicles, axis=1))
    who = VehicleIndex(future=np.arange(len(draws)), vehicle=np.zeros(len(draws), dtype=np.int64))
    return model.plan(history, road, who, [])


@pytest.fixture(autouse=True)
def steadily(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let people expect to keep their velocity."""

    def steady(scene: SeedScene) -> object:
        nothing = np.zeros((scene.vehicles, 2))
        return replace(expected(scene), beyond=nothing, scale=nothing)

    monkeypatch.setattr(models, "expected", steady)


@pytest.mark.parametrize("beside_m", [0.0, -1.0])
def test_a_cyclist_keeps_its_place_in_a_lane_that_bends(beside_m: float) -> None:
    scene = scene_of("bicycle", (0.0, beside_m, 0.0, 5.0))
    plan = plan_of(Cyclist(EXPECTED), scene, bend("vehicle"))
    radius = np.hypot(plan.x[0], plan.y[0] - RADIUS_M)
    # The last half second, in which its direction is measured, was straight.
    assert radius == pytest.approx(RADIUS_M - beside_m, abs=0.3)
    assert plan.heading[0, -1] == pytest.approx(15.0 / RADIUS_M, abs=0.06)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_pedestrian_follows_a_footway_in_both_directions(backwards: bool) -> None:
    end = (RADIUS_M, RADIUS_M, -np.pi / 2, 1.4) if backwards else (0.0, 0.0, 0.0, 1.4)
    plan = plan_of(Walker(EXPECTED), scene_of("pedestrian", end), bend("pedestrian"))
    turn = 1.4 * 3.0 / RADIUS_M * (-1 if backwards else 1)
    assert plan.heading[0, -1] - end[2] == pytest.approx(turn, abs=0.03)


def test_a_pedestrian_that_crosses_a_lane_or_footway_goes_straight_on() -> None:
    across = scene_of("pedestrian", (1.0, -2.0, np.pi / 2, 1.4))
    for kind in ("vehicle", "pedestrian"):
        plan = plan_of(Walker(EXPECTED), across, bend(kind))
        assert plan.x[0, -1] == pytest.approx(1.0) and plan.y[0, -1] == pytest.approx(-2.0 + 4.2, abs=0.01)


def test_a_cyclist_stops_behind_a_standing_car_and_passes_one_that_is_beside_its_line() -> None:
    road = roads.straight()
    waits, passes = (
        plan_of(Cyclist(EXPECTED), scene_of("bicycle", (50.0, y, 0.0, 5.0), (65.0, 0.0, 0.0, 0.0)), road)
        for y in (0.0, -1.6)
    )
    rear_m = 65.0 - 2.25
    assert waits.x[0, -1] + 0.9 < rear_m and waits.speed[0, -1] < 1.5
    assert passes.x[0, -1] == pytest.approx(65.0, abs=0.1)


def test_what_is_expected_turns_with_the_scene() -> None:
    scene = scene_of("pedestrian", (0.0, 0.0, 0.3, 1.4), (12.0, -6.0, 1.9, 6.0))
    cos, sin = np.cos(1.0), np.sin(1.0)
    history = scene.history
    moved = replace(
        history,
        x=5.0 + cos * history.x - sin * history.y,
        y=7.0 + sin * history.x + cos * history.y,
        heading=history.heading + 1.0,
    )
    one, other = expected(scene), expected(replace(scene, history=moved))
    assert one.beyond[0] == pytest.approx(other.beyond[0], abs=1e-9)
    assert (one.scale[0] > 0).all() and np.isfinite(one.beyond[0]).all()


def test_a_shorter_past_gives_wider_draws() -> None:
    scene = scene_of("pedestrian", (0.0, 0.0, 0.0, 1.4))
    short = replace(scene, recorded_steps=np.full(1, 2))
    assert (expected(short).scale[0] > expected(scene).scale[0]).all()
    assert shown(short).own[0, -1] == 0.2


def test_of_two_ways_each_future_takes_its_own() -> None:
    scene = scene_of("bicycle", (45.0, 0.0, 0.0, 7.0))
    plan = plan_of(Cyclist(EXPECTED), scene, roads.fork(), [(k + 0.5) / 9 for k in range(9)])
    ends = np.round(np.sign(plan.y[:, -1].round(1))).tolist()
    assert [ends.count(side) for side in (1, 0, -1)] == [3, 3, 3]
