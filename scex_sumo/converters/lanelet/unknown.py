"""Lanelets of unknown subtype or location: which of them are roads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from scex_sumo.converters.lanelet.file import MapFile, Relation
from scex_sumo.converters.lanelet.lanes import MIN_ROAD_M, Rules, Vertex
from scex_sumo.converters.lanelet.tags import lane_kind
from scex_sumo.geometry.polylines import mean_width_m

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

    A road is as wide as a car needs and connected to a known road, directly or over others.

    Returns:
        Lanelet ids of the roads, and of the others, each by the unknown tag in words; and the map ``kept``
        with the roads tagged as such, in towns if their location is unknown.
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
    linked = _linked([v for v in vertices if v.lanelet_id in driven | wide]) if wide else {}
    connected = {i for i in wide if linked.get(i)}
    roads = _reached(driven, linked) & wide if driven else connected
    words: set[str] = set()
    while fresh := {unknown[i] for i in roads} - words:
        words |= fresh
        roads |= _reached({i for i in connected if unknown[i] in fresh}, linked) & wide
    return _by_word(unknown, roads), _by_word(unknown, set(unknown) - roads), _as_roads(kept, roads)


def _as_roads(map_file: MapFile, lanelets: Iterable[int]) -> MapFile:
    relations = dict(map_file.relations)
    for i in lanelets:
        tags = {**relations[i].tags, "subtype": "road"}
        if tags.get("location", "") not in _LOCATIONS:
            tags["location"] = "urban"
        relations[i] = replace(relations[i], tags=tags)
    return replace(map_file, relations=relations)


def _unknown_tag(lanelet: Relation) -> str:
    subtype, location = lanelet.tags.get("subtype", ""), lanelet.tags.get("location", "")
    if lane_kind(lanelet.tags, vehicle=False) != "other" or subtype.lower() in _TRACKS:
        return ""
    if any(key.startswith("participant:") for key in lanelet.tags):
        return ""  # the map says itself who may use it
    if subtype not in _KNOWN_SUBTYPES:
        return f"subtype {subtype}" if subtype else "no subtype"
    return f"location {location}" if location not in _LOCATIONS else ""


def _linked(vertices: list[Vertex]) -> dict[int, set[int]]:
    starts = np.array([[*v.left[0], *v.right[0]] for v in vertices])
    ends = np.array([[*v.left[-1], *v.right[-1]] for v in vertices])
    linked: dict[int, set[int]] = {v.lanelet_id: set() for v in vertices}
    for k, end in enumerate(ends):
        for j in np.flatnonzero(np.abs(starts - end).max(axis=1) < SAME_END_M):
            linked[vertices[k].lanelet_id].add(vertices[j].lanelet_id)
            linked[vertices[j].lanelet_id].add(vertices[k].lanelet_id)
    return {i: others - {i} for i, others in linked.items()}


def _reached(sources: Iterable[int], linked: Mapping[int, set[int]]) -> set[int]:
    reached = set(sources)
    stack = list(reached)
    while stack:
        fresh = linked.get(stack.pop(), set()) - reached
        reached |= fresh
        stack += fresh
    return reached


def _by_word(unknown: Mapping[int, str], ids: Iterable[int]) -> dict[str, set[int]]:
    words: dict[str, set[int]] = {}
    for i in sorted(ids):
        words.setdefault(unknown[i], set()).add(i)
    return words
