"""Poses on the lanes of an OpenDRIVE map, and the ways ahead of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.lane_maps.lane_map import polyline
from scex_sumo.formats.opendrive.lanes import OpenDriveMap
from scex_sumo.formats.opendrive.roads import Name
from scex_sumo.geometry.bounds import bend
from scex_sumo.geometry.polylines import along, arc_lengths, length_of, project, turn

Driven: TypeAlias = tuple[str, int, int, int]  # road, piece, lane; 1 along its reference line, -1 against it

_AHEAD_M = 3000.0  # of a way
_BESIDE_M = 3.5  # from the middle of a lane: farther, a place is on none
_NEAR_M = 2 * _BESIDE_M  # around a lane: beyond, its distance is not asked for
_AGAINST_M = 1.0  # a lane is driven as it leads, unless another is so much farther


class Pose(NamedTuple):
    """Place and heading of a reference point, m and rad; ``lane`` if the scenario names one."""

    x: float
    y: float
    heading: float
    lane: Name | None = None

    def moved(self, ahead: float, left: float) -> Pose:
        """Return the pose moved in its own frame."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return Pose(self.x + c * ahead - s * left, self.y + s * ahead + c * left, self.heading)

    def seen(self, other: Pose) -> tuple[float, float]:
        """Return how far another place is ahead and to the left, m."""
        c, s, dx, dy = math.cos(self.heading), math.sin(self.heading), other.x - self.x, other.y - self.y
        return c * dx + s * dy, c * dy - s * dx

    def turned(self, angle: float) -> Pose:
        """Return the pose turned to the left, rad."""
        return self._replace(heading=self.heading + angle)


class Way:
    """Line along which something drives: lanes in a row, straight on, or a trajectory.

    Attributes:
        points: (n, 2) m; ``arcs`` (n,) m from the first one; ``headings`` (n,) rad of a trajectory there.
        times_s: (n,) at which a trajectory passes its points, and its ``speeds`` (n,) m/s there.
    """

    def __init__(self, points: FloatArray, headings: FloatArray | None = None) -> None:
        self.points, self.headings, self.arcs = points, headings, arc_lengths(points)
        self.times_s: FloatArray | None = None
        self.speeds: FloatArray = np.empty(0)

    def at(self, arc: float, left: float = 0.0) -> Pose:
        """Return the pose to the left of an arc length."""
        x, y = (float(np.interp(arc, self.arcs, values)) for values in self.points.T)
        if self.headings is not None:
            return Pose(x, y, float(np.interp(arc, self.arcs, self.headings))).moved(0.0, left)
        k = min(max(int(np.searchsorted(self.arcs, arc, side="right")), 1), len(self.arcs) - 1)
        dx, dy = self.points[k] - self.points[k - 1]
        return Pose(x, y, math.atan2(dy, dx)).moved(0.0, left)

    def project(self, pose: Pose) -> tuple[float, float]:
        """Return the arc length of a place and how far it is to the left, m."""
        arc = float(project(np.array([pose[:2]]), self.points)[0][0])
        return arc, self.at(arc).seen(pose)[1]


