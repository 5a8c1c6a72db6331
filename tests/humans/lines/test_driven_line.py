"""Driven line: inwards in wide curves, within the room, elsewhere the centreline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.driving.paths import resample
from scex_sumo.geometry.polylines import length_of
from scex_sumo.humans.lines.driven_line import driven_lines, room_of
from scex_sumo.humans.observed.observations import CLEAR_M
from tests.behaviors import roads

RADIUS = 15.0


def bend(room: float) -> tuple[FloatArray, FloatArray]:
    """A right angle to the left between two straights of 40 m, and its driven line."""
    angle = np.linspace(-np.pi / 2, 0.0, 60)
    turn = np.column_stack([40.0 + RADIUS * np.cos(angle), RADIUS + RADIUS * np.sin(angle)])
    line = np.vstack([[(0.0, 0.0)], turn, [(40.0 + RADIUS, 55.0)]])
    centre = resample(line, int(length_of(line) / 0.5), 0.5)
    sides = np.full((1, len(centre), 2), room)
    return centre, driven_lines(centre[None], centre[None], sides, 0.5)[0]


def inwards(centre: FloatArray, line: FloatArray) -> FloatArray:
    """(N,) shift towards the left of the centreline, m."""
    step = np.gradient(centre, axis=0)
    left = np.column_stack([-step[:, 1], step[:, 0]]) / np.hypot(*step.T)[:, None]
    return np.asarray(((line - centre) * left).sum(axis=1))


def test_in_a_wide_curve_people_take_the_shorter_line_within_the_room() -> None:
    centre, line = bend(5.0)
    shift = inwards(centre, line)
    assert length_of(line) < length_of(centre) - 1.0
    assert 1.0 < shift.max() < 5.0 - CLEAR_M + 0.1
    assert abs(shift[:20]).max() < 0.3  # 30 m before the curve it is the centreline


def test_a_narrow_lane_leaves_no_choice() -> None:
    centre, line = bend(1.3)
    assert inwards(centre, line) == pytest.approx(0.0, abs=0.01)


def test_room_is_the_distance_to_the_bounds_of_the_lane_under_each_point() -> None:
    line, up = np.array([(0.0, 0.0), (100.0, 0.0)]), np.array([0.0, 5.0])
    lane = replace(roads.lane(1, line), left_bound=line + up, right_bound=line - 0.4 * up)
    room = room_of(roads.road(lane), line, np.array([1, 1]), np.array([10.0, 20.0]))
    assert room == pytest.approx(np.array([[5.0, 2.0], [5.0, 2.0]]))
