"""Places in a word: on the examples, where one can look."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.sumo.programs import program
from scex_sumo.geometry.polylines import along, length_of
from scex_sumo.roads.conflicts import conflicts
from scex_sumo.roads.places import PLACES, places_of


def middle(line: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(along(line, length_of(line) / 2))


def _leads_to(road: scex_sumo.Road, start: int, end: int) -> bool:
    reached, rest = set(), [*road.lanes[start].successors]
    while rest:
        lane = rest.pop()
        if lane not in reached:
            reached.add(lane)
            rest += road.lanes[lane].successors
    return end in reached


def test_a_roundabout_has_a_ring_and_lanes_that_lead_to_it() -> None:
    road = scex_sumo.read_map(scex_sumo.example_path("roundabout"))
    lanes = list(road.vehicle_lanes.values())
    ring = [_leads_to(road, lane.lane_id, lane.lane_id) for lane in lanes]
    points = np.array([middle(lane.centreline) for lane in lanes])
    found = places_of(road, points)
    assert any(ring) and all(found[i] == "ring" for i in np.flatnonzero(ring))
    assert "lane" in found and set(found) <= {*PLACES}
    assert places_of(road, np.array([[1e5, 1e5]])) == [None]


def test_an_intersection_has_crossings_and_a_motorway_a_merge() -> None:
    for name, place in (("urban_intersection", "crossing"), ("motorway_merge", "merge")):
        road = scex_sumo.read_map(scex_sumo.example_path(name))
        points = np.concatenate([lane.centreline for lane in road.vehicle_lanes.values()])
        found = places_of(road, points)
        assert place in found and "ring" not in found


def test_a_corner_of_a_large_net_has_the_places_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    net = tmp_path / "g.net.xml"
    grid = ("--grid", "--grid.number", "7", "--grid.length", "250", "-L", "2", "-j", "priority", "-o", net)
    subprocess.run([program("netgenerate"), *grid], check=True, capture_output=True)
    road = scex_sumo.read_map(net)
    lanes = [lane.centreline for lane in road.vehicle_lanes.values()]
    points = np.array([p for p in map(middle, lanes) if p.max() < 400.0])
    counted: list[int] = []
    monkeypatch.setattr(
        "scex_sumo.roads.places.conflicts", lambda lanes: counted.append(len(lanes)) or conflicts(lanes)
    )
    part = places_of(road, points)
    assert places_of(road, points + 1.0)  # other points of the corner share its conflicts
    assert len(counted) == 1 and 2 * counted[0] < len(road.lanes)
    monkeypatch.setattr("scex_sumo.roads.places._part", lambda road, points: road)
    assert part == places_of(road, points)
    assert {"crossing", "lane"} <= set(part)
