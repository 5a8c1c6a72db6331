"""Positions of OpenSCENARIO on an OpenDRIVE road, and the ways ahead of them along lanes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, polyline
from scex_sumo.formats.opendrive.lanes import OpenDriveMap
from scex_sumo.formats.opendrive.reference import number
from scex_sumo.formats.opendrive.roads import Name
from scex_sumo.geometry.polylines import along, arc_lengths, heading, project, turn

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
        return Pose(x=self.x + c * ahead - s * left, y=self.y + s * ahead + c * left, heading=self.heading)

    def seen(self, other: Pose) -> tuple[float, float]:
        """Return how far another place is ahead and to the left, m."""
        c, s, dx, dy = math.cos(self.heading), math.sin(self.heading), other.x - self.x, other.y - self.y
        return c * dx + s * dy, c * dy - s * dx

    @property
    def back(self) -> Pose:
        """The pose turned round."""
        return replace(self, heading=self.heading + math.pi)


NOWHERE: Final = Pose(x=math.nan, y=math.nan, heading=0.0)


class Way:
    """Middle of the lanes ahead from where the first one begins; ``against`` their direction or not."""

    def __init__(self, lanes: Sequence[Name], lines: Sequence[FloatArray], *, against: bool) -> None:
        self.against, self._lanes = against, lanes
        self._line = np.concatenate([lines[0], *(line[1:] for line in lines[1:])])
        self._arc = arc_lengths(self._line)
        self._starts = self._arc[np.cumsum([0, *(len(line) - 1 for line in lines[:-1])])]
        self.length = float(self._arc[-1])

    def at(self, arc: float, left: float) -> Pose:
        """Return the pose to the left of an arc length."""
        k = int(np.clip(np.searchsorted(self._arc, arc, side="right") - 1, 0, len(self._arc) - 2))
        (x0, y0), (x1, y1), (x, y) = *self._line[k : k + 2], along(self._line, arc)
        return Pose(x=float(x), y=float(y), heading=math.atan2(y1 - y0, x1 - x0)).moved(0.0, left)

    def project(self, pose: Pose) -> tuple[float, float]:
        """Return the arc length of a place and how far it is to the left, m."""
        arc = float(project(np.array([[pose.x, pose.y]]), self._line)[0][0])
        return arc, self.at(arc, 0.0).seen(pose)[1]

    def lane_at(self, arc: float) -> Name:
        """Return the lane at an arc length."""
        return self._lanes[max(int(np.searchsorted(self._starts, arc, side="right")) - 1, 0)]


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
        """Return the pose beside the middle of a lane, headed as it is driven, or the reference line."""
        if road not in self._roads:
            raise ValueError(f"its map has no road {road}")
        whole, name = self._roads[road], None
        if lane is not None:
            name = self.known((road, whole.piece_at(s), lane))
            part = whole.pieces[name[1]]
            t += float(np.interp(s, part.s, part.borders[lane].mean(axis=0)))
        x, y = (float(np.interp(s, whole.line.s, whole.line.places[:, axis])) for axis in (0, 1))
        turned = float(np.interp(s, whole.line.s, np.unwrap(whole.line.headings)))
        there = replace(Pose(x=x, y=y, heading=turned).moved(0.0, t), lane=name)
        return there.back if name is not None and self.direction(name) < 0 else there

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
        near = []
        for name in self._lines:
            _, gap, turned = self._turned(name, pose)
            if gap < BESIDE_M:
                near.append((gap + 2 * min(turned, math.pi - turned + 0.5), name))
        return min(near)[1] if near else None

    def way(self, pose: Pose, roads: Sequence[str] = ()) -> Way | None:
        """Return the way ahead of a pose, over some roads or straight on; None beside all lanes."""
        lane = self.lane_of(pose)
        if lane is None:
            return None
        arc, _, turned = self._turned(lane, pose)
        against, lanes, length, roads = turned > math.pi / 2, [lane], -arc, [*roads]
        while length < AHEAD_M:
            roads = roads[roads.index(lanes[-1][0]) + 1 :] if lanes[-1][0] in roads else roads
            length += float(arc_lengths(self._lines[lanes[-1]])[-1])
            beyond = self._beyond(lanes[-1], against)
            if not beyond:
                break
            wanted = self._towards(beyond, roads[0], against) if roads else None
            lanes.append(min(beyond, key=self._bend) if wanted is None else wanted)
        lines = [self._lines[name][::-1] if against else self._lines[name] for name in lanes]
        return Way(lanes, lines, against=against)

    def _beyond(self, name: Name, against: bool) -> list[Name]:
        lane = self._lanes[name]
        near: Sequence[Any] = (lane.predecessors if against else lane.successors) or ()
        return [name for name in near if name in self._lines]

    def _bend(self, name: Name) -> float:
        line = self._lines[name]
        return abs(turn(heading(line, end=False), heading(line, end=True)))

    def _towards(self, beyond: Sequence[Name], road: str, against: bool) -> Name | None:
        """Return the lane of some from which the fewest lanes lead to a road; None if none does."""
        layer, seen = {name: name for name in beyond}, set(beyond)
        while layer:
            if there := [first for name, first in layer.items() if name[0] == road]:
                return there[0]
            onward = {n: first for name, first in layer.items() for n in self._beyond(name, against)}
            layer = {name: first for name, first in onward.items() if name not in seen}
            seen.update(layer)
        return None


def placed(position: Element, places: Places, pose_of: Callable[[str], Pose]) -> Pose:
    """Return the pose of a position of OpenSCENARIO; a lane's is headed as it is driven.

    Args:
        pose_of: returns the pose of an entity now.

    Raises:
        UnknownMotion: it is of a kind that is not read.
        ValueError: the map has no such place.
    """
    kind, turned = position.tag, position.find("Orientation")
    h = 0.0 if turned is None else number(turned, "h", "0")
    relative = turned is not None and turned.get("type") == "relative"
    if kind == "WorldPosition":
        return Pose(x=number(position, "x"), y=number(position, "y"), heading=number(position, "h", "0"))
    if kind in ("LanePosition", "RoadPosition"):
        of_lane = kind == "LanePosition"
        lane, t = (int(number(position, "laneId")), "offset") if of_lane else (None, "t")
        pose = places.at_station(
            position.get("roadId", ""), number(position, "s"), number(position, t, "0"), lane
        )
        if turned is None:
            return pose
        along_road = pose.back if pose.lane is not None and places.direction(pose.lane) < 0 else pose
        return replace(pose, heading=h + (along_road.heading if relative else 0.0))
    if kind == "RelativeObjectPosition":
        own = pose_of(position.get("entityRef", ""))
        there = own.moved(number(position, "dx"), number(position, "dy"))
    elif kind == "RelativeLanePosition":
        there = _beside(position, places, pose_of(position.get("entityRef", "")))
    else:
        raise UnknownMotion(f"{kind} is not read")
    return there if turned is None else replace(there, heading=h + (there.heading if relative else 0.0))


def _beside(position: Element, places: Places, own: Pose) -> Pose:
    lane = places.lane_of(own)
    if lane is None:
        raise ValueError(f"{position.get('entityRef')} is on no lane")
    goal, ds = (
        places.beside(lane, int(number(position, "dLane"))),
        number(position, "ds", position.get("dsLane", "0")),
    )
    backwards = places.direction(lane) * ds < 0
    along_road = -1 if backwards else 1
    way = places.way(replace(own.back if backwards else own, lane=goal))
    assert way is not None
    arc = way.project(own)[0] + abs(ds)
    left = number(position, "offset", "0") * places.direction(lane) * along_road
    there = replace(way.at(arc, left), lane=way.lane_at(arc))
    return there.back if backwards else there
