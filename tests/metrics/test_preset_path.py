"""Metrics along paths: leaders on the own path, conflict areas; TTC, DRAC, THW, PET."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.scene import STEP_S
from tests.metrics.scenes import one_scene, random_run
from tests.seeds import steady

EXACT = 1e-9


def planned(tracks: SceneTracks, *paths: Sequence[tuple[float, float]]) -> PlannedPaths:
    """One plan per vehicle for a scene of one step; an empty one for a vehicle that plans to stay."""
    columns = max(1, *(len(path) for path in paths))
    here = np.stack([tracks.states.x[0, -1], tracks.states.y[0, -1]], axis=1)
    full = [list(p) + [p[-1] if p else tuple(here[i])] * (columns - len(p)) for i, p in enumerate(paths)]
    nodes = np.array(full, dtype=float)
    return PlannedPaths(
        x=nodes[None, None, :, :, 0],
        y=nodes[None, None, :, :, 1],
        index=np.zeros(1, dtype=np.int64),
        column=np.zeros(1, dtype=np.int64),
    )


def value(metric: str, tracks: SceneTracks, paths: PlannedPaths, *, row: int = 0) -> dict[int, float]:
    rows = evaluate_pairs(tracks, paths, metrics=(metric,))[metric]
    assert rows.other is not None
    own = rows.vehicle == row
    return dict(zip(rows.other[own].tolist(), rows.value[own].tolist(), strict=True))


def test_the_gap_is_bumper_to_bumper() -> None:
    """Centres 50 m apart, both 4.5 m long, closing at 10 m/s."""
    tracks = one_scene([{"x": 0, "v": 20}, {"x": 50, "v": 10}])
    paths = planned(tracks, [(30, 0), (60, 0)], [(60, 0), (80, 0)])
    assert value("ttc_path", tracks, paths) == pytest.approx({1: 4.55}, rel=EXACT)
    assert value("drac", tracks, paths) == pytest.approx({1: 100 / (2 * 45.5)}, rel=EXACT)
    assert value("thw", tracks, paths) == pytest.approx({1: 45.5 / 20}, rel=EXACT)
    assert value("ttc_path", tracks, paths, row=1) == {}
    # The paper's rule: centre to centre.
    assert value("ttc", tracks, paths) == pytest.approx({1: 5.0}, rel=EXACT)


def test_the_gap_is_measured_along_the_path() -> None:
    """10 m ahead, then a right angle, and 20 m more to a leader that drives up the side road."""
    tracks = one_scene([{"x": 0, "v": 10}, {"x": 10, "y": 20, "psi": math.pi / 2, "v": 5}])
    paths = planned(tracks, [(10, 0), (10, 10), (10, 40)], [(10, 30)])
    assert value("ttc_path", tracks, paths) == pytest.approx({1: (30 - 4.5) / 5}, rel=EXACT)
    assert value("ttc", tracks, paths) == {}


@pytest.mark.parametrize(
    ("leader", "leads"),
    [
        ({"x": 30, "y": 1.79}, True),  # half of both widths is 1.8 m
        ({"x": 30, "y": 1.81}, False),  # beside the path
        ({"x": 30, "y": 3.5}, False),  # on the next lane
        ({"x": -10}, False),  # behind
        ({"x": 30, "psi": math.radians(29)}, True),
        ({"x": 30, "psi": math.radians(31)}, False),  # crosses
        ({"x": 30, "psi": math.pi}, False),  # comes towards it
        ({"x": 79}, True),  # the path ends at 40 m and goes on straight for 2 s
        ({"x": 82}, False),
    ],
)
def test_who_is_on_the_path(leader: dict[str, float], leads: bool) -> None:
    tracks = one_scene([{"x": 0, "v": 20}, {**leader, "v": 5}])
    paths = planned(tracks, [(20, 0), (40, 0)], [])
    assert (1 in value("ttc_path", tracks, paths)) == leads


def test_a_driver_who_stops_behind_a_leader_still_follows_it() -> None:
    """The plan ends 7 m before the leader's centre."""
    tracks = one_scene([{"x": 0, "v": 8}, {"x": 20, "v": 0}])
    paths = planned(tracks, [(6, 0), (10, 0), (13, 0), (13, 0)], [])
    assert value("ttc_path", tracks, paths) == pytest.approx({1: 15.5 / 8}, rel=EXACT)


