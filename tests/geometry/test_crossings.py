"""Places on polylines, for many at once."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.geometry.crossings import Polylines


def test_points_are_projected_onto_lines_that_go_on_straight_past_both_ends() -> None:
    """A line 10 m to the east, then 5 m to the north: points before, beside, below the corner, beyond."""
    corner = Polylines.build(np.array([[0.0, 10.0, 10.0]]), np.array([[0.0, 0.0, 5.0]]))
    x, y = np.array([[-3.0], [4.0], [10.0], [9.0]]), np.array([[1.0], [-2.0], [-2.0], [7.0]])
    arc, offset, cos, sin = corner.project(np.zeros(1, dtype=np.int64), x, y)
    assert arc[:, 0] == pytest.approx([-3.0, 4.0, 10.0, 17.0])
    assert offset[:, 0] == pytest.approx([1.0, -2.0, -2.0, 1.0])
    assert np.column_stack([cos, sin]).tolist() == [[1.0, 0.0]] * 3 + [[0.0, 1.0]]


def test_a_segment_without_length_has_the_direction_of_the_last_one() -> None:
    """A vehicle that stands: two equal nodes, then 5 m to the north."""
    standing = Polylines.build(np.zeros((1, 3)), np.array([[0.0, 0.0, 5.0]]))
    arc, offset, cos, sin = standing.project(
        np.zeros(1, dtype=np.int64), np.array([[1.0]]), np.array([[-2.0]])
    )
    assert [float(a[0, 0]) for a in (arc, offset, cos, sin)] == pytest.approx([-2.0, -1.0, 0.0, 1.0])
