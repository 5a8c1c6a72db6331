"""Paths: drivable curvature, inside the lane, chosen as asked, made once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths, chosen_paths, seed_paths
from scex_sumo.behaviors.models.sumo import SumoDriver
from scex_sumo.geometry.polylines import arc_lengths, nearest
from tests.behaviors import roads


def line(paths: SeedPaths, row: int = 0) -> FloatArray:
    return paths.table.reshape(len(paths.lanes), paths.samples, -1)[row, :, :6]


def furthest_from(points: FloatArray, centreline: FloatArray) -> float:
    """Largest distance of path points from a polyline, m."""
    distance = []
    for x, y in points:
        s = nearest(centreline, x, y)
        arc = arc_lengths(centreline)
        foot = np.interp(s, arc, centreline[:, 0]), np.interp(s, arc, centreline[:, 1])
        distance.append(np.hypot(x - foot[0], y - foot[1]))
    return max(distance)


def corner(degrees: float) -> np.ndarray:
    a = np.deg2rad(degrees)
    return np.array([[0.0, 0.0], [60.0, 0.0], [60.0 + 80 * np.cos(a), 80 * np.sin(a)]])


def test_a_right_angle_is_cut_as_far_as_the_lane_allows() -> None:
    # A circle of 5 m in a corner of 89 degrees passes it at 5·(√2·0.99 - 1) = 2.0 m: more than half a
    # 3.5 m lane, less than half a 5 m lane. One of 3 m passes at 1.2 m.
    bent = corner(89)
    for width, curvature in ((3.5, 0.34), (5.0, 0.2)):
        where = roads.road(roads.lane(1, bent, width=width))
        near = line(seed_paths(roads.scene_of((30.0, 0.0, 0.0, 8.0)), where))[: int((BEHIND_M + 90) / DS_M)]
        assert np.abs(near[:, 5]).max() <= curvature
        assert furthest_from(near[:, :2], bent) <= width / 2


def test_a_curve_of_ten_metres_keeps_its_place_and_curvature() -> None:
    where = roads.road(roads.lane(1, roads.arc(10.0, 5.0, step=0.5)))
    paths = seed_paths(roads.scene_of((0.0, 0.0, 0.0, 5.0)), where)
    inner = line(paths)[int((BEHIND_M + 6) / DS_M) : int((BEHIND_M + 40) / DS_M)]
    # A Gaussian of sigma moves an arc inwards by sigma²/(2R) = 0.11 m.
    assert np.hypot(inner[:, 0], inner[:, 1] - 10.0) == pytest.approx(9.89, abs=0.03)
    assert inner[:, 5] == pytest.approx(0.101, abs=0.01)


def test_a_projection_gives_arc_length_offset_and_heading() -> None:
    paths = seed_paths(roads.scene_of((30.0, 0.0, 0.0, 8.0)), roads.straight())
    s, offset, heading = paths.foot_points(
        np.array([0, 0]), np.array([31.3, 60.2]), np.array([0.7, -4.0]), np.full(2, BEHIND_M)
    )
    assert s == pytest.approx(BEHIND_M + np.array([1.3, 30.2]))
    assert offset == pytest.approx([0.7, -4.0])
    assert heading == pytest.approx([0.0, 0.0])


def chosen(path: object, draw: float) -> tuple[int, ...]:
    scene = roads.scene_of((20.0, 0.0, 0.0, 10.0))
    driver = SumoDriver("IDM", path=path)  # type: ignore[arg-type]
    (lanes,) = driver.routes(scene, roads.fork(), np.array([0]), np.array([draw]))
    return lanes[:2]


def test_random_picks_each_path_as_often_as_it_is_probable() -> None:
    scene = roads.scene_of((20.0, 0.0, 0.0, 10.0), (80.0, 0.0, 0.0, 10.0))
    paths = seed_paths(scene, roads.fork())
    draw = np.random.default_rng(3).random(3000)
    rows = paths.choose("random", np.zeros(3000, dtype=np.int64), draw)
    # Three standard deviations of a share of one third among 3000 are 0.026.
    assert np.bincount(rows) / 3000 == pytest.approx([1 / 3] * 3, abs=0.026)
    assert set(paths.choose("random", np.ones(50, dtype=np.int64), draw[:50]).tolist()) == {3}


def test_the_speed_limit_follows_the_lanes() -> None:
    zones = roads.road(
        roads.lane(1, [(0.0, 0.0), (50.0, 0.0)], limit=20.0, successors=(2,)),
        roads.lane(2, [(50.0, 0.0), (300.0, 0.0)], limit=10.0, predecessors=(1,)),
    )
    limit = seed_paths(roads.scene_of((20.0, 0.0, 0.0, 10.0)), zones).speed_limit[0]
    x = DS_M * np.arange(len(limit))  # from 20 m behind x = 20
    assert np.all(limit[x < 50.0] == 20.0) and np.all(limit[x > 50.0] == 10.0)


def test_all_paths_of_a_long_future_take_memory_in_proportion_to_its_steps() -> None:
    scene, where = roads.scene_of((10.0, 0.0, 0.0, 8.0)), roads.straight()
    history = roads.present(scene)
    tables = {}
    for step in range(0, 6000, 5):
        paths, _ = chosen_paths(replace(history, step=step), where, roads.every(history), "straight")
        assert paths.samples * DS_M - BEHIND_M > 8.0 * (0.1 * step + 3.0)  # a plan ends on its table
        tables[id(paths)] = paths.samples
    assert len(tables) <= 8
    assert sum(tables.values()) < 2.2 * max(tables.values()) < 2.2 * 2 * 15 * (600 + 8) / DS_M
