"""Each metric on scenes whose value can be written down."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import evaluate
from tests.metrics.scenes import one_scene, paths_of, with_speeds

# Closed forms in double precision: only rounding is left.
EXACT = 1e-9


def pair(
    metric: str, tracks: SceneTracks, planned: PlannedPaths | None = None, *, row: int = 0
) -> float | None:
    """The value of the row vehicle's only other vehicle; None where undefined."""
    values = evaluate_pairs(tracks, planned, metrics=(metric,))[metric]
    own = values.value[values.vehicle == row]
    assert own.size <= 1
    return float(own[0]) if own.size else None


def test_distance_of_a_3_4_5_triangle() -> None:
    tracks = one_scene([{"x": 1, "y": -2, "psi": 0.3, "v": 1}, {"x": 4, "y": 2, "psi": 2, "v": 9}])
    assert pair("distance", tracks) == pytest.approx(5.0, rel=EXACT)
    assert pair("distance", tracks, row=1) == pytest.approx(5.0, rel=EXACT)


@pytest.mark.parametrize(
    ("follower", "leader", "seconds"), [(20, 10, 5.0), (11, 10, 50.0), (10, 10, math.inf), (5, 10, math.inf)]
)
def test_ttc_is_the_distance_of_the_centres_over_the_closing_speed(
    follower: float, leader: float, seconds: float
) -> None:
    tracks = one_scene([{"x": 0, "v": follower}, {"x": 50, "v": leader}])
    assert pair("ttc", tracks) == pytest.approx(seconds, rel=EXACT)


@pytest.mark.parametrize(
    ("degrees", "follows"),
    [
        (0, True),
        (30, True),
        (30.001, False),
        (-30, True),
        (180, False),
        (330, True),
        (-329, False),
        (690, True),
    ],
)
def test_headings_of_a_following_pair_differ_by_at_most_30_degrees(degrees: float, follows: bool) -> None:
    tracks = one_scene([{"x": 0, "v": 20, "psi": 0}, {"x": 50, "v": 10, "psi": math.radians(degrees)}])
    assert (pair("ttc", tracks) is not None) == follows


def test_there_is_no_lane_test() -> None:
    tracks = one_scene([{"x": 0, "v": 20}, {"x": 30, "y": 40, "v": 10}])
    assert pair("ttc", tracks) == pytest.approx(5.0, rel=EXACT)


PTTC = [
    # (d, v_f, v_l, a_l, t)
    (30, 15, 15, -3, math.sqrt(2 * 30 / 3)),  # equal speeds, the leader stops after 5 s
    (30, 20, 15, -3, (-5 + math.sqrt(25 + 180)) / 3),  # closing
    (30, 10, 15, -3, (30 + 15**2 / 6) / 10),  # the leader has stopped before
    (
        15,
        10,
        12,
        -5,
        (2 + math.sqrt(4 + 150)) / 5 if (2 + math.sqrt(154)) / 5 <= 2.4 else (15 + 144 / 10) / 10,
    ),
    (7.5, 15, 15, -15, 1.0),  # at the very moment the leader stops: both forms meet
    (30, 20, 15, 0, 6.0),  # not braking: TTC
    (30, 20, 15, 2, 6.0),  # speeding up: TTC
    (30, 15, 20, 1, math.inf),
    (30, 20, 0, -4, 1.5),  # just came to a stop
    (30, 0, 5, -4, math.inf),  # a standing follower never arrives
    (30, 0, 0, 0, math.inf),
    (30, 20, 15, -1e-9, 6.0 - 1e-9 / 5 * 6.0**2 / 2),  # hardly braking: first order in D
]


@pytest.mark.parametrize(("d", "v_f", "v_l", "a_l", "t"), PTTC)
def test_pttc_of_a_leader_that_keeps_braking(d: float, v_f: float, v_l: float, a_l: float, t: float) -> None:
    tracks = one_scene([{"x": 0, "v": v_f}, {"x": d, "v": v_l, "a": a_l}])
    assert pair("pttc", tracks) == pytest.approx(t, rel=EXACT)


def head_on(d: float, c: float, radius: float, reach: float = 13.8) -> float:
    """Closed form of WTTC for vehicles that close in along their line of centres."""
    return (-c + math.sqrt(c * c + 2 * reach * (d - radius))) / reach


RADII = 2 * math.hypot(2.25, 0.9)


