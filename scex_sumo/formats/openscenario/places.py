"""Positions of OpenSCENARIO on an OpenDRIVE road, and the ways ahead of them along lanes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, polyline
from scex_sumo.formats.opendrive.lanes import OpenDriveMap
from scex_sumo.formats.opendrive.reference import number
from scex_sumo.formats.opendrive.roads import Name
from scex_sumo.geometry.polylines import along, arc_lengths, bend, length_of, project, turn

AHEAD_M = 3000.0  # of a way
BESIDE_M = 3.5  # from the middle of a lane: farther, a place is on none


class UnknownMotion(ValueError):
    """What a scenario leaves to players, or what is not read: its motion is known until then."""


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Place and heading of a reference point, m and rad; ``lane`` if the scenario names one."""

    x: float
    y: float
    heading: float
    lane: Name | None = None

    def moved(self, ahead: float, left: float) -> Pose:
        """Return the pose moved in its own frame."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return replace(self, x=self.x + c * ahead - s * left, y=self.y + s * ahead + c * left, lane=None)

    def seen(self, other: Pose) -> tuple[float, float]:
        """Return how far another place is ahead and to the left, m."""
        c, s, dx, dy = math.cos(self.heading), math.sin(self.heading), other.x - self.x, other.y - self.y
        return c * dx + s * dy, c * dy - s * dx

    @property
    def back(self) -> Pose:
        """The pose turned round."""
        return replace(self, heading=self.heading + math.pi)


@dataclass(kw_only=True, eq=False)
class Way:
    """Line along which something drives: lanes in a row, a trajectory, or straight on.

    Attributes:
        points: (n, 2) m; ``headings`` (n,) rad there, None: those of the segments.
        lanes: their names, from the ``starts`` (L,) m on; ``against`` their direction or not.
        times_s: (n,) at which a trajectory passes its points; ``speeds`` (n,) m/s there, if known.
    """

    points: FloatArray
    headings: FloatArray | None = None
    lanes: Sequence[Name] = ()
    starts: FloatArray | None = None
    against: bool = False
    times_s: FloatArray | None = None
    speeds: FloatArray | None = None

    def __post_init__(self) -> None:
        self.arcs = arc_lengths(self.points)

    def at(self, arc: float, left: float = 0.0) -> Pose:
        """Return the pose to the left of an arc length."""
        x, y = (float(np.interp(arc, self.arcs, values)) for values in self.points.T)
        if self.headings is not None:
            return Pose(x=x, y=y, heading=float(np.interp(arc, self.arcs, self.headings))).moved(0.0, left)
        k = int(np.clip(np.searchsorted(self.arcs, arc, side="right") - 1, 0, len(self.arcs) - 2))
        dx, dy = self.points[k + 1] - self.points[k]
        return Pose(x=x, y=y, heading=math.atan2(dy, dx)).moved(0.0, left)

    def project(self, pose: Pose) -> tuple[float, float]:
        """Return the arc length of a place and how far it is to the left, m."""
        arc = float(project(np.array([[pose.x, pose.y]]), self.points)[0][0])
        return arc, self.at(arc).seen(pose)[1]

    def lane_at(self, arc: float) -> Name:
        """Return the lane at an arc length; raises `UnknownMotion` if it is on none."""
        if self.starts is None:
            raise UnknownMotion("a road user on no lane changes lanes")
        return self.lanes[max(int(np.searchsorted(self.starts, arc, side="right")) - 1, 0)]


class Places:
    """Lanes of an OpenDRIVE map by name."""

    def __init__(self, drawn: OpenDriveMap) -> None:
        self._roads = drawn.roads
        self._lanes: dict[Any, DrawnLane] = {lane.name: lane for lane in drawn.lanes}
        lines = {name: polyline(lane.centre) for name, lane in self._lanes.items()}
        self._lines: dict[Name, FloatArray] = {name: line for name, line in lines.items() if len(line) > 1}

    def direction(self, lane: Name) -> int:
        """Return 1 if a lane is driven along its road's reference line, else -1."""
        return 1 if self._roads[lane[0]].forward(*lane[1:]) else -1

    def beside(self, lane: Name, count: int) -> Name:
        """Return the lane so many lanes beyond another one, in the order of their numbers."""
        first = lane[2] + count
        crosses = lane[2] * first <= 0
        return self.known((*lane[:2], first + int(math.copysign(crosses, count))))

    def known(self, lane: Name) -> Name:
        """Return a lane; raises `ValueError` if it is not there."""
        if lane not in self._lines:
            raise ValueError(f"road {lane[0]} has no lane {lane[2]} there")
        return lane

    def at_station(self, road: str, s: float, t: float, lane: int | None = None) -> Pose:
        """Return the pose beside the middle of a lane, or the reference line, and headed along this line."""
        if road not in self._roads:
            raise ValueError(f"its map has no road {road}")
        whole, name = self._roads[road], None
        if lane is not None:
            name = self.known((road, whole.piece_at(s), lane))
            part = whole.pieces[name[1]]
            t += float(np.interp(s, part.s, part.borders[lane].mean(axis=0)))
        rows = (*whole.line.places.T, np.unwrap(whole.line.headings))
        x, y, turned = (float(np.interp(s, whole.line.s, row)) for row in rows)
        return replace(Pose(x=x, y=y, heading=turned).moved(0.0, t), lane=name)

    def _turned(self, lane: Name, pose: Pose) -> tuple[float, float, float]:
        """Return the arc length of a place along a lane, its distance, and the turn of its heading."""
        line = self._lines[lane]
        arc, gap = (float(value[0]) for value in project(np.array([[pose.x, pose.y]]), line))
        (x0, y0), (x1, y1) = along(line, max(arc - 0.5, 0.0)), along(line, arc + 0.5)
        return arc, gap, abs(turn(math.atan2(y1 - y0, x1 - x0), pose.heading))

    def lane_of(self, pose: Pose) -> Name | None:
        """Return the lane on which a pose is: the nearest, driven along before against; None beside all."""
        if pose.lane is not None or not math.isfinite(pose.x + pose.y):
            return pose.lane
        near = ((name, *self._turned(name, pose)[1:]) for name in self._lines)
        costs = [
            (gap + 2 * min(turned, math.pi - turned + 0.5), n) for n, gap, turned in near if gap < BESIDE_M
        ]
        return min(costs)[1] if costs else None

    def roads_of(self, goals: Sequence[Pose]) -> list[str]:
        """Return the roads on which the places of a route are."""
        return [lane[0] for goal in goals if (lane := self.lane_of(goal)) is not None]

    def way(self, pose: Pose, roads: Sequence[str] = ()) -> Way:
        """Return the way ahead of a pose, over some roads or straight on; beside all lanes a line."""
        lane = self.lane_of(pose)
        if lane is None:
            ahead = pose.moved(AHEAD_M, 0.0)
            return Way(points=np.array([[pose.x, pose.y], [ahead.x, ahead.y]]))
        arc, _, turned = self._turned(lane, pose)
        against, lanes, length, roads = turned > math.pi / 2, [lane], -arc, [*roads]
        while (length := length + length_of(self._lines[lanes[-1]])) < AHEAD_M:
            roads = roads[roads.index(lanes[-1][0]) + 1 :] if lanes[-1][0] in roads else roads
            beyond = self._beyond(lanes[-1], against)
            if not beyond:
                break
            costs = [
                (self._lanes_to(name, roads, against), abs(bend(self._lines[name])), name) for name in beyond
            ]
            lanes.append(min(costs)[2])
        lines = [self._lines[name][:: -1 if against else 1] for name in lanes]
        starts = np.cumsum([0.0, *map(length_of, lines[:-1])])
        points = np.concatenate([lines[0], *(line[1:] for line in lines[1:])])
        return Way(points=points, lanes=lanes, starts=starts, against=against)

    def _beyond(self, name: Name, against: bool) -> list[Name]:
        lane = self._lanes[name]
        near: Sequence[Any] = (lane.predecessors if against else lane.successors) or ()
        return [name for name in near if name in self._lines]

    def _lanes_to(self, lane: Name, roads: Sequence[str], against: bool) -> float:
        """Return how many lanes lead from one to the first of some roads; infinite if none do."""
        layer, seen, count = [lane], {lane}, 0.0
        while roads and layer:
            if any(name[0] == roads[0] for name in layer):
                return count
            layer = list({n for name in layer for n in self._beyond(name, against)} - seen)
            seen, count = seen.union(layer), count + 1
        return math.inf


