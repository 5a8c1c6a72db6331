"""Footways: the crosswalks and walkways of a map, cut where they meet or leave the road."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.rows import Zone
from scex_sumo.geometry.polylines import along, cut, length_of, nearest
from scex_sumo.road import Lane

MEET_M = 0.5  # between footways that meet
END_M = 2.0  # another footway this close to an end joins there
KERB_M = 1.0  # between the edge of a lane and where people wait
ISLAND_M = 4.0  # between lanes that are crossed at one go
ALONG = 3.0  # a lane that runs over more than so many widths runs along the walkway
PASS_M = 1.3  # half a car and some room
TWO_ABREAST_M = 1.3  # SUMO's people walk in stripes of 0.64 m
OUTWARD_M = 0.7  # how far a crosswalk may be moved off a lane
SHORTEST_M = 0.5  # of a footway, and of what a vehicle lane has in common with a crosswalk

_Station = tuple[int, float]  # lanelet, arc length on it in m


@dataclass(frozen=True, kw_only=True, eq=False)
class Footway:
    """Crosswalk (``marked``), or a stretch of a walkway between two places.

    Attributes:
        lanelet: None if the map does not have it.
        crossed: vehicle lanes under it, with (start, end) arc length on them in m.
    """

    name: str
    lanelet: int | None
    shape: FloatArray
    width: float
    places: tuple[int, int]
    marked: bool = False
    crossed: tuple[tuple[int, tuple[float, float]], ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Crossed:
    lane: int
    span: tuple[float, float]
    walked: tuple[float, float]


@dataclass(kw_only=True, eq=False)
class _Meetings:
    parent: dict[_Station, _Station] = field(default_factory=dict)

    def root(self, station: _Station) -> _Station:
        while (above := self.parent.setdefault(station, station)) != station:
            station = above
        return station

    def unite(self, one: _Station, other: _Station) -> None:
        first, second = sorted((self.root(one), self.root(other)))
        self.parent[second] = first


def footways(lanes: Mapping[int, Lane], driven: Mapping[int, Lane]) -> list[Footway]:
    """Cut crosswalks and walkways where others join from the side and where they leave the road."""
    walked = {i: x for i, x in lanes.items() if x.kind == "pedestrian" and _long(x)}
    roads = shapely.STRtree([shapely.LineString(x.centreline) for x in driven.values()])
    walked = {i: _beside_lanes(x, driven, roads) for i, x in walked.items()}
    crossed = {i: list(_crossed(x, driven, roads)) for i, x in walked.items()}
    ids, grounds = list(walked), shapely.STRtree([_ground(x) for x in walked.values()])
    meetings = _Meetings()
    for i, lane in walked.items():
        for s in (0.0, length_of(lane.centreline), *_kerbs(lane, crossed[i])):
            meetings.root((i, s))
        for s in (0.0, length_of(lane.centreline)):
            for j in (ids[k] for k in grounds.query(_tip(lane, s))):
                if i != j and (at := _meets(lane, s, walked[j], whole=_marked(walked[j]))) is not None:
                    meetings.unite((i, s), (j, at))
    places = {root: k for k, root in enumerate(sorted({meetings.root(s) for s in list(meetings.parent)}))}
    found = []
    for i, lane in walked.items():
        stations = sorted(s for j, s in meetings.parent if j == i)
        for k, (start, end) in enumerate(pairwise(stations)):
            ends = (places[meetings.root((i, start))], places[meetings.root((i, end))])
            under = [c for c in crossed[i] if start <= sum(c.walked) / 2 <= end]
            way = Footway(
                name=f"w{i}" if len(stations) == 2 else f"w{i}#{k}",
                lanelet=i,
                shape=cut(lane.centreline, start, end),
                width=lane.width_m,
                places=ends,
                marked=_marked(lane),
                crossed=tuple((c.lane, c.span) for c in under),
            )
            found += [way] if ends[0] != ends[1] else []
    return found


def crossed_zones(ways: list[Footway]) -> list[Zone]:
    """Return one zone of vehicle lanes for each group of crosswalks that meet."""
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


def _ground(lane: Lane) -> shapely.Geometry:
    points = np.vstack([lane.left_bound, lane.right_bound, lane.centreline])
    return shapely.box(*(points.min(axis=0) - MEET_M), *(points.max(axis=0) + MEET_M))


def _tip(lane: Lane, s: float) -> shapely.Geometry:
    at = -1 if s else 0
    return shapely.MultiPoint([lane.left_bound[at], lane.right_bound[at], lane.centreline[at]]).envelope


def _meets(lane: Lane, s: float, other: Lane, *, whole: bool) -> float | None:
    """Arc length at which a footway's end joins another footway, or None."""
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
    return None if whole else round(station)


