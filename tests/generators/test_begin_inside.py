"""Lanes that begin on another lane."""

from __future__ import annotations

import numpy as np

from scex_sumo.generators.begin_inside import begin_inside

MAIN = np.array([[0.0, 0.0], [100.0, 0.0]])


def test_a_lane_that_begins_on_another_lane_begins_inside() -> None:
    side = np.array([[50.0, 1.0], [60.0, 20.0]])
    shapes = {"main": MAIN, "side": side}
    assert begin_inside(shapes, starts=["main", "side"], loose={"main"}, apart={}) == {"side"}


def test_lanes_that_begin_together_at_the_border_do_not() -> None:
    side = np.array([[1.0, 0.5], [60.0, 20.0]])
    shapes = {"main": MAIN, "side": side}
    assert begin_inside(shapes, starts=["main", "side"], loose=set(shapes), apart={}) == set()


def test_what_a_lane_leads_to_is_no_other_traffic() -> None:
    stub, branch = np.array([[50.0, 0.0], [50.5, 0.0]]), np.array([[50.5, 0.0], [90.0, 9.0]])
    shapes = {"stub": stub, "branch": branch}
    assert begin_inside(shapes, starts=["stub"], loose=set(), apart={"stub": ["branch"]}) == set()
