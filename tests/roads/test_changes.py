"""Centrelines over lane changes."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.geometry.polylines import length_of
from scex_sumo.roads.changes import blend_over


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