def _marked(lane: Lane) -> bool:
    return lane.subtype == "crosswalk"


def _beside_lanes(footway: Lane, driven: Mapping[int, Lane], lines: shapely.STRtree) -> Lane:
    middle, half = shapely.LineString(footway.centreline), footway.width_m / 2
    right, left = -half, half
    if not _marked(footway):
        return footway
    for k in lines.query(_area(footway), predicate="intersects").tolist():
        part = _area(footway).intersection(lines.geometries[k])
        if part.length < SHORTEST_M or part.intersects(middle):
            continue
        at = [float(middle.project(point)) for point in shapely.points(shapely.get_coordinates(part))]
        across = shapely.get_coordinates(part) - along(footway.centreline, np.array(at))
        ahead = along(footway.centreline, np.array(at) + 0.1) - along(footway.centreline, np.array(at) - 0.1)
        offset = (ahead[:, 0] * across[:, 1] - ahead[:, 1] * across[:, 0]) / np.hypot(*ahead.T)
        if offset.mean() > 0:
            left = min(left, float(offset.min()) - PASS_M)
        else:
            right = max(right, float(offset.max()) + PASS_M)
    if (right, left) == (-half, half):
        return footway
    if left < half:
        right = max(min(right, left - TWO_ABREAST_M), -half - OUTWARD_M)
    else:
        left = min(right + TWO_ABREAST_M, half + OUTWARD_M)
    if left - right < TWO_ABREAST_M - 1e-6:
        return footway
    bounds = [shapely.get_coordinates(middle.offset_curve(s)) for s in (left, (left + right) / 2, right)]
    return replace(
        footway, left_bound=bounds[0], centreline=bounds[1], right_bound=bounds[2], width_m=left - right
    )


def _crossed(footway: Lane, driven: Mapping[int, Lane], lines: shapely.STRtree) -> Iterator[_Crossed]:
    area, middle = _area(footway), shapely.LineString(footway.centreline)
    ids = list(driven)
    for k in np.sort(lines.query(area, predicate="intersects")).tolist():
        i, line = ids[k], lines.geometries[k]
        lane = driven[i]
        for part in shapely.get_parts(area.intersection(line)):
            across = part.length < ALONG * footway.width_m and part.intersects(middle)
            if part.length < SHORTEST_M or not (_marked(footway) or across):
                continue
            ends = sorted(float(line.project(shapely.Point(part.coords[k]))) for k in (0, -1))
            s, half = float(middle.project(shapely.shortest_line(part, middle).centroid)), lane.width_m / 2
            yield _Crossed(lane=i, span=(ends[0], ends[1]), walked=(s - half, s + half))


def _kerbs(footway: Lane, crossed: Sequence[_Crossed]) -> Iterator[float]:
    length = length_of(footway.centreline)
    spans = sorted(c.walked for c in crossed) if not _marked(footway) else []
    merged: list[tuple[float, float]] = []
    for low, high in spans:
        if merged and low < merged[-1][1] + ISLAND_M:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    for low, high in merged:
        yield from (s for s in (low - KERB_M, high + KERB_M) if END_M < s < length - END_M)


def _area(lane: Lane) -> shapely.Polygon:
    return shapely.Polygon(np.vstack([lane.left_bound, lane.right_bound[::-1]])).buffer(0.0)


def corners(shape: FloatArray, width: float, *, end: bool) -> FloatArray:
    """(2, 2) left and right corner of a footway's end, m."""
    length = length_of(shape)
    a, b = along(shape, np.array([length - min(0.5, length), length] if end else [0.0, min(0.5, length)]))
    across = np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.hypot(*(b - a))), 1e-9) * width / 2
    tip = shape[-1 if end else 0]
    return np.array([tip + across, tip - across])
