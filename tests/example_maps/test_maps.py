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
def test_maps_lie_around_1000_1000_as_interaction_maps_do(name: str):
    points = np.vstack([lane.centreline for lane in road(name).lanes.values()])
    assert np.all(np.abs(points.mean(0) - 1000) < 150)


@pytest.mark.parametrize("name", EXAMPLES)
def test_from_every_way_in_every_kind_of_lane_leads_out(name: str):
    lanes = road(name).vehicle_lanes
    exits = {i for i, lane in lanes.items() if not lane.successors}
    for start in lanes:
        assert reachable(lanes, start) & exits


@pytest.mark.parametrize("name", EXAMPLES)
def test_bounds_are_smooth(name: str):
    # Drawn within 2 cm of the smallest radius of about 8 m: no step may turn by more than 2 asin(1.3 / 16).
    for lane in road(name).vehicle_lanes.values():
        for bound in (lane.left_bound, lane.right_bound):
            step = np.diff(bound, axis=0)
            heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
            assert np.degrees(np.abs(np.diff(heading)).max(initial=0)) < 13


@pytest.mark.parametrize("name", EXAMPLES)
def test_successors_go_on_in_the_same_direction(name: str):
    lanes = road(name).vehicle_lanes
    for lane in lanes.values():
        for onward in lane.successors:
            before = np.diff(lane.right_bound[-2:], axis=0)[0]
            after = np.diff(lanes[onward].right_bound[:2], axis=0)[0]
            turn = np.angle(complex(*after) / complex(*before))
            assert abs(np.degrees(turn)) < 7  # half a step on either side


@pytest.mark.parametrize("name", EXAMPLES)
def test_lanes_are_as_wide_as_at_their_ends(name: str):
    # Most have one width; those into the roundabout widen. 8 cm: a shared bound cannot fit both its lanes.
    for lane in road(name).vehicle_lanes.values():
        left, right = LineString(lane.left_bound), LineString(lane.right_bound)
        widths = [left.distance(Point(p)) + right.distance(Point(p)) for p in lane.centreline[1:-1]]
        ends = np.linalg.norm(lane.left_bound[[0, -1]] - lane.right_bound[[0, -1]], axis=1)
        assert ends.min() - 0.08 < min(widths) <= max(widths) < ends.max() + 0.08
        assert 3.2 < ends.min() <= ends.max() < 4.6


def changes(road: Road) -> set[tuple[int, int]]:
    """Permitted lane changes as (from, to)."""
    lanes = road.vehicle_lanes.values()
    return {(lane.lane_id, to) for lane in lanes for to in (lane.left, lane.right) if to is not None}


def ends(lanes: dict[int, Lane], where: str) -> list[Lane]:
    """Lanes that begin (``predecessors``) or end (``successors``) at the map's edge."""
    return [lane for lane in lanes.values() if not getattr(lane, where)]


def test_roundabout_has_five_ways_in_and_five_out():
    # One each way on four arms; the southern enters and the northern leaves on two lanes.
    lanes = road("roundabout").vehicle_lanes
    assert len(ends(lanes, "predecessors")) == 5
    assert len(ends(lanes, "successors")) == 5


def test_roundabout_can_be_left_on_every_arm_from_every_arm():
    lanes = road("roundabout").vehicle_lanes
    exits = {lane.lane_id for lane in ends(lanes, "successors")}
    for start in ends(lanes, "predecessors"):
        assert len(reachable(lanes, start.lane_id) & exits) == 5


def test_roundabout_ring_is_closed_and_partly_two_lanes_wide():
    lanes = road("roundabout").vehicle_lanes

    def radius(lane: Lane) -> float:
        return float(np.hypot(*(lane.centreline[[0, -1]] - 1000).T).max())

    inner = [lane for lane in lanes.values() if radius(lane) < 18.5]
    angles = [np.angle(complex(*(p - 1000))) for lane in inner for p in lane.centreline]
    assert np.diff(np.sort(angles)).max() < 0.1  # all the way around
    assert sum(lane.adjacent_right is not None for lane in inner) == 3
    assert sum(lane.right is not None for lane in inner) == 2  # the third line is solid


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


def test_motorway_has_three_through_lanes_and_a_ramp_that_ends():
    lanes = road("motorway_merge").vehicle_lanes
    assert len(ends(lanes, "predecessors")) == 4
    last = ends(lanes, "successors")
    assert len(last) == 4
    (ending,) = [lane for lane in last if lane.left is not None and lane.centreline[-1, 0] < 1250]
    assert lanes[ending.left or 0].successors
    limits = {round(lane.speed_limit_mps * 3.6) for lane in lanes.values()}
    assert limits == {60, 120}


def test_intersection_has_twelve_movements_from_seven_lanes():
    lanes = road("urban_intersection").vehicle_lanes
    movements = [lane for lane in lanes.values() if len(lane.conflicts) >= 3]
    assert len(movements) == 12
    assert len({lane.predecessors for lane in movements}) == 7
    assert len({lane.successors for lane in movements}) == 4


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


def test_intersection_arms_are_not_at_right_angles():
    lanes = road("urban_intersection").vehicle_lanes
    into = {lane.predecessors for lane in lanes.values() if len(lane.conflicts) >= 3}
    directions = set()
    for (approach,) in into:
        step = np.diff(lanes[approach].centreline[-2:], axis=0)[0]
        directions.add(round(float(np.degrees(np.arctan2(step[1], step[0])))) % 360)
    between = np.diff(sorted(directions))
    assert all(abs(turn - 90) > 4 for turn in between if turn > 20)


def test_intersection_has_a_zebra_crossing_for_pedestrians():
    (zebra,) = [lane for lane in road("urban_intersection").lanes.values() if lane.kind == "pedestrian"]
    assert zebra.subtype == "crosswalk"
    assert zebra.width_m == pytest.approx(4.0, abs=0.01)
