"""Footways of a map: crosswalks and walkways, cut where they meet and where they leave the road."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import cut, heading, length_of, nearest
from scex_sumo.lanelet2sumo.topology.graph import Groups
from scex_sumo.lanelet2sumo.topology.rows import Zone, merged
from scex_sumo.road import Lane

MEET_M = 0.5  # between footways that meet
END_M = 2.0  # another footway this close to an end joins there
KERB_M = 1.0  # between the edge of a lane and where people wait
ISLAND_M = 4.0  # between lanes that are crossed at one go
ALONG = 3.0  # a lane that runs over more than so many widths runs along the walkway
MIN_SINE = 0.4  # 24 degrees: a lane at a smaller angle runs along a crosswalk
OVER_M = 3.0  # how far a crosswalk may end before the middle of a lane that it crosses
TIP_M = 0.5  # of a footway, for its direction
PASS_M = 1.3  # half a car and some room
TWO_ABREAST_M = 1.3  # SUMO's people walk in stripes of 0.64 m
SHORTEST_M = 0.5  # of a footway, and of what a vehicle lane has in common with a crosswalk

_Station = tuple[int, float]  # lanelet, arc length on it in m


@dataclass(frozen=True, kw_only=True, eq=False)
class Footway:
    """Crosswalk (``marked``), or a stretch of a walkway between two places.

    Attributes:
        lanelets: under it; none if the map does not have it.
        crossed: vehicle lanes under it, with (start, end) arc length on them in m.
    """

    name: str
    lanelets: tuple[int, ...]
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


def footways(lanes: Mapping[int, Lane], driven: Mapping[int, Lane]) -> list[Footway]:
    """Cut crosswalks and walkways where others join from the side and where they leave the road."""
    walked = {i: lane for i, lane in lanes.items() if lane.kind == "pedestrian"}
    walked = {i: lane for i, lane in walked.items() if length_of(lane.centreline) >= SHORTEST_M}
    roads = shapely.STRtree([shapely.LineString(x.centreline) for x in driven.values()])
    crossed = {i: list(_crossed(x, driven, roads)) for i, x in walked.items()}
    ids, grounds = list(walked), shapely.STRtree([_ground(x) for x in walked.values()])
    meetings: Groups[_Station] = Groups()
    for i, lane in walked.items():
        for s in (0.0, length_of(lane.centreline), *_kerbs(lane, crossed[i])):
            meetings.name((i, s))
        for s in (0.0, length_of(lane.centreline)):
            for j in (ids[k] for k in grounds.query(_tip(lane, s))):
                if i != j and (station := _meets(lane, s, walked[j])) is not None:
                    meetings.join((i, s), (j, station))
    places = {root: k for k, root in enumerate(sorted({meetings.name(s) for s in list(meetings.above)}))}
    found_footways = []
    for i, lane in walked.items():
        stations = sorted(s for j, s in meetings.above if j == i)
        for k, (start, end) in enumerate(pairwise(stations)):
            ends = (places[meetings.name((i, start))], places[meetings.name((i, end))])
            under = [c for c in crossed[i] if start <= sum(c.walked) / 2 <= end]
            if ends[0] != ends[1]:
                footway = Footway(
                    name=f"w{i}" if len(stations) == 2 else f"w{i}#{k}",
                    lanelets=(i,),
                    shape=cut(lane.centreline, start, end),
                    width=lane.width_m,
                    places=ends,
                    marked=_marked(lane),
                    crossed=tuple((c.lane, c.span) for c in under),
                )
                found_footways.append(footway)
    return found_footways


def crossed_zones(footways: list[Footway]) -> list[Zone]:
    """Return one zone of vehicle lanes for each group of crosswalks that meet."""
    groups: Groups[int] = Groups()
    crosswalks = [footway for footway in footways if footway.crossed]
    for footway in crosswalks:
        groups.join(*footway.places)
    crossed: dict[int, list[tuple[int, tuple[float, float]]]] = {}
    for footway in crosswalks:
        crossed.setdefault(groups.name(footway.places[0]), []).extend(footway.crossed)
    return [Zone(*zip(*on, strict=True)) for on in crossed.values()]


def _ground(lane: Lane) -> shapely.Geometry:
    points = np.vstack([lane.left_bound, lane.right_bound, lane.centreline])
    return shapely.box(*(points.min(axis=0) - MEET_M), *(points.max(axis=0) + MEET_M))


def _tip(lane: Lane, s: float) -> shapely.Geometry:
    end = -1 if s else 0
    return shapely.MultiPoint([lane.left_bound[end], lane.right_bound[end], lane.centreline[end]]).envelope


def _meets(lane: Lane, s: float, other: Lane) -> float | None:
    """Arc length at which a footway's end joins another footway, or None."""
    end = -1 if s else 0
    length = length_of(other.centreline)
    side = shapely.LineString([lane.left_bound[end], lane.right_bound[end]])
    for there, station in ((0, 0.0), (-1, length)):
        if side.distance(shapely.LineString([other.left_bound[there], other.right_bound[there]])) < MEET_M:
            return station
    tip = lane.centreline[end]
    if _area(other).distance(shapely.Point(tip)) > MEET_M:
        return None
    station = float(nearest(other.centreline, *tip))
    if station < END_M or station > length - END_M:
        return 0.0 if station < length / 2 else length
    return None if _marked(other) else round(station)


