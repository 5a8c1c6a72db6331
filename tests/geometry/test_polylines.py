"""Geometry of polylines."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.geometry.polylines import along, blend_over, length_of, nearest, wrap


def test_angles_wrap_to_half_a_turn() -> None:
    turned = wrap(np.array([0.1, 2 * np.pi + 0.1, -3 * np.pi + 0.1]))
    assert turned == pytest.approx([0.1, 0.1, -np.pi + 0.1])


def test_a_place_beside_a_corner_projects_onto_the_nearer_leg() -> None:
    corner = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert nearest(corner, 4.0, 1.0) == pytest.approx(4.0)
    assert nearest(corner, 9.0, 6.0) == pytest.approx(16.0)
    assert along(corner, np.array([4.0, 16.0])) == pytest.approx(np.array([[4.0, 0.0], [10.0, 6.0]]))


def test_a_lane_change_leaves_along_one_line_and_arrives_along_the_other() -> None:
    ends, goes_on = np.array([[0.0, 0.0], [100.0, 0.0]]), np.array([[0.0, 3.5], [200.0, 3.5]])
    bent, rest = blend_over(ends, goes_on, 40.0)
    assert bent[0] == pytest.approx([0.0, 0.0])
    assert bent[-1] == pytest.approx([100.0, 3.5])
    assert rest[0] == pytest.approx([100.0, 3.5])
    assert length_of(rest) == pytest.approx(100.0)
    before = bent[bent[:, 0] < 60.0]
    assert np.all(before[:, 1] == 0.0)
    middle = bent[np.argmin(np.abs(bent[:, 0] - 80.0))]
    assert middle[1] == pytest.approx(1.75, abs=0.01)
    assert np.all(np.diff(bent[:, 1]) >= 0)