def slow_leader(
    tracks: SceneTracks, path: FloatArray, follower: int, at: tuple[int, int]
) -> tuple[int, float] | None:
    """The next vehicle along a path and its gap, segment by segment."""
    future, step = at
    states = tracks.states
    if np.hypot(*np.diff(path, axis=0).T).sum() < 0.1:
        direction = np.array(
            [
                math.cos(states.heading[future, step, follower]),
                math.sin(states.heading[future, step, follower]),
            ]
        )
    else:
        steps = np.diff(path, axis=0)
        direction = steps[np.hypot(*steps.T) > 0][-1]
        direction = direction / np.hypot(*direction)
    reach = max(20.0, 2.0 * states.speed[future, step, follower])
    path = np.vstack([path, path[-1] + reach * direction])
    best: tuple[float, int, float] | None = None
    for other in range(states.shape[2]):
        if other == follower:
            continue
        centre = np.array([states.x[future, step, other], states.y[future, step, other]])
        nearest: tuple[float, float, float] | None = None
        arc = 0.0
        for a, b in pairwise(path):
            length = float(np.hypot(*(b - a)))
            if length == 0:
                continue
            along = min(max(float((centre - a) @ (b - a)) / length, 0.0), length)
            aside = float(np.hypot(*(a + (b - a) / length * along - centre)))
            heading = states.heading[future, step, other]
            cos = float((b - a) @ [math.cos(heading), math.sin(heading)]) / length
            if nearest is None or (aside, arc + along) < nearest[:2]:
                nearest = (aside, arc + along, cos)
            arc += length
        assert nearest is not None
        aside, along, cos = nearest
        if (
            aside <= (tracks.width[follower] + tracks.width[other]) / 2
            and along > 0
            and cos >= math.cos(math.pi / 6)
        ):
            gap = max(along - (tracks.length[follower] + tracks.length[other]) / 2, 0.0)
            if best is None or along < best[0]:
                best = (along, other, gap)
    return None if best is None else best[1:]


@pytest.mark.parametrize("seed", range(4))
def test_random_leaders_are_those_of_a_search_segment_by_segment(seed: int) -> None:
    tracks, plans = random_run(np.random.default_rng(seed), vehicles=12, area=25.0, futures=3)
    rows = evaluate_pairs(tracks, plans, metrics=("ttc_path",))["ttc_path"]
    assert rows.other is not None
    got = {
        (int(c), int(t), int(i)): (int(j), float(v))
        for c, t, i, j, v in zip(rows.future, rows.step, rows.vehicle, rows.other, rows.value, strict=True)
    }
    expected = {}
    for future in range(tracks.states.shape[0]):
        for step in range(tracks.first, tracks.states.shape[1]):
            now = step - tracks.first
            for vehicle in range(12):
                plan = (future, plans.index[now], vehicle, slice(int(plans.column[now]), None))
                here = [tracks.states.x[future, step, vehicle], tracks.states.y[future, step, vehicle]]
                path = np.vstack([here, np.stack([plans.x[plan], plans.y[plan]], axis=1)])
                leader = slow_leader(tracks, path, vehicle, (future, step))
                if leader is not None:
                    speeds = tracks.states.speed[future, step]
                    closing = speeds[vehicle] - speeds[leader[0]]
                    time = leader[1] / closing if closing > 0 else math.inf
                    expected[(future, step, vehicle)] = (leader[0], time)
    assert len(expected) > 5
    assert got.keys() == expected.keys()
    for key, (other, time) in expected.items():
        assert got[key][0] == other
        assert got[key][1] == pytest.approx(time, rel=1e-7, abs=1e-9)


def straight(*vehicles: tuple[float, float, float, float], steps: int = 80) -> SceneTracks:
    """(x, y, heading, speed) at constant speed, with everything evaluated."""
    states = steady(*vehicles, time_s=np.arange(steps) * STEP_S).swapaxes(0, 1)[None]
    sizes = np.full((2, len(vehicles)), [[4.5], [1.8]])
    return SceneTracks(states=states, length=sizes[0], width=sizes[1])


def test_pet_is_the_time_between_leaving_and_coming() -> None:
    """The centres are at the crossing after 2.03 s and 5.01 s; half a width and half a length reach there."""
    reach = 0.9 + 2.25
    tracks = straight((-20.3, 0, 0, 10), (0, -25.05, math.pi / 2, 5))
    rows = evaluate_pairs(tracks, PlannedPaths.from_tracks(tracks), metrics=("pet",))["pet"]
    expected = (25.05 - reach) / 5 - (20.3 + reach) / 10
    assert rows.value == pytest.approx(np.full(rows.value.size, expected), rel=1e-7)
    # From the start until the first one passes, for both orders.
    assert rows.step.max() == 20 and rows.value.size == 2 * 21


def test_pet_leaves_out_who_weaves_across_the_leader_in_its_lane() -> None:
    """One follows the other in its lane; their tracks cross at 20 degrees."""
    tracks = straight((-20, 0, 0, 10), (0, -1, math.radians(20), 10))
    assert evaluate_pairs(tracks, None, metrics=("pet",))["pet"].value.size == 0


def test_pet_follows_the_speed_that_was_really_driven() -> None:
    """The second one waits 3 s at its start: gap time does not know, PET does."""
    tracks = straight((-20.3, 0, 0, 10), (0, -10.05, math.pi / 2, 5))
    y = tracks.states.y.copy()
    y[0, 30:, 1] = y[0, :50, 1]
    y[0, :30, 1] = y[0, 0, 1]
    waiting = replace(tracks, states=replace(tracks.states, y=y))
    rows = evaluate_pairs(waiting, None, metrics=("pet",))["pet"]
    expected = 3 + (10.05 - 3.15) / 5 - (20.3 + 3.15) / 10
    assert rows.value == pytest.approx(np.full(rows.value.size, expected), rel=1e-7)
