"""Subtypes of lanelets that Lanelet2 does not know: which of them are roads, which are left undriven.

Lanelet2 lets nobody use a lanelet of a subtype, or location, that it does not know, and says nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.converters.lanelet.file import MapFile, Relation
from scex_sumo.converters.lanelet.graph import Rules, Vertex
from scex_sumo.converters.lanelet.tags import lane_kind
from scex_sumo.geometry.polylines import mean_width_m

WIDTH_M = (2.2, 8.0)  # of a lane for cars: narrower ones are for bicycles, wider ones are places
JOINT_M = 0.1  # ends of bounds that coincide; one lanelet then leads into the other

_LOCATIONS = ("", "urban", "nonurban")
# Lanelet2's own; those that cars may use do not come here unless the map forbids it.
_KNOWN = {
    *("road", "highway", "play_street", "emergency_lane", "exit", "parking", "freespace", "vegetation"),
    *("keepout", "building", "traffic_island"),
}
_TRACKS = {"tram", "rail", "railway", "train", "subway", "light_rail"}


@dataclass(frozen=True, kw_only=True)
class UnknownSubtypes:
    """Lanelets of unknown subtype or location.

    Attributes:
        roads: by the tag as written, those that are roads: as wide as a car needs, and connected to roads.
        undriven: by the tag as written, the others.
    """

    roads: Mapping[str, frozenset[int]]
    undriven: Mapping[str, frozenset[int]]


def unknown_subtypes(vertices: Iterable[Vertex], rules: Rules, map_file: MapFile) -> UnknownSubtypes:
    """Find the lanelets that nobody may use for want of a known subtype, and tell roads from the rest.

    A road leads into a road that cars may use, or comes from one, over others of unknown subtype if need be;
    so does the rest of its subtype where connected. In a map without any known road the connected are roads.
    """
    listed = list(vertices)
    tags = {v.lanelet_id: map_file.relations[v.lanelet_id].tags for v in listed}
    driven = {v.lanelet_id for v in listed if rules.canPass(v.lanelet)}
    unknown = {
        i: word for i, t in tags.items() if i not in driven and (word := _unknown(map_file.relations[i]))
    }
    wide = {
        v.lanelet_id
        for v in listed
        if v.lanelet_id in unknown and WIDTH_M[0] <= mean_width_m(v.left, v.right) <= WIDTH_M[1]
    }
    ahead = _connected([v for v in listed if v.lanelet_id in driven | wide]) if wide else {}
    joined = {i for i in wide if ahead.get(i)}
    found = _reached(driven, ahead) & wide if driven else joined
    while more := {i for i in joined - found if unknown[i] in {unknown[j] for j in found}}:
        found |= _reached(more, ahead) & wide
    return UnknownSubtypes(roads=_by_word(unknown, found), undriven=_by_word(unknown, set(unknown) - found))


def as_roads(map_file: MapFile, lanelets: Iterable[int]) -> MapFile:
    """The map with some lanelets tagged as roads; a location that is not known becomes a town."""
    relations = dict(map_file.relations)
    for i in lanelets:
        tags = {**relations[i].tags, "subtype": "road"}
        if tags.get("location", "") not in _LOCATIONS:
            tags["location"] = "urban"
        relations[i] = replace(relations[i], tags=tags)
    return replace(map_file, relations=relations)


def _unknown(lanelet: Relation) -> str:
    """What is not known about a lanelet, as written; empty where nobody may use it for another reason."""
    subtype, location = lanelet.tags.get("subtype", ""), lanelet.tags.get("location", "")
    if lane_kind(lanelet.tags, vehicle=False) != "other" or subtype.lower() in _TRACKS:
        return ""
    if any(key.startswith("participant:") for key in lanelet.tags):
        return ""  # the map says itself who may use it
    if subtype not in _KNOWN:
        return f"subtype {subtype}" if subtype else "no subtype"
    return f"location {location}" if location not in _LOCATIONS else ""


def _connected(vertices: list[Vertex]) -> dict[int, set[int]]:
    """Lanelets that begin where another ends, and the other way round."""
    starts = np.array([[*v.left[0], *v.right[0]] for v in vertices])
    ends = np.array([[*v.left[-1], *v.right[-1]] for v in vertices])
    ahead: dict[int, set[int]] = {v.lanelet_id: set() for v in vertices}
    for k, end in enumerate(ends):
        for j in np.flatnonzero(np.abs(starts - end).max(axis=1) < JOINT_M):
            ahead[vertices[k].lanelet_id].add(vertices[j].lanelet_id)
            ahead[vertices[j].lanelet_id].add(vertices[k].lanelet_id)
    return {i: others - {i} for i, others in ahead.items()}


def _reached(sources: Iterable[int], ahead: Mapping[int, set[int]]) -> set[int]:
    seen = set(sources)
    stack = list(seen)
    while stack:
        fresh = ahead.get(stack.pop(), set()) - seen
        seen |= fresh
        stack += fresh
    return seen


def _by_word(unknown: Mapping[int, str], ids: Iterable[int]) -> dict[str, frozenset[int]]:
    words: dict[str, set[int]] = {}
    for i in sorted(ids):
        words.setdefault(unknown[i], set()).add(i)
    return {word: frozenset(of_word) for word, of_word in words.items()}
