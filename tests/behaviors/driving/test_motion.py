"""Motion: a car that starts where it is, obeys its steering, and joins its path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE, drive
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.behaviors.models.simple import ConstantVelocity, ConstantVelocityProfile
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene, States, VehicleIndex
from tests.behaviors import roads

MODEL = ConstantVelocity(ConstantVelocityProfile(path=0))
LENGTH = 4.5


def driven(where: Road, scene: SeedScene, seconds: float, replan: int = 5) -> States:
    """The first vehicle's states from the seed scene on, (1 + steps)."""
    steps = round(seconds * 10)
    track = roads.closed_loop(MODEL, where, scene, steps=steps, replan=replan)
    return States.concatenate([scene.now[0:1], track[0, 0]], axis=0)


def rear_axle(track: States) -> tuple[FloatArray, FloatArray]:
    back = REAR_AXLE_SHARE * LENGTH
    return track.x - back * np.cos(track.heading), track.y - back * np.sin(track.heading)


def assert_bicycle(track: States) -> None:
    """The rear axle moves along the heading, on arcs of at most 0.2 1/m."""
    x, y = rear_axle(track)
    dx, dy = np.diff(x), np.diff(y)
    turn = wrap(np.diff(track.heading))
    moved = np.hypot(dx, dy)
    moving = moved > 1e-6
    assert np.all(np.abs(turn[~moving]) < 1e-6)
    # On an arc the chord points halfway between the headings at its ends.
    slip = wrap(np.arctan2(dy, dx) - track.heading[:-1] - turn / 2)
    assert np.abs(slip[moving]).max() < 1e-6
    arc = moved[moving] * (turn[moving] / 2) / np.where(turn[moving] == 0, 1, np.sin(turn[moving] / 2))
    arc = np.where(turn[moving] == 0, moved[moving], arc)
    assert (np.abs(turn[moving]) / arc).max() <= 0.2 + 1e-9


STARTS = [(v, d, a) for v in (2, 5, 10, 20, 30) for d in (-2.0, 0.3, 2.0) for a in (-10, 0, 10)]


@pytest.mark.parametrize(("speed", "offset", "degrees"), STARTS)
def test_every_plan_obeys_a_kinematic_bicycle(speed: float, offset: float, degrees: float) -> None:
    scene = roads.scene_of((50.0, offset, np.deg2rad(degrees), speed))
    assert_bicycle(driven(roads.straight(), scene, 3.0, replan=30))


@pytest.mark.parametrize("offset", [0.5, -1.0, 2.0])
@pytest.mark.parametrize("degrees", [-10, -3, 0, 3, 10])
def test_joining_a_straight_lane_at_20_mps_costs_at_most_4_mps2(offset: float, degrees: float) -> None:
    scene = roads.scene_of((50.0, offset, np.deg2rad(degrees), 20.0))
    track = driven(roads.straight(), scene, 8.0)
    before = scene.history[0, 9:10]  # the acceleration at the first step counts too
    whole = States.concatenate([before, track], axis=0)
    ax, ay = np.diff(whole.x, 2) / 0.01, np.diff(whole.y, 2) / 0.01
    heading = whole.heading[1:-1]
    lateral = np.cos(heading) * ay - np.sin(heading) * ax
    assert np.abs(lateral).max() <= 4.0
    assert track.y[-1] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(("speed", "offset"), [(3.0, 0.8), (10.0, 1.5), (20.0, -2.0), (35.0, 1.0)])
def test_a_vehicle_beside_the_centreline_joins_it_and_stays_without_swinging(
    speed: float, offset: float
) -> None:
    scene = roads.scene_of((50.0, offset, 0.0, speed))
    y = driven(roads.straight(2000.0), scene, 15.0).y * np.sign(offset)
    # It neither moves away first nor goes further past the line than a millimetre in a hundred.
    assert y.max() <= abs(offset) + 1e-9
    assert y.min() >= -0.01 * abs(offset)
    assert y[-1] == pytest.approx(0.0, abs=0.01)


