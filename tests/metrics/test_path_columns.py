"""Columns of the set ``path``: body gap, WTTC of outlines, and the times along the follower's path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.metrics.base import PlannedPaths
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.registry import columns_of, metrics_named
from tests.metrics.scenes import random_run
from tests.metrics.straight import closed_forms, straight
from tests.metrics.test_collisions import outline


def test_closed_forms() -> None:
    for case in closed_forms():
        tracks = straight(case["a"], case["b"])
        pairs = evaluate_pairs(
            tracks, PlannedPaths.from_tracks(tracks), metrics=("ttc_path", "drac", "pet", "gap", "wttc_path")
        )
        first = {name: rows.value[(rows.step == 0) & (rows.vehicle == 0)] for name, rows in pairs.items()}
        if case.get("ttc_path"):
            assert first["ttc_path"] == pytest.approx([case["ttc_path"]], rel=1e-9)
        elif "ttc_path" in case:
            assert first["ttc_path"].size == 0
        if "drac" in case:
            assert first["drac"] == pytest.approx([case["drac"]], rel=1e-9)
        if "pet" in case:
            assert first["pet"] == pytest.approx([case["pet"]], abs=1e-9)
        if "gap" in case:  # the least one, while they pass
            values, defined = evaluate(tracks, PlannedPaths.from_tracks(tracks), metrics=["path"]).column(
                "gap"
            )
            assert defined.all() and values == pytest.approx([case["gap"]], rel=1e-9)
        if "wttc_path" in case:
            assert first["wttc_path"] == pytest.approx([case["wttc_path"]], rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_random_outlines_meet_when_polygons_do(seed: int) -> None:
    tracks, _ = random_run(np.random.default_rng(seed), vehicles=7, futures=1, steps=2, history=1)
    rows = evaluate_pairs(tracks, None, metrics=("wttc_path", "gap"))
    worst, gaps = rows["wttc_path"], rows["gap"]
    assert worst.other is not None
    for row in range(len(worst.value)):
        step, i, j = int(worst.step[row]), int(worst.vehicle[row]), int(worst.other[row])
        polygons = [outline(tracks, 0, vehicle, step) for vehicle in (i, j)]
        assert gaps.value[row] == pytest.approx(polygons[0].distance(polygons[1]), abs=1e-9)

        def spare(time: float, step: int = step, i: int = i, j: int = j, polygons=polygons) -> float:  # type: ignore[no-untyped-def]
            moved = []
            for vehicle, polygon in zip((i, j), polygons, strict=True):
                heading, speed = (
                    getattr(tracks.states, name)[0, step, vehicle] for name in ("heading", "speed")
                )
                way = speed * time
                moved.append(
                    shapely.affinity.translate(polygon, way * math.cos(heading), way * math.sin(heading))
                )
            return float(moved[0].distance(moved[1])) - 0.5 * 13.8 * time * time

        time = float(worst.value[row])
        assert spare(time) <= 1e-7
        assert all(spare(share * time) > -1e-9 for share in np.linspace(0, 0.9999, 25))


@pytest.mark.parametrize("seed", range(3))
def test_quick_extrema_are_those_of_all_pairs(seed: int) -> None:
    tracks, planned = random_run(
        np.random.default_rng(seed), futures=4, vehicles=9, area=60, absent=0.1 * (seed == 2)
    )
    quick = evaluate(tracks, planned, metrics=["path"])
    names = ("gap", "wttc_path", "thw", "drac", "pet")
    slow = [replace(metric, quick=None) for metric in metrics_named(names)]
    every = evaluate(tracks, planned, metrics=slow)
    assert quick.columns == columns_of(metrics_named(["path"])) and quick.values.shape == (4, 14)
    for name in every.columns:
        np.testing.assert_array_equal(quick.column(name)[0], every.column(name)[0])
    for name in ("gap", "wttc_path"):
        for part in ("step", "vehicle", "other"):
            assert np.array_equal(getattr(quick.worst[name], part), getattr(every.worst[name], part))
    of_all = evaluate(tracks, planned, metrics=["path"], vehicles=range(9))
    np.testing.assert_array_equal(of_all.values, quick.values)
    some = [evaluate(tracks, planned, metrics=m, vehicles=(2, 5)) for m in (names, slow)]
    np.testing.assert_array_equal(some[0].values, some[1].values)
    assert (some[0].column("gap")[0] > quick.column("gap")[0]).any()


def test_the_mean_of_pttc_is_harmonic_over_the_scenes_in_which_a_pair_follows() -> None:
    """Follower at 20 m/s, leader at 10 m/s from step 5 on, at 20 m/s before: infinite times count as 0."""
    tracks = straight({"speed": 20}, {"x": 60, "speed": 20}, steps=10)
    tracks.states.speed[0, 5:, 1] = 10.0
    tracks.states.x[0, :, :] = [0.0, 60.0]
    found = evaluate(tracks, PlannedPaths.from_tracks(tracks), metrics=("pttc", "ttc"))
    # In step 5 the leader has braked from 20 to 10 m/s in 0.1 s: D = 100 m/s², it stands after 0.5 m.
    times = [(60 + 100 / 200) / 20] + [6.0] * 4
    assert found.column("pttc")[0] == pytest.approx([min(times)])
    assert found.column("pttc_mean")[0] == pytest.approx([10 / sum(1 / t for t in times)])
