"""Actions that cannot happen are not counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.certainty.response.motion.actions import DRIFTS, GOES_ON
from scex_sumo.road import Lane, Road
from tests.certainty.response.scenes import cases, steady


def lane(lane_id: int, y: float, heading: float) -> Lane:
    along = np.linspace(-100.0, 100.0, 41)
    x = along if heading == 0 else along[::-1]
    side = 1.6 if heading == 0 else -1.6
    lines = [np.stack([x, np.full(41, y + d)], axis=1) for d in (0.0, side, -side)]
    return Lane(
        lane_id=lane_id,
        centreline=lines[0],
        left_bound=lines[1],
        right_bound=lines[2],
        width_m=3.2,
        speed_limit_mps=13.9,
    )


@pytest.mark.parametrize(("apart", "possible"), [(3.2, True), (4.1, True), (4.3, False), (5.4, False)])
def test_nobody_drifts_over_a_median_of_more_than_a_metre(apart: float, possible: bool) -> None:
    lanes = {1: lane(1, 0.0, 0.0), 2: lane(2, apart, np.pi)}
    found = steady((0.0, 0.0, 0.0, 10.0), (60.0, apart, np.pi, 10.0))
    found = replace(found, scene=replace(found.scene, road=Road(name="street", lanes=lanes)))
    assert bool(len(cases(found, DRIFTS))) == possible


@pytest.mark.parametrize(("y", "heading", "possible"), [(0.0, 0.0, False), (-20.0, np.pi / 2, True)])
def test_who_comes_up_to_a_queue_does_not_go_on_into_it(y: float, heading: float, possible: bool) -> None:
    x = -40.0 if heading == 0.0 else 15.0
    found = steady((0.0, 0.0, 0.0, 4.0), (x, y, heading, 8.0), waits=(1,))
    assert bool(len(cases(found, GOES_ON))) == possible


def test_who_comes_round_a_bend_up_to_a_queue_does_not_go_on_into_it() -> None:
    """The line of the one ahead begins a few metres behind it, so the bend is not on it."""
    found = steady((0.0, 15.0, np.pi / 2, 4.0), (-40.0, 0.0, 0.0, 8.0), waits=(1,))
    lines = found.lines
    way = lines.start[1] + lines.spacing_m * np.arange(lines.x.shape[1])
    for values, after in (
        (lines.x, 0.0 * way),
        (lines.y, way - 40.0),
        (lines.heading, np.pi / 2 + 0.0 * way),
    ):
        values[1] = np.where(way > 40.0, after, values[1])
    assert not len(cases(found, GOES_ON))