def _marked(lane: Lane) -> bool:
    return lane.subtype == "crosswalk"


def _crossed(footway: Lane, driven: Mapping[int, Lane], lines: shapely.STRtree) -> Iterator[_Crossed]:
    area, middle = _reach(footway, lines), shapely.LineString(footway.centreline)
    ids = list(driven)
    for k in np.sort(lines.query(area, predicate="intersects")).tolist():
        i, line = ids[k], lines.geometries[k]
        lane = driven[i]
        for piece in shapely.get_parts(area.intersection(line)):
            across = piece.length < ALONG * footway.width_m and piece.intersects(middle)
            if piece.length < SHORTEST_M or not (_marked(footway) or across):
                continue
            ends = sorted(float(line.project(shapely.Point(piece.coords[k]))) for k in (0, -1))
            s, half = float(middle.project(shapely.shortest_line(piece, middle).centroid)), lane.width_m / 2
            yield _Crossed(lane=i, span=(ends[0], ends[1]), walked=(s - half, s + half))


def _reach(footway: Lane, lines: shapely.STRtree) -> shapely.Geometry:
    """Area of a footway; a crosswalk that ends before the middle of a lane is lengthened over that lane."""
    area, middle = _area(footway), shapely.LineString(footway.centreline)
    if not _marked(footway):
        return area
    longer, size = lengthened(footway.centreline), length_of(footway.centreline)
    low, high = 0.0, size
    clipped = [area.intersection(lines.geometries[k]) for k in lines.query(area, predicate="intersects")]
    clipped = [piece for piece in clipped if piece.length >= SHORTEST_M and not piece.intersects(middle)]
    for k in lines.query(longer, predicate="intersects") if clipped else ():
        for met in shapely.points(shapely.get_coordinates(longer.intersection(lines.geometries[k]))):
            near = min(met.distance(piece) for piece in clipped) < OVER_M
            if near and slant(longer, lines.geometries[k], met)[0] > MIN_SINE:
                s = float(longer.project(met)) - OVER_M
                low, high = min(low, s - PASS_M), max(high, s + PASS_M)
    if (low, high) == (0.0, size):
        return area
    over = cut(shapely.get_coordinates(longer), max(low + OVER_M, 0.0), high + OVER_M)
    return area.union(shapely.LineString(over).buffer(footway.width_m / 2, cap_style="flat"))


def _kerbs(footway: Lane, crossed: Sequence[_Crossed]) -> Iterator[float]:
    length = length_of(footway.centreline)
    spans = [c.walked for c in crossed] if not _marked(footway) else []
    for low, high in merged(spans, ISLAND_M):
        yield from (s for s in (low - KERB_M, high + KERB_M) if END_M < s < length - END_M)


def _area(lane: Lane) -> shapely.Polygon:
    return shapely.Polygon(lane.outline).buffer(0.0)


def slant(first: shapely.LineString, second: shapely.LineString, point: shapely.Point) -> tuple[float, float]:
    """Return sine and cosine of the angle at which two lines cross."""
    directions = []
    for line in (first, second):
        s = float(line.project(point))
        a, b = (line.interpolate(max(s + step, 0.0)) for step in (-TIP_M, TIP_M))
        directions.append(math.atan2(b.y - a.y, b.x - a.x))
    angle = directions[1] - directions[0]
    return abs(math.sin(angle)), abs(math.cos(angle))


def lengthened(crosswalk: FloatArray) -> shapely.LineString:
    """Return a crosswalk, 3 m longer at both ends."""
    first, last = (
        OVER_M * np.array([math.cos(angle), math.sin(angle)])
        for angle in (heading(crosswalk, end=False), heading(crosswalk, end=True))
    )
    return shapely.LineString(np.vstack([crosswalk[0] - first, crosswalk, crosswalk[-1] + last]))
