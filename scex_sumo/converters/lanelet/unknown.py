"""Lanelets that a map lacks or does not understand: gaps between two others, and unknown subtypes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.lanelet.file import MapFile, Member, Relation, free_ids
from scex_sumo.converters.lanelet.lanes import MIN_ROAD_M, Rules, Vertex
from scex_sumo.converters.lanelet.tags import lane_kind
from scex_sumo.geometry.polylines import mean_width_m

MAX_LANE_M = 4.5
MAX_ROAD_M = 8.0  # of a lane for cars: wider ones are places
SAME_END_M = 0.1  # ends of bounds that coincide; one lanelet then leads into the other
_LOCATIONS = ("", "urban", "nonurban")
# Lanelet2's own.
_KNOWN_SUBTYPES = {
    *("road", "highway", "play_street", "emergency_lane", "exit", "parking", "freespace", "vegetation"),
    *("keepout", "building", "traffic_island"),
}
_TRACKS = {"tram", "rail", "railway", "train", "subway", "light_rail"}


def unknown_subtypes(
    vertices: list[Vertex], rules: Rules, map_file: MapFile, kept: MapFile
) -> tuple[dict[str, set[int]], dict[str, set[int]], MapFile]:
    """Find the lanelets of unknown subtype or location: those that are roads, and the others.

    A road is as wide as a car needs and connected to another road.

    Returns ids of the roads, and of the others, each by the unknown tag in words; and the map ``kept`` with
    the roads tagged as such, in towns if their location is unknown.
    """
    driven = {v.lanelet_id for v in vertices if rules.canPass(v.lanelet)}
    unknown = {
        v.lanelet_id: word
        for v in vertices
        if v.lanelet_id not in driven and (word := _unknown_tag(map_file.relations[v.lanelet_id]))
    }
    wide = {
        v.lanelet_id
        for v in vertices
        if v.lanelet_id in unknown and MIN_ROAD_M <= mean_width_m(v.left, v.right) <= MAX_ROAD_M
    }
    roads = wide & _linked([v for v in vertices if v.lanelet_id in driven | wide]) if wide else wide
    relations = dict(kept.relations)
    for i in roads:
        tags = {**relations[i].tags, "subtype": "road"}
        if tags.get("location", "") not in _LOCATIONS:
            tags["location"] = "urban"
        relations[i] = replace(relations[i], tags=tags)
    by_word: tuple[dict[str, set[int]], dict[str, set[int]]] = ({}, {})
    for i in sorted(unknown):
        by_word[i not in roads].setdefault(unknown[i], set()).add(i)
    return *by_word, replace(kept, relations=relations)


def _unknown_tag(lanelet: Relation) -> str:
    subtype, location = lanelet.tags.get("subtype", ""), lanelet.tags.get("location", "")
    if lane_kind(lanelet.tags, vehicle=False) != "other" or subtype.lower() in _TRACKS:
        return ""
    if any(key.startswith("participant:") for key in lanelet.tags):
        return ""  # the map says itself who may use it
    if subtype not in _KNOWN_SUBTYPES:
        return f"subtype {subtype}" if subtype else "no subtype"
    return f"location {location}" if location not in _LOCATIONS else ""


def _linked(vertices: list[Vertex]) -> set[int]:
    """Return the lanelets of which another one begins at the end, or ends at the beginning."""
    starts = np.array([[*v.left[0], *v.right[0]] for v in vertices])
    linked: set[int] = set()
    for v in vertices:
        end = (*v.left[-1], *v.right[-1])
        behind = {
            vertices[j].lanelet_id for j in np.flatnonzero(np.abs(starts - end).max(axis=1) < SAME_END_M)
        }
        if behind := behind - {v.lanelet_id}:
            linked |= {v.lanelet_id, *behind}
    return linked


def missing_lanelets(vertices: Sequence[Vertex], rules: Rules, map_file: MapFile) -> dict[int, Relation]:
    """Return the lanelets to add, by new id.

    One is missing where a lanelet begins at the right end of one lanelet and the left end of another, nothing
    leads into it, and the facing bounds have no lanelet between them and the distance of those of a lane.
    """
    drives = [v for v in vertices if rules.canPass(v.lanelet) and v.lane_id == v.lanelet_id]
    ends = {(tuple(v.left[-1]), tuple(v.right[-1])) for v in drives}
    on_left, on_right = ({tuple(getattr(v, side)[-1]): v for v in drives} for side in ("right", "left"))
    refs = {
        side: {r for i in map_file.of_type("lanelet").values() for r in i.refs(side, "way")}
        for side in ("left", "right")
    }
    added: dict[int, Relation] = {}
    ids = free_ids((*map_file.relations, *map_file.ways, *map_file.nodes))
    for lane in drives:
        begin = tuple(lane.left[0]), tuple(lane.right[0])
        one, other = on_left.get(begin[0]), on_right.get(begin[1])
        if begin in ends or one is None or other is None or one is other:
            continue
        before = map_file.relations[one.lanelet_id]
        left = before.refs("right", "way")[0]
        right = map_file.relations[other.lanelet_id].refs("left", "way")[0]
        if left in refs["left"] or right in refs["right"] or not _is_wide(one.right, other.left):
            continue
        sides = ((left, "left"), (right, "right"))
        bounds = tuple(Member(kind="way", ref=ref, role=side) for ref, side in sides)
        added[next(ids)] = Relation(members=bounds, tags=before.tags)
    return added


def _is_wide(left: FloatArray, right: FloatArray) -> bool:
    """Return whether two bounds are as far apart as those of a lane, all the way."""
    apart = np.hypot(*(left[:, None] - right).transpose(2, 0, 1))
    ends = (apart[0, 0], apart[-1, -1])
    return bool(min(ends) >= MIN_ROAD_M and max(ends) <= MAX_LANE_M)
