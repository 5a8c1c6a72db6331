"""Lanelet2 maps as roads: geometry, relations, rules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.road import Road
from tests.converters.maps import CURB, DASHED, ROAD, Lanelet, Line, Relation, area, rule, straight, write_map

# Coordinates pass through latitude and longitude and back: nanometres in double precision.
CLOSE = {"atol": 1e-6, "rtol": 0.0}


def road_of(tmp_path: Path, lanelets: list[Lanelet], **other: list[Line] | list[Relation]) -> Road:
    return read_road(write_map(tmp_path / "drawn.osm", lanelets, **other))  # type: ignore[arg-type]


def test_centreline_lies_midway_between_the_bounds(tmp_path: Path) -> None:
    lane = road_of(tmp_path, [straight(1, 0, 50)]).lanes[1]
    np.testing.assert_allclose(lane.centreline[[0, -1]], [(0, 1.75), (50, 1.75)], **CLOSE)
    np.testing.assert_allclose(lane.left_bound, [(0, 3.5), (50, 3.5)], **CLOSE)
    np.testing.assert_allclose(lane.right_bound, [(0, 0), (50, 0)], **CLOSE)
    assert lane.width_m == pytest.approx(3.5, abs=1e-6)


def test_bounds_drawn_against_the_driving_direction_are_turned(tmp_path: Path) -> None:
    drawn = Lanelet(1, left=[(50, 3), (0, 3)], right=[(0, 0), (50, 0)])
    lane = road_of(tmp_path, [drawn]).lanes[1]
    np.testing.assert_allclose(lane.left_bound, [(0, 3), (50, 3)], **CLOSE)
    np.testing.assert_allclose(lane.centreline[[0, -1]], [(0, 1.5), (50, 1.5)], **CLOSE)


def test_a_fork_and_a_merge_are_followed_both_ways(tmp_path: Path) -> None:
    fork = Lanelet(3, left=[(50, 3.5), (90, 13.5)], right=[(50, 0), (90, 10)])
    merge = Lanelet(4, left=[(10, 23.5), (50, 3.5)], right=[(10, 20), (50, 0)])
    lanes = road_of(tmp_path, [straight(1, 0, 50), straight(2, 50, 90), fork, merge]).lanes
    assert lanes[1].successors == lanes[4].successors == (2, 3)
    assert lanes[2].predecessors == lanes[3].predecessors == (1, 4)
    assert lanes[2].conflicts == (3,)
    assert lanes[1].conflicts == (4,)


def test_lane_changes_obey_the_line_between(tmp_path: Path) -> None:
    right, left = straight(1, 0, 50, left_tags=DASHED), straight(2, 0, 50, y=3.5, right_tags=DASHED)
    lanes = road_of(tmp_path, [right, left]).lanes
    assert (lanes[1].left, lanes[1].right) == (2, None)
    assert (lanes[2].left, lanes[2].right) == (None, 1)
    assert (lanes[1].adjacent_left, lanes[2].adjacent_right) == (2, 1)


def test_a_line_dashed_on_one_side_allows_the_change_from_there(tmp_path: Path) -> None:
    line = {"type": "line_thin", "subtype": "dashed_solid"}  # left part dashed, right part solid
    right, left = straight(1, 0, 50, left_tags=line), straight(2, 0, 50, y=3.5, right_tags=line)
    lanes = road_of(tmp_path, [right, left]).lanes
    assert lanes[1].left is None
    assert lanes[2].right == 1
    assert lanes[1].adjacent_left == 2


def test_crossing_lanes_conflict_and_are_named_once(tmp_path: Path) -> None:
    crossing = Lanelet(2, left=[(20, -20), (20, 20)], right=[(24, -20), (24, 20)])
    lanes = road_of(tmp_path, [straight(1, 0, 50), crossing]).lanes
    assert lanes[1].conflicts == (2,)
    assert lanes[2].conflicts == (1,)


def test_a_crosswalk_is_no_vehicle_lane_and_conflicts_with_none(tmp_path: Path) -> None:
    tags = {"subtype": "crosswalk", "location": "urban"}
    crosswalk = Lanelet(2, left=[(20, -5), (20, 10)], right=[(24, -5), (24, 10)], tags=tags)
    road = road_of(tmp_path, [straight(1, 0, 50), crosswalk])
    assert list(road.vehicle_lanes) == [1]
    assert road.lanes[2].kind == "pedestrian"
    assert road.lanes[1].conflicts == road.lanes[2].conflicts == ()
    drawn = next(a for a in road.areas if a.area_id == 2)
    assert drawn.kind == "crosswalk"
    np.testing.assert_allclose(drawn.outline, [(20, -5), (20, 10), (24, 10), (24, -5)], **CLOSE)


@pytest.mark.parametrize(
    ("tags", "kind"),
    [
        ({}, "vehicle"),
        ({"subtype": "road"}, "vehicle"),
        ({"subtype": "highway"}, "vehicle"),
        ({"subtype": "play_street"}, "vehicle"),
        ({"subtype": "walkway", "participant:vehicle": "yes"}, "vehicle"),
        ({"participant:vehicle:car": "yes"}, "vehicle"),
        ({"subtype": "road", "participant:vehicle": "no"}, "other"),
        ({"subtype": "bus_lane"}, "bus"),
        ({"participant:vehicle:bus": "yes"}, "bus"),
        ({"subtype": "bicycle_lane"}, "bicycle"),
        ({"subtype": "bikelane"}, "bicycle"),
        ({"participant:bicycle": "yes"}, "bicycle"),
        ({"subtype": "walkway"}, "pedestrian"),
        ({"subtype": "shared_walkway"}, "pedestrian"),
        ({"participant:pedestrian": "yes"}, "pedestrian"),
        ({"subtype": "emergency_lane"}, "other"),
        ({"subtype": "rail"}, "other"),
    ],
)
def test_the_kind_of_a_lane_follows_its_participants(tmp_path: Path, tags: dict[str, str], kind: str) -> None:
    assert road_of(tmp_path, [straight(1, 0, 50, tags=tags)]).lanes[1].kind == kind


def test_a_two_way_lanelet_is_a_lane_in_each_direction(tmp_path: Path) -> None:
    two_way = straight(1, 0, 50, tags={**ROAD, "one_way": "no"})
    lanes = road_of(tmp_path, [two_way, straight(2, 50, 90)]).lanes
    back = next(lane for lane in lanes.values() if lane.reverse_of == 1)
    assert len(lanes) == 3
    assert lanes[1].reverse_of is None
    np.testing.assert_allclose(back.centreline[[0, -1]], [(50, 1.75), (0, 1.75)], **CLOSE)
    np.testing.assert_allclose(back.left_bound, [(50, 0), (0, 0)], **CLOSE)
    assert lanes[1].successors == (2,)
    assert (back.successors, back.predecessors, back.conflicts) == ((), (), ())


def test_right_of_way_names_who_yields_and_where(tmp_path: Path) -> None:
    crossing = Lanelet(2, left=[(20, -20), (20, 20)], right=[(24, -20), (24, 20)], rules=[90])
    sign = Line(8, [(25, -3), (25.5, -3)], {"type": "traffic_sign", "subtype": "de205"})
    element = rule(90, "right_of_way", [("yield", 2), ("right_of_way", 1), ("ref_line", 7), ("refers", 8)])
    road = road_of(
        tmp_path,
        [straight(1, 0, 50, rules=[90]), crossing],
        lines=[Line(7, [(20, -1), (24, -1)]), sign],
        relations=[element],
    )
    (found,) = road.regulations
    assert (found.element_id, found.kind, found.lanes) == (90, "right_of_way", (1, 2))
    assert (found.yielding, found.priority, found.signs) == ((2,), (1,), ("de205",))
    np.testing.assert_allclose(found.stop_lines[0], [(20, -1), (24, -1)], **CLOSE)


def test_at_an_all_way_stop_all_yield(tmp_path: Path) -> None:
    crossing = Lanelet(2, left=[(20, -20), (20, 20)], right=[(24, -20), (24, 20)], rules=[90])
    road = road_of(
        tmp_path,
        [straight(1, 0, 50, rules=[90]), crossing],
        lines=[Line(7, [(20, -1), (24, -1)]), Line(8, [(19, 0), (19, 3.5)])],
        relations=[rule(90, "all_way_stop", [("yield", 1), ("yield", 2), ("ref_line", 7), ("ref_line", 8)])],
    )
    (found,) = road.regulations
    assert (found.kind, found.yielding, found.priority) == ("all_way_stop", (1, 2), ())
    assert len(found.stop_lines) == 2


def test_a_traffic_light_has_lights_and_a_stop_line(tmp_path: Path) -> None:
    light = Line(8, [(25, 4), (25, 5)], {"type": "traffic_light", "subtype": "red_yellow_green"})
    road = road_of(
        tmp_path,
        [straight(1, 0, 20, rules=[90]), straight(2, 20, 40)],
        lines=[Line(7, [(19, 0), (19, 3.5)]), light],
        relations=[rule(90, "traffic_light", [("refers", 8), ("ref_line", 7)])],
    )
    (found,) = road.regulations
    assert (found.kind, found.lanes, found.lights) == ("traffic_light", (1,), (8,))
    np.testing.assert_allclose(found.stop_lines[0], [(19, 0), (19, 3.5)], **CLOSE)
    assert not any(marking.kind == "traffic_light" for marking in road.markings)


@pytest.mark.parametrize(
    ("sign", "kind"), [("de206", "stop"), ("usR1-1", "stop"), ("de205", "yield"), ("usR1-2", "yield")]
)
def test_a_stop_or_yield_sign_regulates_the_lanes_that_name_it(tmp_path: Path, sign: str, kind: str) -> None:
    post = Line(8, [(25, 4), (25, 5)], {"type": "traffic_sign", "subtype": sign})
    road = road_of(
        tmp_path,
        [straight(1, 0, 20, rules=[90]), straight(2, 20, 40)],
        lines=[Line(7, [(19, 0), (19, 3.5)]), post],
        relations=[rule(90, "traffic_sign", [("refers", 8), ("ref_line", 7)])],
    )
    (found,) = road.regulations
    assert (found.kind, found.yielding, found.signs) == (kind, (1,), (sign,))


def test_an_area_is_closed_over_several_lines(tmp_path: Path) -> None:
    lines = [
        Line(7, [(0, 10), (9, 10)], CURB),
        Line(8, [(0, 19), (0, 10)], CURB),  # against the ring's direction
        Line(9, [(9, 10), (9, 19), (0, 19)], CURB),
    ]
    road = road_of(tmp_path, [straight(1, 0, 50)], lines=lines, relations=[area(60, [7, 8, 9], "keepout")])
    (found,) = road.areas
    assert (found.area_id, found.kind, len(found.outline)) == (60, "keepout", 4)
    assert {(round(x), round(y)) for x, y in found.outline} == {(0, 10), (9, 10), (9, 19), (0, 19)}


def test_a_map_far_from_its_origin_is_refused(tmp_path: Path) -> None:
    drawn = write_map(tmp_path / "drawn.osm", [straight(1, 0, 50)])
    with pytest.raises(
        MapError, match=r"drawn\.osm: the map is 5\d\d\d km away .* 49,8\.4; .* --origin LAT,LON"
    ):
        read_road(drawn, origin=(49.0, 8.4))
