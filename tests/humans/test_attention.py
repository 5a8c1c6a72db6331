"""Attention: how long drivers look away, what they overlook, and how they brake for conflicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.behaviors.driving.paths import BEHIND_M, chosen_paths
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.humans.attention import kept_clear, looks_away
from scex_sumo.humans.guard.conflicts import StopLines
from scex_sumo.humans.guard.guarded import arriving_later, responses, yielding
from scex_sumo.humans.observed.observations import View, leaders_of
from scex_sumo.humans.parameters import human_parameters
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States, VehicleIndex
from tests.behaviors import roads

HUMAN = human_parameters()
DRAW = np.random.default_rng(0).random(3000)


def test_drivers_look_away_for_a_fifth_of_the_time_and_seldom_for_long() -> None:
    time_s = np.arange(0.0, 40.0, 0.1)
    away = looks_away(DRAW[:500], np.repeat(time_s[None], 500, axis=0), HUMAN)
    assert away.mean() == pytest.approx(0.2, abs=0.01)
    assert away[:, 0].mean() == pytest.approx(0.2, abs=0.06)  # at the seed moment, too
    # A glance goes on for 1.7 s in 3 % of the cases: some begin before the last one has ended.
    run = np.lib.stride_tricks.sliding_window_view(away, 17, axis=1).all(axis=2)
    begins = (np.diff(away.astype(int), axis=1) == 1).sum()
    assert 0.01 < (np.diff(run.astype(int), axis=1) == 1).sum() / begins < 0.09


def test_without_inattention_nobody_looks_away() -> None:
    time_s = np.repeat(np.arange(0.0, 10.0, 0.1)[None], 100, axis=0)
    assert not looks_away(DRAW[:100], time_s, HUMAN, 0.0).any()
    assert looks_away(DRAW[:100], time_s, HUMAN, 0.5).mean() < looks_away(DRAW[:100], time_s, HUMAN).mean()


def test_a_driver_looks_away_at_the_same_times_in_any_batch() -> None:
    time_s = np.arange(0.0, 30.0, 0.1)
    many = looks_away(DRAW[:20], np.repeat(time_s[None], 20, axis=0), HUMAN)
    one = looks_away(DRAW[7:8], time_s[None, 100:130], HUMAN)
    assert np.array_equal(many[7, 100:130], one[0])


def view_of(history: SceneHistory, where: Road, vehicles: VehicleIndex) -> View:
    paths, row = chosen_paths(history, where, vehicles, "straight")
    return View(
        history=history,
        vehicles=vehicles,
        paths=paths,
        row=row,
        s=np.full(len(vehicles), BEHIND_M),
        human=HUMAN,
    )


def closing(gap_m: float, speed: float, leader: float) -> SeedScene:
    return roads.scene_of((100.0, 0.0, 0.0, speed), (104.5 + gap_m, 0.0, 0.0, leader))


def driven(model: str | BatchBehavior, scene: SeedScene, steps: int = 30, futures: int = 40) -> States:
    """(C, V, 1 + steps) in closed loop, the start first."""
    history = roads.present(scene, futures, DRAW[: futures * scene.vehicles].reshape(futures, -1))
    states, driver = history.states, build(parse_models(model)[0]) if isinstance(model, str) else model
    for step in range(steps):
        if step % 5 == 0:
            now = type(history)(**{**vars(history), "states": states[:, :, -11:], "step": step})
            made = roads.plan(driver, roads.straight(), now)
        one = made.map(lambda values, at=step % 5: values[:, at].reshape(futures, -1, 1))
        states = States.concatenate(
            [states, States(x=one.x, y=one.y, heading=one.heading, speed=one.speed)], 2
        )
    return states[:, :, 10:]


def test_attentive_drivers_brake_early_and_no_harder_than_it_takes() -> None:
    # 12 m/s onto 4 m/s at 30 m: 8²/(2·30) = 1.1 m/s².
    states = driven("likely_driver:inattention=0", closing(30.0, 12.0, 4.0), steps=50)
    gap = states.x[:, 1] - states.x[:, 0] - 4.5
    braking = -np.diff(states.speed[:, 0], axis=1) / 0.1
    assert gap.min() > 0.3
    assert np.median(braking.max(axis=1)) < 3.0


def test_who_looks_away_reacts_later() -> None:
    # Both went at 12 m/s, 12 m apart, until the leader braked with 4 m/s² in the last half second.
    scene = closing(12.0, 12.0, 12.0)
    speed = scene.history.speed.copy()
    speed[1, -5:] -= 0.4 * np.arange(1, 6)
    scene = replace(scene, history=replace(scene.history, speed=speed))
    way = {}
    for name, share in (("attentive", "0"), ("inattentive", "20")):
        states = driven(f"likely_driver:inattention={share}", scene, steps=15)
        way[name] = states.x[:, 0, -1] - 100.0
    assert way["inattentive"].mean() > way["attentive"].mean() + 0.3


def test_inattention_is_not_negative() -> None:
    with pytest.raises(UsageError, match="inattention"):
        build(parse_models("likely_driver:inattention=-1")[0])


def test_drivers_brake_for_a_vehicle_that_their_planned_way_touches() -> None:
    # The first vehicle changes to the lane of a slower one, 3 m ahead; a straight look ahead sees no leader.
    scene = roads.scene_of((100.0, 0.0, 0.0, 10.0), (108.0, 3.2, 0.0, 6.0))
    history, time = roads.present(scene), 0.1 * np.arange(1, 31)
    x, y = 100.0 + 10.0 * time, 3.2 * np.minimum(time / 2.0, 1.0)
    way = Plan(x=x[None], y=y[None], heading=np.zeros((1, 30)), speed=np.full((1, 30), 10.0))
    vehicles = VehicleIndex(future=np.zeros(1, dtype=int), vehicle=np.zeros(1, dtype=int))
    aware = np.ones((1, 30), dtype=bool)
    made = yielding(way, history, roads.straight(), vehicles, HUMAN, aware)
    other = 108.0 + 6.0 * time
    beside = np.abs(made.y[0] - 3.2) < 1.8
    assert (made.x[0] + 4.5 < other)[beside].all()
    assert made.speed.min() > 4.0  # it slows down to the other's speed, not to a stop


def test_the_front_of_a_long_vehicle_stays_clear_and_its_rear_axle_follows() -> None:
    # A truck at 3 m/s that wants to drift 0.8 m to the left; a vehicle as long is 0.6 m beside it.
    scene = roads.scene_of((100.0, 0.0, 0.0, 3.0), (100.0, 2.4, 0.0, 3.0), length=12.0)
    history = roads.present(scene)
    vehicles = VehicleIndex(future=np.zeros(1, dtype=int), vehicle=np.zeros(1, dtype=int))
    wanted = 0.8 * np.linspace(0.0, 1.0, 31)[None]
    kept = kept_clear(wanted, view_of(history, roads.straight(), vehicles))[0]
    front = kept[:-1] + 9.6 * np.diff(kept) / 0.3
    assert front.max() < 0.16  # half of the room beyond 0.3 m
    assert 0.03 < kept[-1] < kept[-1] + 0.3 < wanted[0, -1]


def bounds_of(v: float, *, safe: bool = False, **values: list[float]) -> FloatArray:
    """Highest speeds of vehicles with a stop line each: values of `StopLines` that are not 0 or inf."""
    count = len(values["position"])
    arrays = {name: np.zeros(count) for name in ("speed", "deceleration", "enter")}
    arrays["until"] = np.full(count, np.inf)
    arrays |= {name: np.array(given) for name, given in values.items()}
    flags = {"firm": np.ones(count, dtype=bool), "safe": np.full(count, safe)}
    aware = np.ones((count, 30), dtype=bool)
    lines, rows = StopLines(row=np.arange(count), **arrays, **flags), np.arange(count)
    return responses(lines, rows, 0, np.zeros(count), np.full(count, v), aware=aware, human=HUMAN)


def test_a_driver_does_not_creep_into_a_vehicle_in_its_way() -> None:
    # Both move so slowly that they stay apart for a while, 0.2 m and 0.7 m before a standing vehicle.
    assert bounds_of(0.3, safe=True, position=[0.2, 0.7]).tolist() == [0.2, np.inf]


def test_a_driver_does_not_creep_into_the_way_of_one_that_crosses_soon() -> None:
    # 0.2 m before the way of vehicles that come in half a second and in 3 s.
    assert bounds_of(0.3, safe=True, position=[0.2, 0.2], enter=[0.5, 3.0]).tolist() == [0.2, np.inf]


def test_a_driver_falls_back_behind_one_that_closes_in_beside_it() -> None:
    # The line of a vehicle at 3 m/s is 0.5 m behind the own front: at 2.5 m/s it gets away.
    bound = bounds_of(2.6, position=[-0.5, -3.5], speed=[3.0, 3.0])
    assert bound.tolist() == [2.5, np.inf]
    assert bounds_of(2.6, safe=True, position=[-0.5], speed=[3.0]).tolist() == [np.inf]


CROSS = roads.road(
    roads.lane(1, [(0.0, 0.0), (300.0, 0.0)]), roads.lane(2, [(150.0, -150.0), (150.0, 150.0)])
)


def responding(*vehicles: roads.Vehicle) -> Plan:
    """Responses of all vehicles to each other at present, if they meant to go straight on."""
    scene = roads.scene_of(*vehicles)
    n = scene.vehicles
    drivers = VehicleIndex(future=np.zeros(n, dtype=int), vehicle=np.arange(n))
    now, time = scene.now[:, None], 0.1 * np.arange(1, 31)
    steady = Plan(
        x=now.x + now.speed * np.cos(now.heading) * time,
        y=now.y + now.speed * np.sin(now.heading) * time,
        heading=np.repeat(now.heading, 30, axis=1),
        speed=np.repeat(now.speed, 30, axis=1),
    )
    aware = np.ones((n, 30), dtype=bool)
    return yielding(steady, roads.present(scene), CROSS, drivers, HUMAN, aware)


def test_a_vehicle_that_creeps_towards_a_crossing_gives_way_to_a_fast_one() -> None:
    # The creeping one would enter the other's way in a second, and be there first.
    made, stands = (
        responding((120.0, 0.0, 0.0, 15.0), (150.0, -4.1, np.pi / 2, speed)) for speed in (1.0, 0.0)
    )
    assert made.speed[1].min() < 0.3
    assert (stands.speed[0] == 15.0).all()  # then the fast one goes on


def test_one_that_crosses_in_front_at_an_angle_is_waited_for() -> None:
    # A vehicle as fast cuts across at 55°: it does not lead the way, its side stays in it.
    turn, time = np.deg2rad(55.0), 0.1 * np.arange(1, 25)
    made = responding((100.0, 0.0, 0.0, 5.0), (104.0, -4.0, turn, 5.0))
    x, y = 104.0 + 5.0 * np.cos(turn) * time, -4.0 + 5.0 * np.sin(turn) * time
    other = States(x=x, y=y, heading=0 * x + turn, speed=0 * x + 5.0)
    one, two = (Rectangles.of(states, 0 * x + 4.5, 0 * x + 1.8) for states in (made[0, :24], other))
    assert rectangle_distance(one, two).min() > 0.3


def test_nobody_brakes_for_one_that_enters_far_behind() -> None:
    # It would enter a second later, 4 m behind or 2 m ahead.
    bound = bounds_of(4.0, position=[-18.0, -12.0], speed=[14.0, 14.0], enter=[1.0, 1.0])
    assert bound[0] == np.inf and bound[1] < 4.0


def test_a_vehicle_stops_before_a_place_that_is_near_and_free_only_later() -> None:
    # 2 m in 2 s from 4 m/s: 2·(4 - 1)/2 = 3 m/s² would take it there after 0.7 s; to stop there takes 4.
    assert arriving_later(np.array([2.0]), np.array([2.0]), np.array([4.0])) == pytest.approx([4.0])
    # 6 m in 2 s: 2·(4 - 3)/2.
    assert arriving_later(np.array([6.0]), np.array([2.0]), np.array([4.0])) == pytest.approx([1.0])


def test_nobody_brakes_for_a_crossing_vehicle_that_leaves_in_time() -> None:
    bound = bounds_of(12.8, position=[29.0, 29.0], until=[1.5, np.inf])
    assert bound[0] == np.inf and bound[1] < 12.6


@pytest.mark.parametrize(("speed", "follows"), [(6.0, False), (0.6, True)])
def test_a_crossing_vehicle_is_a_leader_only_as_long_as_it_is_in_the_way(speed: float, follows: bool) -> None:
    scene = roads.scene_of((110.0, 0.0, 0.0, 12.0), (150.0, 0.0, np.pi / 2, speed))
    history = roads.present(scene)
    vehicles = VehicleIndex(future=np.zeros(1, dtype=int), vehicle=np.zeros(1, dtype=int))
    leaders = leaders_of(view_of(history, CROSS, vehicles), np.zeros(1))
    assert (leaders.index[0] == 1) == follows
