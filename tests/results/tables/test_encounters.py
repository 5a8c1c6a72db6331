"""Encounters: who meets whom in how many futures, when, where, by whose models, in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.arrays import IntArray
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.collisions import find_collisions
from scex_sumo.results.tables.encounters import SCHEMA, encounters_table, in_words, precedence_words
from scex_sumo.scene import States
from tests.metrics.scenes import find_encounters
from tests.statistics.shares import equal_shares, wilson

TRACKS = np.array([17, 23, 99])
MODELS = np.array(["constant_velocity", "emergency_brake"])


def futures(levels: IntArray) -> SceneTracks:
    """Vehicle 0 follows vehicle 1 30 m ahead at 15 m/s; model 1 brakes with 8 m/s². Vehicle 2 is far away."""
    time = np.arange(1, 31) * 0.1
    count = len(levels)
    x, speed = np.empty((2, count, 31, 3))
    start = (0.0, 15.0, 5000.0)
    for vehicle in range(3):
        brakes = levels[:, vehicle, None] == 1
        speed[:, :, vehicle] = np.where(brakes, np.maximum(15 - 8 * np.r_[0, time], 0), 15)
        x[:, 0, vehicle] = start[vehicle]
        x[:, 1:, vehicle] = start[vehicle] + np.cumsum(speed[:, 1:, vehicle], axis=1) * 0.1
    return SceneTracks(
        states=States(x=x, y=np.zeros(x.shape), heading=np.zeros(x.shape), speed=speed),
        length=np.full(3, 4.0),
        width=np.full(3, 2.0),
        first=1,
    )


LEVELS = np.array([[a, b, 0] for a in (0, 1) for b in (0, 1)] * 10)


def table():  # type: ignore[no-untyped-def]
    tracks = futures(LEVELS)
    found = find_encounters(tracks, PlannedPaths.from_tracks(tracks))
    intervals = equal_shares(LEVELS, "random")
    return encounters_table(found, track_ids=TRACKS, models=MODELS[LEVELS], intervals=intervals)


def test_a_pair_is_a_row_and_those_that_never_meet_are_none() -> None:
    rows = table().to_pylist()
    assert [(row["track_id"], row["other_id"]) for row in rows] == [(17, 23)]
    assert table().schema == SCHEMA
    row = rows[0]
    ordinary = wilson(10, 40)
    assert (row["collision"], row["collision_low"], row["collision_high"]) == pytest.approx(
        (ordinary.value, ordinary.low, ordinary.high)
    )
    assert row["met"] == 1.0 and row["kind"] == "rear-end"
    assert row["critical"] >= row["ttc"] >= row["collision"] == 0.25


def test_sets_and_lifts_are_of_the_event_that_is_told() -> None:
    row = table().to_pylist()[0]
    models = ["constant_velocity", "emergency_brake"]
    assert row["cut_sets"] == [{"futures": 10, "track_ids": [17, 23], "models": models}]
    lifts = {(one["track_id"], one["model"]): one["lift"] for one in row["lifts"]}
    assert lifts == {(17, models[0]): 2.0, (17, models[1]): 0.0, (23, models[0]): 0.0, (23, models[1]): 2.0}


def test_in_words() -> None:
    row = table().to_pylist()[0]
    hit = find_collisions(futures(LEVELS)).time_s[0]
    low, high = (round(100 * row[name]) for name in ("collision_low", "collision_high"))
    assert in_words(row | {"place": "ring"}) == (
        f"17 → 23 (rear-end, ring, {hit:.1f} s): collides in 25 % [{low}–{high}], "
        "in 10 of 10 futures in which 17 keeps its speed and 23 brakes hard"
    )
    some = [row["cut_sets"][0] | {"track_ids": [9], "models": ["replay"]}, *row["cut_sets"]]
    one_more = "in 10 of 10 futures in which 9 drives as recorded (1 more with encounters --pair)"
    assert in_words(row | {"cut_sets": some}).endswith(one_more)
    assert in_words(row | {"cut_sets": []}).endswith("typically 17 constant_velocity, 23 emergency_brake")
    calm = row | {"cut_sets": [], "collision": 0.0, "ttc": 0.5, "ttc_low": 0.4, "ttc_high": 0.6, "kind": None}
    assert "TTC < 1.5 s in 50 % [40–60]" in in_words(calm)
    never = calm | {"critical": 0.0}
    assert in_words(never | {"gap": 2.04}).endswith("never critical, typically 2.0 m apart")
    assert in_words(never | {"gap": None}).endswith("never critical, typically more than 10 m apart")


def test_gap_time_and_drivers_are_those_of_one_future() -> None:
    """Gaps of the four critical futures: 8, 2, 5, 9 m; the median is number 2, the nearest of all 4."""
    tracks = futures(LEVELS[:5])
    found = find_encounters(tracks, PlannedPaths.from_tracks(tracks)).take(np.zeros(5, dtype=np.int64))
    found = replace(
        found,
        future=np.arange(5),
        kind=np.full(5, -1),
        gap=np.array([8.0, 2.0, 5.0, 9.0, 1.0]),
        ttc=np.array([1.0, 1.0, 1.0, 1.0, 9.0]),
        pet=np.full(5, np.inf),
        drac=np.zeros(5),
        time_s=np.array([0.1, 0.2, 0.3, 0.4, 0.5]),
    )
    models = MODELS[LEVELS[:5]]
    design = equal_shares(LEVELS[:5], "random")
    row = encounters_table(found, track_ids=TRACKS, models=models, intervals=design).to_pylist()[0]
    assert (row["future"], row["gap"], row["time_s"]) == (2, 5.0, 0.3)
    assert (row["model"], row["other_model"]) == ("emergency_brake", "constant_velocity")
    assert in_words(row).endswith("typically 5.0 m apart, 17 emergency_brake, 23 constant_velocity")


def test_encounters_do_not_depend_on_batches() -> None:
    tracks = futures(LEVELS)
    whole = find_encounters(tracks, PlannedPaths.from_tracks(tracks))
    parts = []
    for part in (slice(0, 25), slice(25, 40)):
        some = tracks.futures(part)
        found = find_encounters(some, PlannedPaths.from_tracks(some))
        parts.append(replace(found, future=found.future + part.start))
    joined = type(whole).join(parts)
    for name in ("future", "first", "second", "gap", "ttc", "pet", "drac", "kind", "time_s", "x", "towards"):
        assert np.array_equal(getattr(whole, name), getattr(joined, name)), name


def test_a_pair_says_who_of_the_two_must_yield() -> None:
    info = {"precedence": [[12, 7, "must yield"], [3, 7, "has red"]]}
    assert precedence_words(info, (7, 12)) == "; 12 must yield"
    assert precedence_words({}, (7, 12)) == ""
