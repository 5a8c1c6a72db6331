"""Overlapping lanes found by geometry are those of Lanelet2's routing graph; CommonRoad keeps a whole map."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.maps import read_map
from scex_sumo.formats.lane_maps.lane_links import overlapping
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Lane, Road
from scex_sumo.roads.conflicts import conflicts
from tests.formats.commonroad.commonroad_maps import Lanelet, Sign, write_scenario
from tests.lanelet2sumo.judge.report import check_net

REAL = (
    "interaction/maps/DR_DEU_Merging_MT.osm",
    "interaction/maps/DR_DEU_Roundabout_OF.osm",
    "taf_bw/maps/k729_2022-03-16.osm",
    "taf_bw/maps/k733_2020-09-15.osm",
)


@pytest.mark.parametrize("name", REAL)
def test_conflicts_by_geometry_are_those_of_lanelet2(name: str, data: Path) -> None:
    lanes = read_road(data / name).vehicle_lanes
    blank = {i: replace(lane, conflicts=()) for i, lane in lanes.items()}
    found = overlapping(blank, {i: lane.centreline for i, lane in lanes.items()})
    # Lanelet2 also names lanes that reach less than 0.2 m into each other; no car is in another's way there.
    assert all(set(found[i].conflicts) <= set(lane.conflicts) for i, lane in lanes.items())
    assert conflicts(found) == conflicts(lanes)


@pytest.mark.parametrize("name", REAL)
def test_a_lanelet2_map_written_as_commonroad_is_the_same_road(name: str, data: Path, tmp_path: Path) -> None:
    road = read_road(data / name)
    number = {i: k for k, i in enumerate(road.vehicle_lanes, start=1)}  # CommonRoad's ids are positive
    lanelets = [_lanelet(lane, road, number) for lane in road.vehicle_lanes.values()]
    limits = sorted({lane.speed_limit_mps for lane in road.vehicle_lanes.values()})
    signs = [Sign(10_000 + k, "274", [repr(limit)]) for k, limit in enumerate(limits)]
    signed = [
        replace(lanelet, signs=[10_000 + limits.index(lane.speed_limit_mps)])
        for lanelet, lane in zip(lanelets, road.vehicle_lanes.values(), strict=True)
    ]
    again = read_map(write_scenario(tmp_path / "map.xml", signed, signs=signs))
    assert again.vehicle_lanes.keys() == set(number.values())
    for i, lane in road.vehicle_lanes.items():
        copy = again.lanes[number[i]]
        assert copy.successors == tuple(sorted(number[j] for j in lane.successors))
        assert copy.left == (number[lane.left] if lane.left is not None else None)
        assert copy.right == (number[lane.right] if lane.right is not None else None)
        assert copy.speed_limit_mps == lane.speed_limit_mps
        assert abs(copy.width_m - lane.width_m) < 1e-6
    net = convert(again, tmp_path / "map.net.xml")
    # The lights and signs of the maps are not written: who goes first there is not what this is about.
    problems = check_net(net.path, again, net.lanes).problems()
    assert [problem for problem in problems if "right before left" not in problem] == []


def _lanelet(lane: Lane, road: Road, number: dict[int, int]) -> Lanelet:
    def marking(left: int | None, right: int | None) -> str:
        """The line between two neighbours that allows what Lanelet2 allows."""
        if left is None or right is None:
            return ""
        to_left, to_right = road.lanes[right].left == left, road.lanes[left].right == right
        words = {(True, True): "dashed", (True, False): "solid_dashed", (False, True): "dashed_solid"}
        return words.get((to_left, to_right), "solid")

    beside = (lane.adjacent_left, lane.adjacent_right)
    sides = [(number[i], "same") if i is not None else None for i in beside]
    return Lanelet(
        number[lane.lane_id],
        left=[(repr(float(x)), repr(float(y))) for x, y in lane.left_bound],  # type: ignore[misc]
        right=[(repr(float(x)), repr(float(y))) for x, y in lane.right_bound],  # type: ignore[misc]
        successors=[number[i] for i in lane.successors],
        predecessors=[number[i] for i in lane.predecessors],
        left_of=sides[0],
        right_of=sides[1],
        left_marking=marking(lane.adjacent_left, lane.lane_id),
        right_marking=marking(lane.lane_id, lane.adjacent_right),
    )
