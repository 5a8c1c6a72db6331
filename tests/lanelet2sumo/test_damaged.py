"""Maps whose lanelets meet by mistake: conversion ends soon, with a net or with one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.lanelet2sumo.topology.graph import MAX_LINKS
from scex_sumo.road import Regulation, Road
from scex_sumo.roads.places import lanes_ahead
from tests.converters.sumo_roads import lane, road
from tests.lanelet2sumo.judge.conflicts import find_conflicts


def diamonds(count: int, step_m: float) -> Road:
    """Lanes that fork and join ``count`` times in a row: 2 ** count ways; a light holds the first."""
    lanes = [lane(1, [(-30, 0), (0, 0)], to=(2, 3))]
    for k in range(count):
        after = (2 * k + 4, 2 * k + 5) if k + 1 < count else (2 * k + 4,)
        tips = (k * step_m, 0.0), (k * step_m + step_m, 0.0)
        for i, side in ((2 * k + 2, 0.4), (2 * k + 3, -0.6)):
            lanes.append(lane(i, [tips[0], (tips[0][0] + step_m / 2, side * step_m), tips[1]], to=after))
    lanes.append(lane(2 * count + 2, [(count * step_m, 0), (count * step_m + 30, 0)]))
    return road(lanes, [Regulation(element_id=900, kind="traffic_light", lanes=(1,))])


def web(lanes: int, places: int) -> Road:
    """Lanes between few places, each of which leads to all that begin where it ends."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 40, (places, 2))
    ends = [rng.choice(places, 2, replace=False) for _ in range(lanes)]
    return road(
        lane(i + 1, points[[a, b]], to=tuple(j + 1 for j, (start, _) in enumerate(ends) if start == b))
        for i, (a, b) in enumerate(ends)
    )


def test_a_map_with_exponentially_many_ways_is_converted(tmp_path: Path) -> None:
    drawn = diamonds(60, 0.1)
    assert convert(drawn, tmp_path / "n.net.xml").path.is_file()
    assert set(lanes_ahead(drawn.lanes, [1], 31.05)) == set(range(1, 20))
    merges = find_conflicts(diamonds(12, 0.1).lanes)
    assert [(c.first, c.second, c.kind) for c in merges] == [(k, k + 1, "merge") for k in range(2, 26, 2)]


def test_a_junction_that_sumo_would_refuse_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=rf"^lanelet \d+: .* more than {MAX_LINKS} connections"):
        convert(web(60, 8), tmp_path / "n.net.xml")
