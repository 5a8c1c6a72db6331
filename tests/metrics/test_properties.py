"""What must not change a metric, and what must change it in one direction only."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import ScenarioValues, evaluate
from scex_sumo.metrics.formulas.following import (
    deceleration_to_avoid_crash,
    potential_time_to_collision,
    time_to_collision,
)
from scex_sumo.metrics.registry import METRICS
from tests.metrics.scenes import moved, random_run

seeds = st.integers(0, 2**32 - 1)
# Moved coordinates are rounded anew: 1e-9 m at the largest shift, over metres and metres per second.
ROUNDING = 1e-6


def run(seed: int) -> tuple[SceneTracks, PlannedPaths]:
    rng = np.random.default_rng(seed)
    return random_run(rng, vehicles=6, steps=4, area=float(rng.choice([10, 40, 120])), absent=0.15)


def every(tracks: SceneTracks, planned: PlannedPaths) -> ScenarioValues:
    return evaluate(tracks, planned, metrics=tuple(METRICS))


def assert_same(first: ScenarioValues, second: ScenarioValues, tolerance: float = ROUNDING) -> None:
    np.testing.assert_array_equal(first.defined, second.defined)
    np.testing.assert_allclose(second.values, first.values, rtol=tolerance, atol=tolerance)


@settings(max_examples=30)
@given(seeds, st.floats(-np.pi, np.pi), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_turning_and_shifting_the_map_changes_nothing(
    seed: int, angle: float, east: float, north: float
) -> None:
    tracks, planned = run(seed)

    def motion(x: Any, y: Any, heading: Any) -> tuple[Any, Any, Any]:
        c, s = math.cos(angle), math.sin(angle)
        return c * x - s * y + east, s * x + c * y + north, heading + angle

    assert_same(every(tracks, planned), every(*moved(tracks, planned, motion)))


@settings(max_examples=20)
@given(seeds)
def test_a_mirrored_world_is_as_critical(seed: int) -> None:
    tracks, planned = run(seed)
    mirrored = moved(tracks, planned, lambda x, y, heading: (x, -y, -heading))
    assert_same(every(tracks, planned), every(*mirrored), 1e-9)


@settings(max_examples=20)
@given(seeds, st.permutations(range(6)))
@example(446, [3, 1, 2, 0, 4, 5])  # one pair is as many steps apart in either order
def test_the_order_of_vehicles_changes_nothing(seed: int, order: list[int]) -> None:
    tracks, planned = run(seed)
    assert tracks.present is not None
    shuffled = replace(
        tracks,
        states=tracks.states[:, :, order],
        length=tracks.length[order],
        width=tracks.width[order],
        present=tracks.present[:, :, order],
    )
    paths = replace(planned, x=planned.x[:, :, order], y=planned.y[:, :, order])
    before, after = every(tracks, planned), every(shuffled, paths)
    assert_same(before, after, 1e-9)
    for name, worst in before.worst.items():
        np.testing.assert_array_equal(worst.step[worst.defined], after.worst[name].step[worst.defined])


@settings(max_examples=20)
@given(seeds)
def test_an_absent_vehicle_is_as_good_as_none(seed: int) -> None:
    tracks, planned = run(seed)
    assert tracks.present is not None
    keep = [0, 1, 3, 4, 5]
    gone = tracks.present.copy()
    gone[:, :, 2] = False
    without = replace(
        tracks,
        states=tracks.states[:, :, keep],
        length=tracks.length[keep],
        width=tracks.width[keep],
        present=tracks.present[:, :, keep],
    )
    fewer = replace(planned, x=planned.x[:, :, keep], y=planned.y[:, :, keep])
    assert_same(every(without, fewer), every(replace(tracks, present=gone), planned), 1e-12)


positive = st.floats(0.01, 200.0)
speeds = st.floats(0.0, 60.0)


@given(positive, positive, speeds, speeds, st.floats(-12.0, 0.0))
def test_a_smaller_gap_is_never_safer(
    gap: float, more: float, follower: float, leader: float, a: float
) -> None:
    near, far = np.array([gap]), np.array([gap + more])
    v_f, v_l, a_l = np.array([follower]), np.array([leader]), np.array([a])
    assert time_to_collision(gap=near, closing_speed=v_f - v_l) <= time_to_collision(
        gap=far, closing_speed=v_f - v_l
    )
    times = [
        potential_time_to_collision(gap=d, follower_speed=v_f, leader_speed=v_l, leader_acceleration=a_l)[0]
        for d in (near, far)
    ]
    assert times[0] <= times[1] * (1 + 1e-9)
    rates = [deceleration_to_avoid_crash(gap=d, closing_speed=v_f - v_l)[0] for d in (near, far)]
    assert rates[0] >= rates[1]


@given(positive, speeds, speeds, st.floats(-12.0, 0.0), st.floats(0.0, 12.0))
@example(0.1, 5.0, 5.0, -5e-324, 0.1)
def test_a_leader_that_brakes_harder_is_never_safer(
    d: float, follower: float, leader: float, a: float, more: float
) -> None:
    gentle, hard = (
        potential_time_to_collision(
            gap=np.array([d]),
            follower_speed=np.array([follower]),
            leader_speed=np.array([leader]),
            leader_acceleration=np.array([braking]),
        )[0]
        for braking in (a, a - more)
    )
    assert hard <= gentle * (1 + 1e-9) or math.isinf(gentle)


@given(
    st.floats(-30, 30), st.floats(-30, 30), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi),
    st.tuples(st.floats(0, 12), st.floats(0, 3)), st.tuples(st.floats(0, 12), st.floats(0, 3)),
)  # fmt: skip
def test_rectangle_distance_does_not_care_who_is_first(
    dx: float, dy: float, one: float, two: float, size_1: tuple[float, float], size_2: tuple[float, float]
) -> None:
    def rectangle(x: float, y: float, heading: float, size: tuple[float, float]) -> Rectangles:
        values = (np.array([v]) for v in (x, y, heading, size[0] / 2, size[1] / 2))
        return Rectangles(
            **dict(zip(("x", "y", "heading", "half_length", "half_width"), values, strict=True))
        )

    first, second = rectangle(0.0, 0.0, one, size_1), rectangle(dx, dy, two, size_2)
    distances = [rectangle_distance(*pair)[0] for pair in ((first, second), (second, first))]
    assert distances[0] == pytest.approx(distances[1], abs=1e-9)
    centres = math.hypot(dx, dy)
    assert distances[0] <= centres + 1e-9
    assert distances[0] >= centres - (math.hypot(*size_1) + math.hypot(*size_2)) / 2 - 1e-9


def test_thousands_of_kilometres_and_standing_vehicles_stay_finite() -> None:
    rng = np.random.default_rng(0)
    tracks, planned = random_run(rng, futures=3, vehicles=6, area=1e6)
    still = replace(tracks, states=replace(tracks.states, speed=np.zeros(tracks.states.shape)))
    for scene in (tracks, still):
        values = every(scene, planned)
        assert np.isfinite(values.values[values.defined]).all()
