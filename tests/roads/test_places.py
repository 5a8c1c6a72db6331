"""Places in a word: on the examples, where one can look."""

from __future__ import annotations

import numpy as np

import scex_sumo
from scex_sumo.geometry.polylines import along, length_of
from scex_sumo.roads.places import PLACES, places_of
from scex_sumo.roads.relations import ways_round


def middle(line: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(along(line, length_of(line) / 2))


def test_a_roundabout_has_a_ring_and_lanes_that_lead_to_it() -> None:
    road = scex_sumo.read_map(scex_sumo.example_path("roundabout"))
    lanes = list(road.vehicle_lanes.values())
    ring = np.isfinite(ways_round(lanes))
    points = np.array([middle(lane.centreline) for lane in lanes])
    found = places_of(road, points)
    assert ring.any() and all(found[i] == "ring" for i in np.flatnonzero(ring))
    assert "lane" in found and set(found) <= {*PLACES}
    assert places_of(road, np.array([[1e5, 1e5]])) == [None]


def test_an_intersection_has_crossings_and_a_motorway_a_merge() -> None:
    for name, place in (("urban_intersection", "crossing"), ("motorway_merge", "merge")):
        road = scex_sumo.read_map(scex_sumo.example_path(name))
        points = np.concatenate([lane.centreline for lane in road.vehicle_lanes.values()])
        found = places_of(road, points)
        assert place in found and "ring" not in found
