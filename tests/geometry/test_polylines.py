"""Geometry of polylines."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.geometry.polylines import along, nearest, project
from scex_sumo.roads.conflicts import project_near


def test_a_place_beside_a_corner_projects_onto_the_nearer_leg() -> None:
    corner = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert nearest(corner, 4.0, 1.0) == pytest.approx(4.0)
    assert nearest(corner, 9.0, 6.0) == pytest.approx(16.0)
    assert along(corner, np.array([4.0, 16.0])) == pytest.approx(np.array([[4.0, 0.0], [10.0, 6.0]]))


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
