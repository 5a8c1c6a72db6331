"""Lanes that end inside a map are told from its border and from lanes that end beside others."""

from __future__ import annotations

import pytest

from scex_sumo.converters.maps import read_map
from scex_sumo.roads.side import dead_ends
from scex_sumo.scenarios import example_path
from tests.converters.sumo_roads import arc, lane, road


def test_a_gap_in_a_ring_is_named_on_both_sides() -> None:
    around = [lane(1, arc((0, 0), 15.0, 0, 150), to=(2,)), lane(2, arc((0, 0), 15.0, 180, 360), to=(1,))]
    open_ring = [lane(1, arc((0, 0), 15.0, 0, 150)), lane(2, arc((0, 0), 15.0, 180, 360), to=(1,))]
    assert dead_ends(road(around).lanes) == []
    assert dead_ends(road(open_ring).lanes) == [1, 2]


def test_lanes_end_at_the_border_beside_others_and_before_crossing_or_oncoming_traffic() -> None:
    border = [lane(1, [(0, 0), (50, 0)])]
    dropped = [lane(2, [(0, 20), (50, 20)], left=3), lane(3, [(0, 23.5), (90, 23.5)], right=2)]
    crossing = [lane(4, [(60, -40), (60, 10)])]
    oncoming = [lane(5, [(90, 1), (65, 1)])]
    assert dead_ends(road([*border, *dropped, *crossing, *oncoming]).lanes) == []
    assert dead_ends(road([*border, lane(6, [(60, 1), (99, 1)])]).lanes) == [1, 6]


@pytest.mark.parametrize("name", ["roundabout", "motorway_merge", "urban_intersection"])
def test_whole_maps_have_none(name: str) -> None:
    assert dead_ends(read_map(example_path(name)).lanes) == []
