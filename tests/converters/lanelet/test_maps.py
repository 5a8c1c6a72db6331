"""The real maps: everything Lanelet2 says of them is in the road, and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lanelet2 import io, projection, routing, traffic_rules

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.road import Lane

MAPS = {
    "interaction/maps/DR_DEU_Merging_MT.osm": (0.0, 0.0),
    "interaction/maps/DR_DEU_Roundabout_OF.osm": (0.0, 0.0),
    "taf_bw/maps/k729_2022-03-16.osm": (49.01160993928274, 8.43856470258739),
    "taf_bw/maps/k733_2020-09-15.osm": (49.005306, 8.4374089),
}


@pytest.fixture(params=MAPS)
def real_map(request: pytest.FixtureRequest, data: Path) -> tuple[Path, Any, Any]:
    """Path, Lanelet2 map and vehicle routing graph of a real map, loaded here without the package."""
    path = data / request.param
    lanelet_map = io.load(str(path), projection.UtmProjector(io.Origin(*MAPS[request.param])))
    rules = traffic_rules.create(traffic_rules.Locations.Germany, traffic_rules.Participants.Vehicle)
    return path, lanelet_map, routing.RoutingGraph(lanelet_map, rules)


def ids(lanelets: Any) -> tuple[int, ...]:
    return tuple(sorted({lanelet.id for lanelet in lanelets}))


def id_of(lanelet: Any) -> int | None:
    return lanelet.id if lanelet else None


def test_every_lanelet_is_a_lane_with_lanelet2s_geometry(real_map: tuple[Path, Any, Any]) -> None:
    path, lanelet_map, _ = real_map
    road = read_road(path)
    drawn = sorted(lanelet.id for lanelet in lanelet_map.laneletLayer)
    assert [i for i in road.lanes if i in drawn] == drawn
    # k733 lacks a lanelet between two others, and two lanelets without subtype lie across its junction.
    added = "k733" in path.name
    assert (len(road.lanes) - len(drawn), len(road.notes)) == (added, 2 * added)
    for lanelet in lanelet_map.laneletLayer:
        lane = road.lanes[lanelet.id]
        for points, line in (
            (lane.centreline, lanelet.centerline),
            (lane.left_bound, lanelet.leftBound),
            (lane.right_bound, lanelet.rightBound),
        ):
            np.testing.assert_array_equal(points, [(p.x, p.y) for p in line])


def test_a_mended_copy_loses_no_geometry(real_map: tuple[Path, Any, Any], tmp_path: Path) -> None:
    path, _, _ = real_map
    broken = path.read_text().replace(
        "</osm>", '<relation id="1"><tag k="type" v="lanelet"/></relation></osm>'
    )
    (tmp_path / path.name).write_text(broken)
    road, whole = read_road(tmp_path / path.name, origin=read_road(path).origin), read_road(path)
    assert road.notes[0].endswith(": 1")
    assert list(road.lanes) == list(whole.lanes)
    for lane_id, lane in road.lanes.items():
        np.testing.assert_array_equal(lane.centreline, whole.lanes[lane_id].centreline)
        assert lane.successors == whole.lanes[lane_id].successors
        assert lane.conflicts == whole.lanes[lane_id].conflicts
    assert [r.element_id for r in road.regulations] == [r.element_id for r in whole.regulations]
    assert len(road.areas) == len(whole.areas)


def test_relations_are_those_of_lanelet2s_routing_graph(real_map: tuple[Path, Any, Any]) -> None:
    path, lanelet_map, graph = real_map
    road = read_road(path)
    passable = set(ids(graph.passableLaneletSubmap().laneletLayer))
    added = set(road.vehicle_lanes) - passable
    assert len(added) == ("k733" in path.name)

    def drawn(lanes: tuple[int | None, ...]) -> tuple[int | None, ...]:
        return tuple(None if i in added else i for i in lanes)

    for lanelet in lanelet_map.laneletLayer:
        if lanelet.id not in passable:
            continue
        lane: Lane = road.lanes[lanelet.id]
        assert lane.successors == ids(graph.following(lanelet))
        assert tuple(i for i in drawn(lane.predecessors) if i) == ids(graph.previous(lanelet))
        assert lane.conflicts == ids(graph.conflicting(lanelet))
        left, right = graph.left(lanelet), graph.right(lanelet)
        assert drawn((lane.left, lane.right)) == (id_of(left), id_of(right))
        assert drawn((lane.adjacent_left,)) == (id_of(left or graph.adjacentLeft(lanelet)),)
        assert drawn((lane.adjacent_right,)) == (id_of(right or graph.adjacentRight(lanelet)),)


@pytest.mark.parametrize(
    ("name", "kinds", "limits_kmh"),
    [
        ("interaction/maps/DR_DEU_Merging_MT.osm", {"vehicle": 13}, {50: 13}),
        ("interaction/maps/DR_DEU_Roundabout_OF.osm", {"vehicle": 48}, {50: 48}),
        ("taf_bw/maps/k729_2022-03-16.osm", {"vehicle": 32, "pedestrian": 34, "bicycle": 3}, {50: 32}),
        ("taf_bw/maps/k733_2020-09-15.osm", {"vehicle": 39}, {50: 18, 60: 21}),  # one added
    ],
)
def test_kinds_and_limits_are_as_tagged(
    data: Path, name: str, kinds: dict[str, int], limits_kmh: dict[int, int]
) -> None:
    """Numbers counted in the files' tags with grep."""
    road = read_road(data / name)
    found = [lane.kind for lane in road.lanes.values()]
    assert {kind: found.count(kind) for kind in found} == kinds
    limits = [round(lane.speed_limit_mps * 3.6) for lane in road.vehicle_lanes.values()]
    assert {limit: limits.count(limit) for limit in limits} == limits_kmh


def test_the_roundabouts_entries_yield(data: Path) -> None:
    road = read_road(data / "interaction/maps/DR_DEU_Roundabout_OF.osm")
    found = {r.element_id: (r.kind, r.yielding, r.priority, r.signs) for r in road.regulations}
    assert found == {
        50001: ("right_of_way", (30015,), (30017,), ("de205",)),
        50002: ("right_of_way", (30000,), (30023,), ("de205",)),
        50003: ("right_of_way", (30046,), (30004,), ("de205",)),
    }
    assert all(len(r.stop_lines) == 1 for r in road.regulations)
    assert [area.kind for area in road.areas] == ["keepout"] * 4
