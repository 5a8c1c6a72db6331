"""Targets by hand: on a straight and on a circular road, and for vehicles that were put off."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.learned.training.data.targets import smooth_return


def test_the_way_back_begins_where_the_vehicle_is_and_heads() -> None:
    way = np.linspace(0.0, 40.0, 4001)[None]
    back = smooth_return(np.array([0.7]), np.array([0.1]), np.array([10.0]), way)[0]
    assert back[0] == pytest.approx(0.7)
    assert (back[1] - back[0]) / 0.01 == pytest.approx(0.1, abs=1e-3)  # one step of 1 cm of a smooth curve


def test_the_way_back_ends_on_the_recorded_track_and_along_it() -> None:
    way = np.array([[24.99, 25.0, 30.0]])  # 2.5 s at 10 m/s
    back = smooth_return(np.array([-0.7]), np.array([0.0]), np.array([10.0]), way)[0]
    np.testing.assert_allclose(back, 0.0, atol=1e-6)