@pytest.mark.parametrize("speed", [0.0, 1.0, 10.0, 40.0, 80.0])
@pytest.mark.parametrize("d", [6.0, 50.0, 1e6])
def test_wttc_head_on_fleeing_and_side_by_side(d: float, speed: float) -> None:
    """Towards each other, away from each other, and with no relative speed."""
    towards = one_scene([{"x": 0, "v": speed}, {"x": d, "psi": math.pi, "v": speed}])
    assert pair("wttc", towards) == pytest.approx(head_on(d, 2 * speed, RADII), rel=EXACT)
    away = one_scene([{"x": 0, "psi": math.pi, "v": speed}, {"x": d, "v": speed}])
    assert pair("wttc", away) == pytest.approx(head_on(d, -2 * speed, RADII), rel=EXACT)
    abreast = one_scene([{"x": 0, "v": speed}, {"y": d, "v": speed}])
    assert pair("wttc", abreast) == pytest.approx(head_on(d, 0.0, RADII), rel=EXACT)


def test_gap_time_at_a_right_angle() -> None:
    tracks, planned = paths_of([(-30, 0), (30, 0)], [(0, -20), (0, 20)])
    tracks = with_speeds(tracks, 10.0, 5.0)
    assert pair("gap_time", tracks, planned) == pytest.approx(1.0, rel=EXACT)
    assert pair("gap_time", tracks, planned, row=1) == pytest.approx(1.0, rel=EXACT)


@pytest.mark.parametrize(
    ("other", "why"),
    [
        ([(5, 1), (5, 9)], "it starts beyond the first path"),
        ([(-5, -5), (-5, 5)], "it crosses behind the first vehicle"),
        ([(3, 0), (40, 0)], "it runs ahead on the same line"),
        ([(0, 1), (30, 1)], "it is parallel"),
        ([(40, -5), (40, 5)], "it crosses beyond the planned end"),
        ([(10, -5), (10, -5)], "it has no path"),
    ],
)
def test_no_crossing_no_gap_time(other: list[tuple[float, float]], why: str) -> None:
    tracks, planned = paths_of([(0, 0), (30, 0)], other)
    assert pair("gap_time", tracks, planned) is None, why
    assert pair("gap_time", tracks, planned, row=1) is None, why


def test_traffic_quality_of_two_vehicles() -> None:
    """r_1 = 3.6² + 4.5 + 10 < 30 m sees nobody, r_2 = 7.2² + 4.5 + 20 sees the first; gap 25.5 m."""
    history = one_scene([{"x": 0, "v": 10}, {"x": 30, "v": 20}])
    values = evaluate_pairs(history, None, metrics=("tq",))["tq"].value
    macro, closeness = 5 / 15, math.exp(-25.5 / 5)
    first = closeness * math.sqrt(macro**2 + (0.5 * 10 / 13.89) ** 2)
    second = closeness * math.sqrt(macro**2 + 0.5**2 + (0.5 * 20 / 13.89) ** 2)
    assert values == pytest.approx([first, second], rel=EXACT)


def test_traffic_quality_of_vehicles_that_touch_and_stand_is_the_share_of_neighbours() -> None:
    tracks = one_scene([{"x": 0}, {"x": 4.5}, {"x": 100}])
    values = evaluate_pairs(tracks, None, metrics=("tq",))["tq"].value
    assert values == pytest.approx([1 / 3, 1 / 3, 0.0], rel=EXACT)


def oracle_cases() -> list[Any]:
    """Worked cases beside the shared data, where they are."""
    repository = Path(__file__).resolve().parents[2]
    for folder in (repository.parent / "shared", repository):
        file = folder / "oracles" / "analytic_examples.json"
        if file.is_file():
            # Its aggregates of given pair values are those of test_aggregation.py.
            cases = [case for case in json.loads(file.read_text()) if case["metric"] != "aggregate"]
            return [pytest.param(case, id=case["id"]) for case in cases]
    return [pytest.param(None, id="absent", marks=pytest.mark.skip("no shared worked cases here"))]


def oracle_tracks(case: dict[str, Any]) -> SceneTracks:
    return one_scene(sorted(case["vehicles"], key=lambda v: v["id"]))


@pytest.mark.parametrize("case", oracle_cases())
def test_the_shared_worked_cases(case: dict[str, Any]) -> None:
    metric, expected = case["metric"], case["expected"]
    if metric == "gap_time":
        tracks, planned = paths_of(case["path1"], case["path2"])
        tracks = with_speeds(tracks, case["v1"], case["v2"])
        assert pair("gap_time", tracks, planned) == pytest.approx(expected, rel=case["rtol"])
    elif metric == "traffic_quality":
        values = evaluate_pairs(oracle_tracks(case), None, metrics=("tq",))["tq"].value
        assert values == pytest.approx([e["tq"] for e in expected.values()], rel=case["rtol"])
    elif metric == "ttc":
        assert pair("ttc", oracle_tracks(case)) == pytest.approx(expected["centre"], rel=case["rtol"])
        value = evaluate(oracle_tracks(case), None, metrics=("ttc",)).values[0, 0]
        assert value == pytest.approx(expected["inverse_centre"], rel=case["rtol"])
    else:
        assert pair(metric, oracle_tracks(case)) == pytest.approx(expected, rel=case["rtol"], abs=1e-12)
