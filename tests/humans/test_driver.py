"""Likely driver: drawn from a population, the same in every plan, as the last second shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.draws import uniforms
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.driving.leaders import Leaders
from scex_sumo.behaviors.driving.paths import seed_paths
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.humans.driver import LikelyDriver, LikelyProfile, human_of
from scex_sumo.humans.observed.observations import (
    behind_a_wave,
    kept_headway,
    last_second,
    observations_of,
    path_edges,
    start_features,
)
from scex_sumo.humans.parameters import human_parameters
from scex_sumo.humans.terms import lateral_offsets, node_weights, spread_factor, students
from scex_sumo.intention import Intention
from scex_sumo.road import Lane
from tests.behaviors import roads

HUMAN = human_parameters()
DRIVER = LikelyDriver(LikelyProfile())
DRAW = np.linspace(0.01, 0.99, 50)


def test_numbers_from_a_draw_are_uniform_and_follow_from_it_alone() -> None:
    draw = np.random.default_rng(0).random(4000)
    found = uniforms(draw, 3)
    assert np.abs(np.histogram(found, 10, (0, 1))[0] / found.size - 0.1).max() < 0.01  # 3.6 sigma
    assert np.abs(np.corrcoef(np.column_stack([found, draw]).T) - np.eye(4)).max() < 0.06
    assert (uniforms(draw[7:8], 3) == found[7]).all()
    assert not (uniforms(draw, 3, 1) == found).any()


def test_normal_and_student_numbers_have_their_spread() -> None:
    draw = uniforms(np.random.default_rng(1).random(20000), 5)
    assert ndtri(draw[:, 0]).std() == pytest.approx(1.0, abs=0.02)
    # Quartiles of Student's distribution with four degrees of freedom: 0.741.
    assert np.quantile(students(draw), 0.75) == pytest.approx(0.741, abs=0.02)


def test_drivers_of_other_futures_differ_and_those_of_one_future_stay_the_same() -> None:
    where, scene = roads.straight(), roads.scene_of((100.0, 0.0, 0.0, 10.0))
    history = roads.present(scene, 50, DRAW[:, None])
    made = roads.plan(DRIVER, where, history)
    assert np.ptp(made.x[:, 29]) > 2.0
    again = roads.plan(DRIVER, where, roads.present(scene, 1, DRAW[10:11, None]))
    assert (again.x[0] == made.x[10]).all()


def test_without_spread_all_drive_as_expected() -> None:
    where, scene = roads.straight(), roads.scene_of((100.0, 0.0, 0.0, 10.0))
    driver = LikelyDriver(LikelyProfile(spread=0.0))
    made = roads.plan(driver, where, roads.present(scene, 50, DRAW[:, None]))
    assert np.ptp(made.x[:, 29]) < 1e-9


def test_a_heading_across_the_lane_is_motion_across_it_but_for_vehicles_of_sumo() -> None:
    # SUMO has both ends of a vehicle on the lane, so that in a bend its heading leads that of the rear axle.
    where, scene = roads.straight(), roads.scene_of((100.0, 0.0, 0.3, 5.0))
    sumos = replace(scene, intentions=(Intention(edges=("a",)),))
    for of, swerve in ((scene, 5 * np.sin(0.3)), (sumos, 0.0)):
        human = human_of(of)
        lateral = observations_of(of, seed_paths(of, where), human).lateral[0]
        assert lateral[1] == pytest.approx(swerve, abs=0.05)


def test_a_standing_vehicle_behind_a_standing_leader_stays() -> None:
    where = roads.straight()
    scene = roads.scene_of((100.0, 0.0, 0.0, 0.0), (107.0, 0.0, 0.0, 0.0))
    made = roads.plan(DRIVER, where, roads.present(scene, 50, np.column_stack([DRAW, DRAW[::-1]])))
    moved = np.abs(made.x[::2, 29] - 100.0) > 0.5
    assert moved.mean() < 0.15  # at a rate of 0.02 1/s some 6 % start


def test_a_vehicle_that_crawls_goes_on_crawling() -> None:
    where, scene = roads.straight(), roads.scene_of((100.0, 0.0, 0.0, 0.3), (112.0, 0.0, 0.0, 0.0))
    made = roads.plan(DRIVER, where, roads.present(scene, 50, np.column_stack([DRAW, DRAW[::-1]])))
    way = made.x[::2, 29] - 100.0
    assert 0.5 < np.median(way) < 1.3  # 0.9 m at 0.3 m/s


def test_a_leader_that_passes_does_not_begin_a_start() -> None:
    # Standing; moving off; much faster than a vehicle can be that stood 4 m ahead; coming closer.
    leader = np.array([0.0, 2.0, 10.0, -4.0])
    found = start_features(np.zeros(4), np.full(4, 4.0), leader, np.ones(4, dtype=bool), HUMAN)
    assert found[:, 2].tolist() == [0, 1, 0, 0]
    assert found[:, 4].tolist() == [1, 0, 0, 0]
    leaders = Leaders(gap=np.full(2, 4.0), speed=np.zeros(2), index=np.array([1, 1]))
    speed, queue = np.array([[0.0, 0.0, 1.5], [0.0, 0.0, 9.0]]), np.array([1, 2, -1])
    assert behind_a_wave(speed, leaders, np.array([0, 1]), queue, HUMAN).tolist() == [True, False]


def test_ways_across_begin_as_shown_and_end_where_the_driver_wants_to_be() -> None:
    shown, time_s = np.array([[0.5, -0.2, 0.1]]), np.arange(0.0, 5.01, 0.01)
    way = lateral_offsets(shown, np.array([-0.3]), time_s, HUMAN)[0]
    speed = np.gradient(way, 0.01)
    assert way[0] == pytest.approx(0.5)
    assert speed[1] == pytest.approx(-0.2, abs=0.01)
    assert np.diff(way, 2)[:3] / 1e-4 == pytest.approx(0.1, abs=0.1)  # whose change is at most 3 m/s³
    assert way[time_s >= 3.0] == pytest.approx(-0.3)


def test_who_shows_that_it_brakes_gets_less_far() -> None:
    where, scene = roads.straight(), roads.scene_of((100.0, 0.0, 0.0, 10.0))
    speed = scene.history.speed.copy()
    speed[0] = 10.0 + np.linspace(2.0, 0.0, 11)
    braking = replace(scene, history=replace(scene.history, speed=speed))
    assert last_second(braking, HUMAN).acceleration[0] == pytest.approx(-2.0 / np.hypot(1, 2 * 0.5), abs=0.05)
    steady = roads.plan(DRIVER, where, roads.present(scene, 50, DRAW[:, None])).x[:, 29]
    slower = roads.plan(DRIVER, where, roads.present(braking, 50, DRAW[:, None])).x[:, 29]
    assert slower.mean() < steady.mean() - 3.0


def test_accelerations_that_scatter_are_believed_less() -> None:
    scene = roads.scene_of((100.0, 0.0, 0.0, 10.0))
    speed = scene.history.speed.copy()
    speed[0] = 10.0 + np.linspace(-2.0, 0.0, 11) + 0.3 * (-1.0) ** np.arange(11)
    noisy = replace(scene, history=replace(scene.history, speed=speed))
    assert abs(last_second(noisy, HUMAN).acceleration[0]) < 0.3


def test_a_large_acceleration_of_a_noisy_track_counts_no_more_than_a_small_one() -> None:
    scene = roads.scene_of((0.0, 0.0, 0.0, 10.0), (50.0, 0.0, 0.0, 10.0), (100.0, 0.0, 0.0, 10.0))
    speed = scene.history.speed + np.array([[0.5], [3.0], [3.0]]) * 0.1 * np.arange(-10, 1)
    speed[2] += 0.04 * (-1) ** np.arange(11)  # steps of 0.08 m/s: 0.8 m/s² up and down
    shown = replace(scene, history=replace(scene.history, speed=speed))
    small, clean, noisy = last_second(shown, HUMAN).acceleration
    assert small == pytest.approx(0.5, rel=0.05)
    assert 1.5 < clean < 2.0 and 0.5 < noisy < 1.3


def test_drivers_begin_with_the_acceleration_of_the_last_step_on_clean_tracks() -> None:
    where, scene = roads.straight(), roads.scene_of((0.0, 0.0, 0.0, 10.0), (100.0, 0.0, 0.0, 10.0))
    speed = scene.history.speed.copy()
    speed[:, :10] += 0.1 * np.cumsum(np.linspace(0.0, 1.8, 10))[::-1]  # the braking ends
    speed[1] += 0.1 * (-1.0) ** np.arange(11)
    clean = replace(scene, history=replace(scene.history, speed=speed))
    shown = last_second(clean, HUMAN)
    assert shown.acceleration[0] < -0.5
    assert (shown.acceleration + shown.sudden)[0] == pytest.approx(0.0, abs=0.1)
    assert abs(shown.sudden[1]) < 0.05  # its noise says nothing of the last step
    driver = LikelyDriver(LikelyProfile(spread=0, inattention=0))
    first = roads.plan(driver, where, roads.present(clean, 1)).speed[0, 0]
    assert (first - 10.0) / 0.1 > -0.5


def test_own_accelerations_are_linear_between_their_times() -> None:
    assert node_weights(0.0, HUMAN).tolist() == [1.0, 0.0]
    assert node_weights(0.75, HUMAN).tolist() == [0.75, 0.25]
    assert node_weights(9.0, HUMAN).tolist() == [0.0, 1.0]


def test_noise_of_the_boxes_adds_to_what_people_differ_by_as_a_square() -> None:
    shown = np.array([[0.0, 0.0, 0.0], [0.75, 0.0, 0.0], [0.0, 1.0, 2.0]])
    factor = spread_factor(shown, np.array([1.0, 1.0 / 0.75]), np.array([0.5, -0.25]))
    assert factor == pytest.approx(np.array([[1.0, 1.0], [1.25, np.sqrt(2.0)], [1.0, 1.0]]))


def test_forecasts_from_noisy_boxes_are_wider() -> None:
    where, scene = roads.straight(), roads.scene_of((100.0, 0.0, 0.0, 10.0))
    speed = scene.history.speed.copy()
    speed[0] += 0.05 * (-1.0) ** np.arange(11)
    noisy = replace(scene, history=replace(scene.history, speed=speed))
    ends = [
        roads.plan(DRIVER, where, roads.present(each, 50, DRAW[:, None]))[:, 29] for each in (scene, noisy)
    ]
    assert np.ptp(ends[1].x) > 1.5 * np.ptp(ends[0].x)


def lane_of(number: int, begin: float, end: float, half_m: float, **neighbours: tuple[int, ...]) -> Lane:
    line = roads.lane(number, [(begin, 0.0), (end, 0.0)], width=2 * half_m, **neighbours)  # type: ignore[arg-type]
    side = np.array([0.0, half_m])
    return replace(line, left_bound=line.centreline + side, right_bound=line.centreline - side)


def offsets_after(half_m: float, ahead_half_m: float, offset_m: float) -> FloatArray:
    """Offsets after 3 s of 50 drivers on a lane that becomes another wide one 10 m ahead."""
    where = roads.road(
        lane_of(1, 0.0, 110.0, half_m, successors=(2,)),
        lane_of(2, 110.0, 600.0, ahead_half_m, predecessors=(1,)),
    )
    scene = replace(roads.scene_of((100.0, offset_m, 0.0, 10.0)), road=where)
    return np.asarray(roads.plan(DRIVER, where, roads.present(scene, 50, DRAW[:, None])).y[:, 29])


def test_in_a_wide_lane_drivers_differ_more() -> None:
    assert np.ptp(offsets_after(7.0, 7.0, 0.0)) > 2 * np.ptp(offsets_after(1.75, 1.75, 0.0))


def test_where_a_lane_narrows_drivers_keep_their_share_of_its_width() -> None:
    wide, half = (np.median(offsets_after(3.5, ahead, 1.5)) for ahead in (3.5, 1.75))
    assert wide > 1.1
    assert half == pytest.approx(wide / 2, abs=0.15)


def test_what_a_driver_shows_beside_what_is_asked_of_it_goes_on_for_a_while() -> None:
    # Far below the limit and at a steady speed: what is asked of it is to accelerate.
    where, scene = roads.straight(), roads.scene_of((100.0, 0.0, 0.0, 6.0))
    driver = LikelyDriver(LikelyProfile(spread=0.0))
    made = roads.plan(driver, where, roads.present(scene, 1, np.full((1, 1), 0.5)))
    assert abs(made.speed[0, 2] - 6.0) < 0.1
    assert made.speed[0, 29] > made.speed[0, 14] > 6.0


def test_a_new_leader_is_followed_at_no_more_than_the_headway_that_it_leaves() -> None:
    # 6 m at 10 m/s leave 3.8 m beyond the gap at rest.
    kept = kept_headway(np.array([6.0, 1.0]), np.full(2, 10.0), HUMAN)
    assert kept == pytest.approx([0.9 * 0.38, 0.0])


@pytest.mark.parametrize("gap_m", [0.5, -1.0])
def test_one_bumper_to_bumper_with_its_leader_keeps_its_speed(gap_m: float) -> None:
    """A trailer that was recorded as a vehicle, or a vehicle that was tracked twice."""
    where = roads.straight()
    scene = roads.scene_of((100.0, 0.0, 0.0, 15.0), (104.5 + gap_m, 0.0, 0.0, 15.0))
    driver = build(parse_models("likely_driver:spread=0")[0])
    made = roads.plan(driver, where, roads.present(scene, 1, np.full((1, 2), 0.5)))
    assert made.speed[0, 9] > 13.5


def test_paths_are_drawn_and_a_fast_vehicle_takes_no_sharp_turn() -> None:
    where = roads.fork()
    slow, fast = (roads.scene_of((30.0, 0.0, 0.0, v)) for v in (4.0, 15.0))
    share = {}
    for name, scene in (("slow", slow), ("fast", fast)):
        edges = path_edges(scene, seed_paths(scene, where), HUMAN)
        share[name] = edges[1] - edges[0]  # of straight on
    assert share["fast"] > 0.9
    assert 0.2 < share["slow"] < share["fast"]


def test_who_begins_to_turn_left_takes_the_path_on_the_left() -> None:
    where, steady = roads.fork(), roads.scene_of((46.0, 0.0, 0.0, 6.0))
    heading = steady.history.heading + 0.3 * np.linspace(-1.0, 0.0, 11)
    turns = replace(steady, history=replace(steady.history, heading=heading))
    left = [path_edges(scene, seed_paths(scene, where), HUMAN)[0] for scene in (steady, turns)]
    assert left[1] > 2 * left[0]


def test_spread_is_not_negative_and_the_path_a_known_one() -> None:
    with pytest.raises(UsageError, match="spread"):
        build(parse_models("likely_driver:spread=-1")[0])
    with pytest.raises(UsageError, match="path"):
        build(parse_models("likely_driver:path=nowhere")[0])


def test_likely_stands_for_drawn_drivers_without_a_guard() -> None:
    assert [str(spec) for spec in parse_models("likely")] == ["likely_driver"]


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_the_largest_spread_overflows_nothing() -> None:
    driver = build(parse_models("likely_driver:spread=100")[0])
    history = roads.present(roads.scene_of((10.0, 0.0, 0.0, 8.0), (30.0, 0.0, 0.0, 0.1)), 50)
    draw = np.random.default_rng(0).random(history.route_draw.shape)
    made = roads.plan(driver, roads.straight(), replace(history, route_draw=draw))
    assert np.isfinite(made.x).all() and np.isfinite(made.speed).all()