def test_the_rear_axle_of_a_truck_keeps_to_its_share_of_the_length() -> None:
    where = roads.road(roads.lane(1, roads.arc(20.0, 3.0, step=0.5)))
    scene = roads.scene_of((0.0, 0.0, 0.0, 6.0), length=12.0)
    track = roads.closed_loop(MODEL, where, scene, steps=60, replan=5)[0, 0]
    x = track.x - REAR_AXLE_SHARE * 12.0 * np.cos(track.heading)
    y = track.y - REAR_AXLE_SHARE * 12.0 * np.sin(track.heading)
    late = slice(30, None)
    # Its centre swings out: R_centre = √(R² + (0.3·12)²).
    assert np.hypot(x, y - 20.0)[late] == pytest.approx(20.0, abs=0.15)
    assert np.hypot(track.x, track.y - 20.0)[late] == pytest.approx(np.hypot(20.0, 3.6), abs=0.15)


MODELS = ("constant_velocity", "standard_driver", "risky_driver", "calibrated_driver", "likely_driver")


@pytest.mark.parametrize("name", MODELS)
def test_on_a_sumo_net_every_model_slows_down_for_a_tight_curve_and_comes_back_to_its_speed(
    name: str,
) -> None:
    turn = roads.arc(6.0, np.pi / 2, (60.0, 0.0), step=0.5)
    leg = np.column_stack([np.full(200, turn[-1, 0]), turn[-1, 1] + np.arange(1.0, 201.0)])
    line = np.concatenate([np.column_stack([np.arange(0.0, 60.0), np.zeros(60)]), turn, leg])
    road = roads.road(roads.lane(1, line))
    scene = roads.scene_of((10.0, 0.0, 0.0, 13.0))
    net = replace(road, net=Path("town.net.xml"), sumo_lanes=True)
    driven = roads.closed_loop(build(parse_models(name)[0]), net, scene, steps=120, replan=5)
    turned = np.diff(np.unwrap(driven.heading[0, 0])) / 0.1
    assert np.abs(turned).max() > 0.5  # it went through the curve
    assert np.abs(turned * driven.speed[0, 0, 1:]).max() < 5.5
    change = np.diff(driven.speed[0, 0]) / 0.1
    assert -6.1 < change.min() < -1.0 and 0.3 < change.max() < 4.1


@pytest.mark.parametrize("aside", [-2.0, 2.0])
def test_a_line_beside_a_bend_is_followed(aside: float) -> None:
    where = roads.road(roads.lane(1, roads.arc(20.0, np.pi, step=0.5)))
    x = 20.0 - aside  # left of the bend is nearer to its centre
    scene = roads.scene_of((x, 20.0 + REAR_AXLE_SHARE * LENGTH, np.pi / 2, 6.0))
    history, vehicles = (
        roads.present(scene),
        VehicleIndex(future=np.zeros(1, dtype=int), vehicle=np.zeros(1, dtype=int)),
    )
    paths, row = chosen_paths(history, where, vehicles, "straight")
    made = drive(
        history, vehicles, paths, row, lambda _, v, *__: 0.0 * v, aside=np.full((1, 31), aside), parallel=True
    )
    x, y = rear_axle(States(x=made.x[0], y=made.y[0], heading=made.heading[0], speed=made.speed[0]))
    off = np.abs(np.hypot(x, y - 20.0) - (20.0 - aside))[:20].max()
    assert off < 0.15


@pytest.mark.parametrize("speed", [2.0, 3.5, 6.0])
def test_after_a_turn_tighter_than_it_can_drive_a_vehicle_does_not_steer_the_other_way(speed: float) -> None:
    """A slow one turns round as sharply as its lane."""
    turn = roads.arc(2.0, np.pi, (50.0, 0.0), step=0.25)
    back = np.column_stack([turn[-1, 0] - np.arange(1.0, 61.0), np.full(60, turn[-1, 1])])
    where = roads.road(roads.lane(1, np.concatenate([[[0.0, 0.0], [49.0, 0.0]], turn, back])))
    track = driven(where, roads.scene_of((44.0, 0.0, 0.0, speed)), 8.0)
    turned = wrap(np.diff(track.heading))
    if speed < 3.0:
        assert turned.max() > 0.4 * 0.2  # beyond an arc of 5 m
        assert rear_axle(track)[1].max() < turn[-1, 1] + 1.0
        return
    assert turned.max() > 0.9 * 0.2 * speed * 0.1  # as far as it can
    assert turned.min() > -0.03
    # A circle of the least radius, 5 m, reaches 6 m beyond one of 2 m.
    assert (track.y - turn[-1, 1]).max() < 8.0
