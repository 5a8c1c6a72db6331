"""Footways: the crosswalks and walkways of a map as a graph of places where they meet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.net.pieces.rows import Zone
from scex_sumo.geometry.polylines import along, cut, length_of, nearest
from scex_sumo.road import Lane

MEET_M = 0.5  # between the ends of two footways, or from the end of one to the side of another
END_M = 2.0  # who comes in this close to a footway's end comes in there
SHORTEST_M = 0.5  # of a footway, and of what a vehicle lane has in common with a crosswalk

_Station = tuple[int, float]  # lanelet, arc length on it in m


@dataclass(frozen=True, kw_only=True, eq=False)
class Footway:
    """A crosswalk, or a stretch of a walkway, between two places.

    Attributes:
        name: ``w`` and the lanelet, with a number where there are several.
        lanelet: that it lies on, or None where it was added.
        shape: (P, 2) m.
        width: m.
        places: where it begins and ends.
        crossed: for a crosswalk the vehicle lanes under it with the arc lengths between which they are, m.
    """

    name: str
    lanelet: int | None
    shape: FloatArray
    width: float
    places: tuple[int, int]
    crossed: tuple[tuple[int, tuple[float, float]], ...] = ()


@dataclass(kw_only=True, eq=False)
class _Meetings:
    """Stations at which lanelets meet, united to places."""

    parent: dict[_Station, _Station] = field(default_factory=dict)

    def root(self, station: _Station) -> _Station:
        while (above := self.parent.setdefault(station, station)) != station:
            station = above
        return station

    def unite(self, one: _Station, other: _Station) -> None:
        first, second = sorted((self.root(one), self.root(other)))
        self.parent[second] = first


def footways(lanes: Mapping[int, Lane], driven: Mapping[int, Lane]) -> list[Footway]:
    """Crosswalks and walkways, cut where others come in from the side.

    Args:
        lanes: all of the map.
        driven: those for vehicles, as the net has them.
    """
    walked = {i: x for i, x in lanes.items() if x.kind == "pedestrian" and _long(x)}
    crossed = {i: tuple(_crossed(x, driven)) for i, x in walked.items() if x.subtype == "crosswalk"}
    meetings = _Meetings()
    for i, lane in walked.items():
        for s in (0.0, length_of(lane.centreline)):
            meetings.root((i, s))
            for j, other in walked.items():
                if i != j and (at := _meets(lane, s, other, whole=bool(crossed.get(j)))) is not None:
                    meetings.unite((i, s), (j, at))
    places = {root: k for k, root in enumerate(sorted({meetings.root(s) for s in list(meetings.parent)}))}
    found = []
    for i, lane in walked.items():
        stations = sorted(s for j, s in meetings.parent if j == i)
        for k, (start, end) in enumerate(pairwise(stations)):
            name = f"w{i}" if len(stations) == 2 else f"w{i}#{k}"
            ends = (places[meetings.root((i, start))], places[meetings.root((i, end))])
            shape = cut(lane.centreline, start, end)
            found.append(
                Footway(
                    name=name,
                    lanelet=i,
                    shape=shape,
                    width=lane.width_m,
                    places=ends,
                    crossed=crossed.get(i, ()),
                )
            )
    return [f for f in found if f.places[0] != f.places[1]]


def crossed_zones(ways: list[Footway]) -> list[Zone]:
    """What lies under crosswalks that meet, in one junction each."""
    groups: list[tuple[set[int], list[Footway]]] = []
    for way in ways:
        if way.crossed:
            joined = [group for group in groups if group[0] & set(way.places)]
            groups = [group for group in groups if group not in joined]
            places = {*way.places}.union(*(places for places, _ in joined))
            groups.append((places, [*(other for _, others in joined for other in others), way]))
    spans = [[lane for way in members for lane in way.crossed] for _, members in groups]
    return [Zone(lanes=tuple(i for i, _ in group), spans=tuple(s for _, s in group)) for group in spans]


def _long(lane: Lane) -> bool:
    return length_of(lane.centreline) >= SHORTEST_M


def _meets(lane: Lane, s: float, other: Lane, *, whole: bool) -> float | None:
    """Where on another footway a footway's beginning or end comes in, m, or None where it does not.

    Args:
        lane: the footway.
        s: 0, or its length.
        other: the other one.
        whole: whether the other can be entered at its ends alone.
    """
    at = -1 if s else 0
    length = length_of(other.centreline)
    side = shapely.LineString([lane.left_bound[at], lane.right_bound[at]])
    for there, station in ((0, 0.0), (-1, length)):
        if side.distance(shapely.LineString([other.left_bound[there], other.right_bound[there]])) < MEET_M:
            return station
    tip = lane.centreline[at]
    if _area(other).distance(shapely.Point(tip)) > MEET_M:
        return None
    station = float(nearest(other.centreline, *tip))
    if station < END_M or station > length - END_M:
        return 0.0 if station < length / 2 else length
    return None if whole else round(station)  # those who come in close together come in at one place


def _crossed(crosswalk: Lane, driven: Mapping[int, Lane]) -> Iterator[tuple[int, tuple[float, float]]]:
    """Vehicle lanes under a crosswalk, with the stretches of them that it covers."""
    area = _area(crosswalk)
    for i, lane in driven.items():
        line = shapely.LineString(lane.centreline)
        if not area.intersects(line):
            continue
        for part in shapely.get_parts(area.intersection(line)):
            if part.length >= SHORTEST_M:
                ends = sorted(float(line.project(shapely.Point(part.coords[k]))) for k in (0, -1))
                yield i, (ends[0], ends[1])


def _area(lane: Lane) -> shapely.Polygon:
    return shapely.Polygon(np.vstack([lane.left_bound, lane.right_bound[::-1]])).buffer(0.0)


def corners(shape: FloatArray, width: float, *, end: bool) -> FloatArray:
    """(2, 2) left and right corner of a footway's end, m."""
    length = length_of(shape)
    a, b = along(shape, np.array([length - min(0.5, length), length] if end else [0.0, min(0.5, length)]))
    across = np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.hypot(*(b - a))), 1e-9) * width / 2
    tip = shape[-1 if end else 0]
    return np.array([tip + across, tip - across])