def placed(position: Element, places: Places, pose_of: Callable[[str], Pose]) -> Pose:
    """Return the pose of a position of OpenSCENARIO; a lane's is headed as it is driven.

    Args:
        pose_of: returns the pose of an entity now.

    Raises:
        UnknownMotion: it is of a kind that is not read.
        ValueError: the map has no such place.
    """
    kind, turned = position.tag, position.find("Orientation")
    along_road = None
    if kind == "WorldPosition":
        return Pose(x=number(position, "x"), y=number(position, "y"), heading=number(position, "h", "0"))
    if kind in ("LanePosition", "RoadPosition"):
        lane = int(number(position, "laneId")) if kind == "LanePosition" else None
        beside = number(position, "t" if lane is None else "offset", "0")
        along_road = places.at_station(position.get("roadId", ""), number(position, "s"), beside, lane)
        against = along_road.lane is not None and places.direction(along_road.lane) < 0
        there = along_road.back if against else along_road
    elif kind == "RelativeObjectPosition":
        own = pose_of(position.get("entityRef", ""))
        there = own.moved(number(position, "dx"), number(position, "dy"))
    elif kind == "RelativeLanePosition":
        there = _beside(position, places, pose_of(position.get("entityRef", "")))
    elif kind == "RoutePosition" and position.find(".//Waypoint/Position/*") is not None:
        goals = [placed(one, places, pose_of) for one in position.iterfind(".//Waypoint/Position/*")]
        way = places.way(goals[0], places.roads_of(goals))
        coordinates = next((one for one in position.iter() if one.get("pathS")), position)
        there = way.at(way.project(goals[0])[0] + number(coordinates, "pathS"))
    else:
        raise UnknownMotion(f"{kind} is not read")
    if turned is None:
        return there
    from_heading = (along_road or there).heading if turned.get("type") == "relative" else 0.0
    return replace(there, heading=number(turned, "h", "0") + from_heading)


def _beside(position: Element, places: Places, own: Pose) -> Pose:
    lane = places.lane_of(own)
    if lane is None:
        raise ValueError(f"{position.get('entityRef')} is on no lane")
    goal = places.beside(lane, int(number(position, "dLane")))
    ds = number(position, "ds", position.get("dsLane", "0"))
    backwards = places.direction(lane) * ds < 0
    way = places.way(replace(own.back if backwards else own, lane=goal))
    arc = way.project(own)[0] + abs(ds)
    left = number(position, "offset", "0") * places.direction(lane) * (-1 if backwards else 1)
    there = replace(way.at(arc, left), lane=way.lane_at(arc))
    return there.back if backwards else there
