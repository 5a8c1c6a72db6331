"""The example maps, read as users read them: every relation as it was drawn."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from example_maps.make_examples import draw
from scex_sumo.base.errors import UsageError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.road import Lane, Road
from scex_sumo.scenarios import EXAMPLES, example_path


@cache
def road(name: str) -> Road:
    return read_road(example_path(name))


def reachable(lanes: dict[int, Lane], start: int) -> set[int]:
    """Lanes that can be reached by driving on and by permitted lane changes."""
    found, queue = {start}, [start]
    while queue:
        lane = lanes[queue.pop()]
        for onward in (*lane.successors, lane.left, lane.right):
            if onward is not None and onward not in found:
                found.add(onward)
                queue.append(onward)
    return found


def test_there_are_three_examples_and_each_has_its_tracks_beside_it():
    assert set(EXAMPLES) == {"roundabout", "motorway_merge", "urban_intersection"}
    for path in map(example_path, EXAMPLES):
        assert path.exists()
        assert path.with_suffix(".csv").stat().st_size < 300_000


def test_an_unknown_example_is_refused_with_the_choices():
    with pytest.raises(UsageError, match=r"'ring'; known: roundabout, motorway_merge"):
        example_path("ring")


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_script_draws_the_shipped_map(name: str, tmp_path: Path):
    draw(name).write(tmp_path / "map.osm")
    drawn, shipped = (path.read_text() for path in (tmp_path / "map.osm", example_path(name)))
    place = re.compile(r'(lat|lon)="([^"]*)"')
    assert place.sub("", drawn) == place.sub("", shipped)
    places, known = ([float(number) for _, number in place.findall(text)] for text in (drawn, shipped))
    # The last digit, of 1e-11 degrees or a micrometre, is that of the projection that drew them.
    np.testing.assert_allclose(places, known, rtol=0, atol=1.5e-11)


@pytest.mark.parametrize("name", EXAMPLES)
def test_maps_are_read_without_repairs(name: str):
    assert road(name).notes == ()


@pytest.mark.parametrize("name", EXAMPLES)
def test_from_every_way_in_every_kind_of_lane_leads_out(name: str):
    lanes = road(name).vehicle_lanes
    exits = {i for i, lane in lanes.items() if not lane.successors}
    for start in lanes:
        assert reachable(lanes, start) & exits


def changes(road: Road) -> set[tuple[int, int]]:
    """Permitted lane changes as (from, to)."""
    lanes = road.vehicle_lanes.values()
    return {(lane.lane_id, to) for lane in lanes for to in (lane.left, lane.right) if to is not None}


def ends(lanes: dict[int, Lane], where: str) -> list[Lane]:
    """Lanes that begin (``predecessors``) or end (``successors``) at the map's edge."""
    return [lane for lane in lanes.values() if not getattr(lane, where)]


def test_roundabout_can_be_left_on_every_arm_from_every_arm():
    lanes = road("roundabout").vehicle_lanes
    exits = {lane.lane_id for lane in ends(lanes, "successors")}
    for start in ends(lanes, "predecessors"):
        assert len(reachable(lanes, start.lane_id) & exits) == 5


def test_roundabout_entries_give_way_to_the_ring_and_wait_at_their_lines():
    ways = [rule for rule in road("roundabout").regulations if rule.kind == "right_of_way"]
    lanes = road("roundabout").vehicle_lanes
    assert sorted(len(rule.yielding) for rule in ways) == [1, 1, 2, 2]
    for rule in ways:
        entries = [lanes[waiting].successors[0] for waiting in rule.yielding]
        assert set(rule.priority) <= {foe for entry in entries for foe in lanes[entry].conflicts}
        for waiting in rule.yielding:
            gap = LineString(rule.stop_lines[0]).distance(Point(lanes[waiting].centreline[-1]))
            assert gap < 0.05  # the centreline ends on the line, up to where Lanelet2 puts its last point


def test_motorway_lane_changes_follow_the_lines():
    merge = road("motorway_merge")
    lanes, permitted = merge.vehicle_lanes, changes(merge)
    right = [lane for lane in lanes.values() if lane.adjacent_right is not None]
    beside = [lane for lane in right if lanes[lane.adjacent_right or 0].adjacent_right is None]
    beside = [lane for lane in beside if lanes[lane.adjacent_left or 0].adjacent_left is not None]
    beside.sort(key=lambda lane: float(lane.centreline[0, 0]))
    onto = [((lane.adjacent_right or 0), lane.lane_id) in permitted for lane in beside]
    back = [(lane.lane_id, (lane.adjacent_right or 0)) in permitted for lane in beside]
    # Solid, dashed for those who enter, dashed for all: the three sections of the acceleration lane.
    assert onto == [False, True, True]
    assert back == [False, False, True]


def test_intersection_minor_road_and_left_turns_give_way():
    crossing = road("urban_intersection")
    ways = [rule for rule in crossing.regulations if rule.kind == "right_of_way"]
    with_line = {lane for rule in ways if rule.stop_lines for lane in rule.yielding}
    without = {lane for rule in ways if not rule.stop_lines for lane in rule.yielding}
    assert len(with_line) == 6  # three movements from either minor arm
    assert len(without) == 4  # one left turn from each arm
    for rule in ways:
        for lane in rule.yielding:
            assert set(rule.priority) <= set(crossing.lanes[lane].conflicts)


def test_intersection_has_a_zebra_crossing_for_pedestrians():
    (zebra,) = [lane for lane in road("urban_intersection").lanes.values() if lane.kind == "pedestrian"]
    assert zebra.subtype == "crosswalk"
    assert zebra.width_m == pytest.approx(4.0, abs=0.01)
