"""Geometry of polylines."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import along, bounds_cross, nearest, project, project_near


def test_a_place_beside_a_corner_projects_onto_the_nearer_leg() -> None:
    corner = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert nearest(corner, 4.0, 1.0) == pytest.approx(4.0)
    assert nearest(corner, 9.0, 6.0) == pytest.approx(16.0)
    assert along(corner, np.array([4.0, 16.0])) == pytest.approx(np.array([[4.0, 0.0], [10.0, 6.0]]))


def test_bounds_that_cross_are_found_as_by_comparing_all_pairs() -> None:
    rng = np.random.default_rng(3)
    crossed = 0
    for _ in range(300):
        left, right = (np.cumsum(rng.normal((1.0, 0.0), (0.3, 0.6), (8, 2)), axis=0) for _ in range(2))
        right = right - (0.0, rng.uniform(0.0, 6.0))
        segments = [(line[k], line[k + 1]) for line in (left, right) for k in range(len(line) - 1)]
        expected = any(_cross(*one, *other) for one in segments for other in segments)
        crossed += expected
        assert bounds_cross(left, right) == expected
    assert 50 < crossed < 250


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def test_bounds_of_many_points_take_little_memory() -> None:
    x = np.linspace(0.0, 500.0, 5000)
    left = np.stack([x, np.sin(x)], axis=1)
    tracemalloc.start()
    assert not bounds_cross(left, left - (0.0, 3.5))
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_what_is_near_a_line_projects_on_it_as_by_looking_everywhere() -> None:
    rng = np.random.default_rng(5)
    line = np.cumsum(rng.normal((1.0, 0.0), 0.7, (60, 2)), axis=0)
    points = rng.uniform(line.min(axis=0) - 9.0, line.max(axis=0) + 9.0, (500, 2))
    arc, gap = project(points, line)
    near_arc, near_gap = project_near(points, line, 2.4)
    near = gap < 2.4
    assert near.any() and not near.all()
    assert np.array_equal(near_arc[near], arc[near])
    assert np.array_equal(near_gap[near], gap[near])
    assert (near_gap[~near] >= 2.4).all()
