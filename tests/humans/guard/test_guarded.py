"""The guard: stops in time, gives way in a fixed order, and changes nothing but speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.behaviors.models.simple import ConstantVelocity, ConstantVelocityProfile, Replay
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.drivers.decorators import behavior
from scex_sumo.drivers.registry import ModelSpec, build, parse_models
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.humans.guard.guarded import Guarded
from scex_sumo.humans.parameters import human_parameters
from scex_sumo.plug_in.fallback import Fallible
from scex_sumo.road import Road
from scex_sumo.scene import Obstacles, Plan, SceneHistory, SeedScene, States, VehicleIndex
from tests.behaviors import roads
from tests.seeds import long_recorded, people_of, same_bytes, steady

HUMAN = human_parameters()
GENTLE = 3.5  # m/s²
STEADY = ConstantVelocity(ConstantVelocityProfile())
GUARDED = Guarded(STEADY)
LENGTH = 4.5
CROSS = roads.road(
    roads.lane(1, [(0.0, 0.0), (300.0, 0.0)]), roads.lane(2, [(150.0, -150.0), (150.0, 150.0)])
)
NORTH = np.pi / 2


def hard_braking(scene: SeedScene) -> tuple[int, int]:
    """Replayed vehicles that a guard brakes harder than 3 m/s² in half a second, and all that do not leap."""
    assert scene.road is not None and scene.future_valid is not None
    history, vehicle = (SceneHistory.of_scene(scene), np.flatnonzero(scene.future_valid[:, :30].all(axis=1)))
    vehicles = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    model, now = Replay(), scene.now.speed[vehicle]
    raw, made = (one.plan(history, scene.road, vehicles, []) for one in (model, Guarded(model)))
    smooth = np.abs(np.diff(raw.speed[:, :5], axis=1, prepend=now[:, None])).max(axis=1) < 0.5
    hard = (made.speed[:, 4] - now < -1.5) & (raw.speed[:, 4] - now >= -1.5)
    return int((hard & smooth).sum()), int(smooth.sum())


def run(
    *vehicles: roads.Vehicle,
    where: Road | None = None,
    steps: int = 100,
    model: BatchBehavior = GUARDED,
    obstacles: Obstacles | None = None,
) -> States:
    """Closed loop: (V, 1 + steps), the start first."""
    scene = roads.scene_of(*vehicles, obstacles=obstacles)
    driven = roads.closed_loop(model, where or roads.straight(), scene, steps=steps, replan=5)[0]
    return States.concatenate([scene.now[:, None], driven], axis=1)


def distance(track: States, one: int = 0, other: int = 1) -> np.ndarray:
    """(T,) between the rectangles of two vehicles."""
    sizes = np.array(LENGTH), np.array(1.8)
    return rectangle_distance(Rectangles.of(track[one], *sizes), Rectangles.of(track[other], *sizes))


def accelerations(track: States) -> np.ndarray:
    return np.diff(track.speed, axis=-1) / 0.1


def test_a_driver_that_would_not_brake_stops_behind_a_standing_car() -> None:
    track = run((30.0, 0.0, 0.0, 10.0), (100.0, 0.0, 0.0, 0.0))
    gap = track.x[1] - track.x[0] - LENGTH
    # From 10²/(2·s) = 2.4 m/s² on, as both are apart for 1.5 s, and as hard as it takes to stop before it.
    assert np.all(track.speed[0][gap > 27.0] == 10.0)
    assert track.speed[0][gap < 15.0].max() < 10.0
    assert accelerations(track)[0].min() >= -4.0
    assert track.speed[0, -1] < 0.5
    assert 0.19 < gap[-1] < 2.0


def test_too_late_for_comfort_it_brakes_as_hard_as_the_road_allows_and_no_harder() -> None:
    # 15²/(2·8) = 14.1 m of braking at the limit; 15 m are there.
    track = run((30.0, 0.0, 0.0, 15.0), (30.0 + LENGTH + 15.0, 0.0, 0.0, 0.0), steps=30)
    assert distance(track).min() > 0
    assert -8.0 - 1e-9 <= accelerations(track)[0].min() < -7.0


def test_behind_a_slower_car_it_ends_at_that_speed() -> None:
    track = run((30.0, 0.0, 0.0, 15.0), (70.0, 0.0, 0.0, 8.0), steps=200)
    gap = track.x[1] - track.x[0] - LENGTH
    assert track.speed[0, -1] == pytest.approx(8.0, abs=0.05)
    assert 0.19 < gap[-1] < 2.0
    assert accelerations(track)[0].min() >= -4.0


def test_a_car_in_the_next_lane_and_one_behind_hold_nobody_back() -> None:
    two = roads.road(roads.lane(1, [(0.0, 0.0), (600.0, 0.0)]), roads.lane(2, [(0.0, 3.0), (600.0, 3.0)]))
    vehicles = [(60.0, 0.0, 0.0, 12.0), (63.0, 3.0, 0.0, 11.0), (80.0, 3.0, 0.0, 4.0), (50.0, 0.0, 0.0, 11.0)]
    scene = roads.scene_of(*vehicles)
    history = roads.present(scene)
    first = VehicleIndex(future=np.array([0]), vehicle=np.array([0]))
    made, raw = roads.plan(GUARDED, two, history, first), roads.plan(STEADY, two, history, first)
    assert same_bytes(made, raw)


@pytest.mark.parametrize("ahead", [0.0, 1.0, -1.0, 3.0, -3.0, 8.0, -8.0])
def test_of_two_cars_that_cross_one_goes_first_undisturbed_and_the_other_behind_it(ahead: float) -> None:
    track = run((100.0, 0.0, 0.0, 10.0), (150.0, -50.0 + ahead, NORTH, 10.0), where=CROSS, steps=120)
    assert distance(track).min() > 0.2
    slowest = track.speed.min(axis=1)
    first, second = np.argsort(-slowest)
    assert slowest[first] == 10.0 and slowest[second] < 9.0
    if abs(ahead) > 2.0:
        assert first == (1 if ahead > 0 else 0)
    assert accelerations(track).min() >= -HUMAN.yielding_mps2 - 1e-9
    # Both get through.
    assert track.x[0, -1] > 155.0 and track.y[1, -1] > 5.0


def test_who_reaches_a_crossing_at_the_same_time_goes_by_number() -> None:
    one = run((100.0, 0.0, 0.0, 10.0), (150.0, -50.0, NORTH, 10.0), where=CROSS, steps=60)
    other = run((150.0, -50.0, NORTH, 10.0), (100.0, 0.0, 0.0, 10.0), where=CROSS, steps=60)
    assert one.speed[0].min() == 10.0 and other.speed[0].min() == 10.0
    assert one.speed[1].min() < 9.0 and other.speed[1].min() < 9.0


def test_crossings_with_time_to_spare_slow_nobody_down() -> None:
    # The second one gets to the crossing 3 s after the first, who is through within half a second.
    track = run((100.0, 0.0, 0.0, 10.0), (150.0, -80.0, NORTH, 10.0), where=CROSS, steps=60)
    assert np.all(track.speed == 10.0)


def test_one_who_stands_at_a_crossing_waits_until_the_other_has_passed() -> None:
    class Starts:
        """Goes off at 2 m/s², whoever comes."""

        def plan(
            self,
            history: SceneHistory,
            road: Road,
            vehicles: VehicleIndex,
            rng: Sequence[np.random.Generator],
        ) -> Plan:
            raw = STEADY.plan(history, road, vehicles, rng)
            now = history.now[vehicles.future, vehicles.vehicle]
            t = 0.1 * np.arange(1, 31)
            way = now.speed[:, None] * t + t**2
            go = (vehicles.vehicle == 0)[:, None]
            return replace(
                raw,
                x=np.where(go, now.x[:, None] + way, raw.x),
                speed=np.where(go, now.speed[:, None] + 2 * t, raw.speed),
            )

    vehicles = ((144.0, 0.0, 0.0, 0.0), (150.0, -25.0, NORTH, 12.0))
    assert distance(run(*vehicles, where=CROSS, steps=60, model=Starts())).min() == 0
    track = run(*vehicles, where=CROSS, steps=60, model=Guarded(Starts()))
    assert distance(track).min() > 0.2
    passed = np.argmax(track.y[1] > 1.0 + LENGTH / 2)
    assert track.x[0, passed] < 147.0 and track.x[0, -1] > 155.0


def test_two_lanes_that_become_one_are_left_one_behind_the_other() -> None:
    merge = roads.road(
        roads.lane(1, [(0.0, 0.0), (150.0, 0.0)], successors=(3,)),
        roads.lane(2, [(0.0, -30.0), (150.0, 0.0)], successors=(3,)),
        roads.lane(3, [(150.0, 0.0), (600.0, 0.0)], predecessors=(1, 2)),
    )
    tilt = float(np.arctan2(30.0, 150.0))
    track = run((90.0, 0.0, 0.0, 12.0), (90.0, -12.0, tilt, 12.0), where=merge, steps=120)
    assert distance(track).min() > 0.5
    assert track.speed[:, -1] == pytest.approx(12.0, abs=0.2)
    assert abs(track.x[0, -1] - track.x[1, -1]) > LENGTH


def test_a_pedestrian_on_the_way_is_stopped_for() -> None:
    walk = steady((100.0, -8.0, NORTH, 1.2), time_s=0.1 * np.arange(120))
    scene = roads.scene_of((50.0, 0.0, 0.0, 9.0), obstacles=people_of(walk))
    history = roads.present(scene)
    nearest = []
    for step in range(100):
        now = walk[:, min(10 + step, 119)]
        if step % 5 == 0:
            made = roads.plan(GUARDED, roads.straight(), history)
        state = made[None, :, step % 5]
        states = States.concatenate([history.states[:, :, 1:], state[:, :, None]], axis=2)
        history = replace(history, states=states, step=step + 1)
        inside = abs(float(now.y[0])) < 1.2
        nearest.append(100.0 - 0.3 - LENGTH / 2 - float(state.x[0, 0]) if inside else np.inf)
    assert min(nearest) > 0.5
    assert float(history.now.x[0, 0]) > 104.0  # and goes on afterwards


def bend() -> tuple[Road, SeedScene]:
    """A car enters a bend of 20 m radius, in which another one stands."""
    line = roads.arc(20.0, np.pi, (60.0, 0.0), step=0.5)
    where = roads.road(
        roads.lane(1, [(0.0, 0.0), (60.0, 0.0)], successors=(2,)), roads.lane(2, line, predecessors=(1,))
    )
    return where, roads.scene_of((45.0, 0.3, 0.0, 9.0), (76.0, 8.0, 0.9, 0.0))


def test_the_way_stays_and_only_the_speed_comes_down() -> None:
    where, scene = bend()
    history = roads.present(scene)
    made, raw = roads.plan(GUARDED, where, history), roads.plan(STEADY, where, history)
    assert np.all(made.speed <= raw.speed) and made.speed[0, -1] < 5.0
    planned = np.column_stack([np.append(45.0, raw.x[0]), np.append(0.3, raw.y[0])])
    heading = np.append(0.0, raw.heading[0])
    a, step = planned[:-1], np.diff(planned, axis=0)
    length = np.hypot(*step.T)
    for x, y, towards in zip(made.x[0], made.y[0], made.heading[0], strict=True):
        share = np.clip(((x - a[:, 0]) * step[:, 0] + (y - a[:, 1]) * step[:, 1]) / length**2, 0, 1)
        off = np.hypot(a[:, 0] + share * step[:, 0] - x, a[:, 1] + share * step[:, 1] - y)
        k = int(np.argmin(off))
        assert off[k] < 1e-9
        between = heading[k] + share[k] * wrap(heading[k + 1] - heading[k])
        # Where two segments meet, a point is on both.
        assert abs(wrap(towards - between)) < 1e-6
    # What it moves per step is what its speeds say.
    moved = np.hypot(np.diff(np.append(45.0, made.x[0])), np.diff(np.append(0.3, made.y[0])))
    speeds = np.append(9.0, made.speed[0])
    assert moved == pytest.approx(0.05 * (speeds[1:] + speeds[:-1]), abs=2e-3)


def test_who_was_slowed_down_regains_its_speed_instead_of_leaping() -> None:
    scene = roads.scene_of((30.0, 0.0, 0.0, 10.0))
    history = roads.present(scene)
    speed = history.states.speed.copy()
    speed[..., -1] = 2.0
    slow = replace(history, states=replace(history.states, speed=speed), step=5)
    assert roads.plan(STEADY, roads.straight(), slow).speed[0, 0] == 10.0
    made = roads.plan(GUARDED, roads.straight(), slow)
    assert np.diff(np.append(2.0, made.speed[0])) / 0.1 == pytest.approx(HUMAN.release_mps2)
    assert made.x[0, -1] == pytest.approx(30.0 + 2.0 * 3 + 0.5 * 2.0 * 9)


@pytest.mark.parametrize("model", ["standard_driver:path=0", "constant_velocity:path=0", "replay"])
def test_every_model_that_we_drive_takes_a_guard_and_keeps_it_in_its_name(model: str) -> None:
    (spec,) = parse_models(f"{model}:guard=true")
    assert str(spec) == f"{model}:guard=true"
    built = build(spec)
    assert isinstance(built, Guarded)
    assert type(built.inner) is type(build(ModelSpec(name=spec.name)))
    (plain,) = parse_models(f"{spec.name}:guard=false")
    assert not isinstance(build(plain), Guarded)
    assert isinstance(build(ModelSpec(name=spec.name, parameters={"guard": True})), Guarded)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("standard_driver:guard=maybe", "standard_driver: guard=maybe is neither true nor false"),
        ("sumo:EIDM:guard=true", "sumo:EIDM: unknown parameter 'guard'"),
    ],
)
def test_a_guard_that_makes_no_sense_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_models(text)


@pytest.mark.usefixtures("registered_models")
def test_who_stands_in_for_a_model_that_fails_is_guarded_too() -> None:
    class Broken:
        """Never has a plan."""

        def plan(
            self,
            history: SceneHistory,
            road: Road,
            vehicles: VehicleIndex,
            rng: Sequence[np.random.Generator],
        ) -> Plan:
            raise ValueError("no idea")

    behavior("broken")(Broken)
    (driver,) = ModelSet.of(RunSettings(models="broken:guard=true")).built
    assert isinstance(driver, Guarded) and isinstance(driver.inner, Fallible)
    scene = roads.scene_of((30.0, 0.0, 0.0, 10.0), (45.0, 0.0, 0.0, 0.0))
    made = roads.plan(driver, roads.straight(), roads.present(scene))
    assert made.fallback is not None and made.fallback.all()
    # The front bumper stays behind the rear bumper of the standing car.
    assert made.x[0, -1] + LENGTH < 45.0


def test_a_truck_beside_a_merging_lane_brakes_gently_while_both_miss_each_other() -> None:
    # The other one keeps its heading and passes; its lane joins that of the truck 60 m on.
    where = roads.road(
        roads.lane(1, [(0.0, 0.0), (200.0, 0.0)], successors=(3,)),
        roads.lane(2, [(0.0, 3.5), (110.0, 3.5), (140.0, 1.5), (200.0, 0.0)], successors=(3,)),
        roads.lane(3, [(200.0, 0.0), (500.0, 0.0)], predecessors=(1, 2)),
    )
    vehicles = (100.0, 0.0, 0.0, 14.0), (106.0, 3.3, 0.0, 14.0)
    scene = replace(roads.scene_of(*vehicles), length=np.array([12.0, 4.5]), width=np.array([2.5, 1.8]))
    made = roads.plan(GUARDED, where, roads.present(scene))
    first = np.diff(np.append(14.0, made.speed[0, :5])) / 0.1
    assert first.min() >= -GENTLE
    # The same at once in its way is a real conflict.
    near = replace(scene, history=replace(scene.history, speed=scene.history.speed * [[1.0], [0.3]]))
    near.history.y[1] = 0.5
    near.history.x[1] += 8.0
    assert roads.plan(GUARDED, where, roads.present(near)).speed[0, 4] < 14.0 - 1.5


def first_braking(scene: SeedScene, where: Road) -> float:
    """Return the hardest braking of the first vehicle in half a second of a guarded plan, m/s²."""
    made = roads.plan(GUARDED, where, roads.present(scene))
    return float(-np.diff(np.append(scene.now.speed[0], made.speed[0, :5])).min() / 0.1)


def test_a_leap_of_the_leaders_speed_is_no_braking() -> None:
    scene, where = roads.scene_of((60.0, 0.0, 0.0, 12.0), (76.0, 0.0, 0.0, 7.0)), roads.straight()
    scene.history.speed[1] = 12.0
    scene.history.speed[1, -3:] = 11.0, 9.0, 7.0
    assert first_braking(scene, where) <= GENTLE
    scene.history.speed[1] = np.linspace(12.0, 7.0, 11)
    assert first_braking(scene, where) > 3.0


def test_recorded_people_do_not_trigger_hard_braking(data: Path) -> None:
    # Vehicles whose recording does not leap, each for the half second after a moment.
    seconds = triggered = 0.0
    loaded = load_recording(find_recordings([data / "mona" / "MONA-West"])[0])
    for moment in recording_moments(loaded, every_s=40.0)[1:-1]:
        hard, count = hard_braking(long_recorded(seed_at(loaded, moment.time_s)))
        triggered += hard / 2
        seconds += count / 2
    assert seconds > 30
    assert triggered <= 0.001 * seconds