class Places:
    """Lanes of an OpenDRIVE map, each driven as it leads and against it."""

    def __init__(self, drawn: OpenDriveMap) -> None:
        self._roads = drawn.roads
        self._lines: dict[Driven, FloatArray] = {}
        self._beyond: dict[Driven, list[Driven]] = {}
        for lane in drawn.lanes:
            line = polyline(lane.centre)
            for sign, near in ((1, lane.successors), (-1, lane.predecessors)) if len(line) > 1 else ():
                name, *others = (self.driven(lane_name, sign) for lane_name in (lane.name, *(near or ())))
                self._lines[name], self._beyond[name] = line[::sign], others
        self._names = [*self._lines]
        near = [(line.min(axis=0) - _NEAR_M, line.max(axis=0) + _NEAR_M) for line in self._lines.values()]
        self._low, self._high = np.array(near).reshape(-1, 2, 2).transpose(1, 0, 2)

    def driven(self, name: Any, sign: int) -> Driven:
        """Return a lane driven as it leads, or against it (-1)."""
        return (*name, sign if self._roads[name[0]].forward(*name[1:]) else -sign)

    def known(self, lane: Driven, count: int = 0) -> Driven:
        """Return the lane so many lanes to the left of a driven one; raises `ValueError` if none is there."""
        road, piece, first, sign = lane
        other = first + sign * count
        other += int(math.copysign(count and first * other <= 0, sign * count))
        if (road, piece, other, sign) not in self._lines:
            raise ValueError(f"road {road} has no lane {other} there")
        return road, piece, other, sign

    def at_station(self, road: str, s: float, t: float, lane: int | None = None) -> Pose:
        """Return the pose beside the middle of a lane, or the reference line, and headed along this line."""
        if road not in self._roads:
            raise ValueError(f"its map has no road {road}")
        whole, piece = self._roads[road], self._roads[road].piece_at(s)
        if lane is not None:
            self.known((road, piece, lane, 1))
            t += float(np.interp(s, whole.pieces[piece].s, whole.pieces[piece].borders[lane].mean(axis=0)))
        columns = (*whole.line.places.T, np.unwrap(whole.line.headings))
        x, y, heading = (float(np.interp(s, whole.line.s, column)) for column in columns)
        name = None if lane is None else (road, piece, lane)
        return Pose(x, y, heading).moved(0.0, t)._replace(lane=name)

    def _projected(self, pose: Pose, lane: Driven) -> tuple[float, float]:
        """Return the arc length of a place along a lane, and its cost: its distance and turn."""
        line = self._lines[lane]
        arc, gap = (float(value[0]) for value in project(np.array([pose[:2]]), line))
        if gap > _BESIDE_M and pose.lane is None:
            return arc, math.inf
        (x0, y0), (x1, y1) = along(line, max(arc - 0.5, 0.0)), along(line, arc + 0.5)
        turned = abs(turn(math.atan2(y1 - y0, x1 - x0), pose.heading))
        return arc, gap + 2 * turned + _AGAINST_M * (lane != self.driven(lane[:3], 1))

    def lane_of(self, pose: Pose) -> Driven | None:
        """Return the lane on which a pose is: the nearest, driven as it leads before against; else None."""
        place = np.array(pose[:2])
        if pose.lane is None:
            beside = ((self._low <= place) & (place <= self._high)).all(axis=1)
            names = [self._names[k] for k in np.flatnonzero(beside)]
        else:
            both = ((*pose.lane, 1), (*pose.lane, -1)) if np.isfinite(place).all() else ()
            names = [name for name in both if name in self._lines]
        cost, lane = min(((self._projected(pose, n)[1], n) for n in names), default=(math.inf, None))
        return lane if cost < math.inf else None

    def roads_of(self, goals: Sequence[Pose]) -> list[str]:
        """Return the roads on which the places of a route are."""
        return [lane[0] for goal in goals if (lane := self.lane_of(goal)) is not None]

    def way(self, pose: Pose, roads: Sequence[str] = ()) -> Way:
        """Return the way ahead of a pose, over some roads or straight on; beside all lanes a line."""
        lane = self.lane_of(pose)
        if lane is None:
            return Way(np.array([pose[:2], pose.moved(_AHEAD_M, 0.0)[:2]]))
        lanes, length = [lane], -self._projected(pose, lane)[0]
        while (length := length + length_of(self._lines[lane])) < _AHEAD_M:
            roads = roads[roads.index(lane[0]) + 1 :] if lane[0] in roads else roads
            beyond = [name for name in self._beyond[lane] if name in self._lines]
            if not beyond:
                break
            costs = [(self._lanes_to(name, roads), abs(bend(self._lines[name])), name) for name in beyond]
            lanes.append(lane := min(costs)[2])
        return Way(np.concatenate([self._lines[lanes[0]], *(self._lines[name][1:] for name in lanes[1:])]))

    def _lanes_to(self, lane: Driven, roads: Sequence[str]) -> float:
        layer, seen, count = {lane}, {lane}, 0.0
        while roads and layer:
            if any(name[0] == roads[0] for name in layer):
                return count
            layer = {beyond for name in layer for beyond in self._beyond.get(name, ())} - seen
            seen, count = seen | layer, count + 1
        return math.inf
