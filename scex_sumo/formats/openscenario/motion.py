"""Motion of one road user: along its way, under the actions of a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.opendrive.reference import number
from scex_sumo.formats.opendrive.roads import Name
from scex_sumo.formats.opendrive.ways import Places, Pose, Way

Action: TypeAlias = Generator[None]  # goes on for a tick each time; it ends when it is over

TICKS_PER_S = 1000  # at 50 m/s, what begins a tick late is 5 cm off
TICK_S = 1 / TICKS_PER_S
BODIES = {"Vehicle": "car", "Pedestrian": "pedestrian", "MiscObject": "object"}
_KINDS = {"motorbike": "motorcycle", "van": "car", "semitrailer": "truck"}
_PEAKS = {"cubic": 1.5, "sinusoidal": math.pi / 2}  # of the rate, over its mean
_SHARES: Mapping[str, Callable[[float], float]] = {
    "cubic": lambda progress: progress**2 * (3 - 2 * progress),
    "sinusoidal": lambda progress: (1 - math.cos(math.pi * progress)) / 2,
}
_CLOTHOID_M = 0.5  # between points
_TO_GAP_S, _MOST_MPS2 = 1.0, 5.0  # time in which a follower takes a wrong distance back, and how hard


class UnknownMotion(ValueError):
    """What a scenario leaves to players, or what is not read: its motion is known until then."""


class Mover:
    """Road user in motion; it is ``left`` of its way, at an arc length.

    Attributes:
        box_at: how far its box's centre is ahead and left of its reference point, m.
        logged: speeds at the vertices of its trajectory, m/s, where our own export wrote the file.
        roads: roads of its route that are ahead.
        actions: what changes its motion ``along`` and ``across`` its way.
    """

    def __init__(self, element: Element, places: Places) -> None:
        self.name = element.get("name", "")
        body = next((one for one in element if one.tag in BODIES), None)
        if body is None:
            raise ValueError(f"entity {self.name} is no vehicle, pedestrian or object")
        kind = body.get("vehicleCategory", "") or BODIES[body.tag]
        size, centre = body.find("BoundingBox/Dimensions"), body.find("BoundingBox/Center")
        speeds = body.find("Properties/Property[@name='speeds_mps']")
        self.kind = _KINDS.get(kind, kind)
        self.length, self.width = (math.nan if size is None else number(size, k) for k in ("length", "width"))
        self.box_at = (0.0, 0.0) if centre is None else (number(centre, "x"), number(centre, "y"))
        self.logged = [] if speeds is None else [float(x) for x in speeds.get("value", "").split()]
        self.is_controlled = element.find("ObjectController") is not None
        self.there, self.roads = False, list[str]()
        self.time_s = self.speed = self.travelled = self.arc = self.left = self._slip = 0.0
        self.actions: dict[str, Action] = {}
        self._pose: Pose | None = Pose(math.nan, math.nan, 0.0)
        self._places, self.way = places, places.way(self.pose)

    def put(self, pose: Pose) -> None:
        """Put it at a pose, and on the way ahead of it."""
        self.there, self.way = True, self._places.way(pose, self.roads)
        self.arc, self.left = self.way.project(pose)
        self._pose = pose

    @property
    def pose(self) -> Pose:
        """Pose of its reference point."""
        if self._pose is None:
            self._pose = self.way.at(self.arc, self.left).turned(self._slip)
        return self._pose

    def sample(self) -> tuple[float, ...]:
        """Return x, y, vx, vy, heading, length and width of its box, m, m/s and rad."""
        x, y, heading, _ = self.pose.moved(*self.box_at)
        velocity = self.speed * math.cos(heading), self.speed * math.sin(heading)
        return x, y, *velocity, heading, self.length, self.width

    @property
    def outline(self) -> shapely.Polygon:
        """Outline of its box."""
        centre, shares = self.pose.moved(*self.box_at), ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))
        return shapely.Polygon([centre.moved(a * self.length, b * self.width)[:2] for a, b in shares])

    def ahead(self, goal: Pose) -> float:
        """Return how far a place is ahead along its way, m."""
        return self.way.project(goal)[0] - self.arc

    def begin(self, kind: str, action: Action) -> Action:
        """Begin an action in the place of another one of its kind."""
        self.end(self.actions.get(kind))
        self.actions[kind] = action
        return action

    def end(self, action: Action | None) -> None:
        """End an action if it goes on."""
        for kind in [kind for kind, one in self.actions.items() if one is action]:
            self.actions.pop(kind).close()

    def step(self, time_s: float) -> None:
        """Move by `TICK_S`, to a time; one that comes to the end of the road is gone."""
        way, arc, speed, left, self.time_s = self.way, self.arc, self.speed, self.left, time_s
        for action in [*self.actions.values()]:
            if next(action, "over") == "over":
                self.end(action)
        if way.times_s is None:
            self.arc += (speed + self.speed) / 2 * TICK_S
        self.travelled += self.speed * TICK_S
        if self.way is way:
            gone, self._pose = self.arc - arc, None
            self._slip = math.atan2(self.left - left, gone) if gone > 1e-9 else 0.0
            self.there = way.headings is not None or self.arc < way.arcs[-1]


def changing(
    mover: Mover, name: str, dynamics: Element, target: Callable[[], float], *, stays: bool = False
) -> Action:
    """Change the speed, or the place across, by a shape over a time, at a rate or over a distance.

    Args:
        name: ``speed`` or ``left``.
        stays: it goes on, to a target that changes.
    """
    shape, by = dynamics.get("dynamicsShape", "step"), dynamics.get("dynamicsDimension", "time")
    first, value, is_speed = getattr(mover, name), number(dynamics, "value", "0"), name == "speed"
    whole, done = 0.0 if shape == "step" else value, 0.0
    if whole and by == "rate":
        whole = abs(target() - first) * _PEAKS.get(shape, 1.0) / max(abs(value), 1e-9)
    elif whole and by == "distance" and is_speed:
        whole = value / max((first + target()) / 2, 1e-9)
    while done < whole - 1e-9 or stays or not done:
        done += mover.speed * TICK_S if by == "distance" and not is_speed else TICK_S
        progress = min(done / whole, 1.0) if whole > 0 else 1.0
        setattr(mover, name, first + (target() - first) * _SHARES.get(shape, float)(progress))
        if progress >= 1 - 1e-9 and not stays:
            return
        yield


def changing_lane(mover: Mover, lane: Name, dynamics: Element, left: float) -> Action:
    """Go over to a place across another lane, m to the left of its middle."""
    mover.put(mover.pose._replace(lane=lane))
    yield from changing(mover, "left", dynamics, lambda: left)


def synchronising(mover: Mover, goal: Pose, master: Mover, masters: Pose, final_mps: float | None) -> Action:
    """Change the speed to be at a place when another one is at its own."""
    while True:
        left, theirs = mover.ahead(goal), master.ahead(masters)
        time_s = theirs / max(master.speed, 1e-3)
        if min(left, theirs) <= 0 or time_s <= TICK_S:
            mover.speed = mover.speed if final_mps is None else final_mps
            return
        if final_mps is None:
            change = 2 * (left - mover.speed * time_s) / time_s**2
        else:
            change = (6 * left - (4 * mover.speed + 2 * final_mps) * time_s) / time_s**2
        mover.speed = max(mover.speed + change * TICK_S, 0.0)
        yield


def following(mover: Mover, action: Element, other: Mover) -> Action:
    """Change the speed to keep a distance or a time gap to another one."""
    gap, gap_s = number(action, "distance", "0"), number(action, "timeGap", "0")
    gap += (mover.length + other.length) / 2 if action.get("freespace") == "true" else 0.0
    wrong = math.inf
    while action.get("continuous") == "true" or abs(wrong) >= 0.1:
        wrong = mover.ahead(other.pose) - gap - gap_s * mover.speed
        change = (other.speed + wrong / _TO_GAP_S - mover.speed) / _TO_GAP_S
        mover.speed = max(mover.speed + min(max(change, -_MOST_MPS2), _MOST_MPS2) * TICK_S, 0.0)
        yield


def driving(mover: Mover, way: Way) -> Action:
    """Follow a trajectory, by its times or at the own speed."""
    mover.way, mover.arc, mover.left = way, 0.0, 0.0
    times, is_over = way.times_s, False
    try:
        while mover.way is way and not is_over:
            if times is not None:
                mover.arc = float(np.interp(mover.time_s, times, way.arcs))
                mover.speed = float(np.interp(mover.time_s, times, way.speeds))
            is_over = mover.arc >= way.arcs[-1] if times is None else mover.time_s >= times[-1] - 1e-9
            yield
    finally:
        if mover.way is way:
            mover.put(way.at(mover.arc, mover.left))


def trajectory(action: Element, mover: Mover, now_s: float, pose_at: Callable[[Element], Pose]) -> Way:
    """Return the trajectory of an action that begins now; ``pose_at`` returns the pose of a vertex.

    Raises:
        UnknownMotion, ValueError: its shape is not read; it has no two points in the order of their times.
    """
    line = next((one[0] for one in action.iter("Shape") if len(one)), action)
    if line.tag == "Polyline":
        vertices = line.findall("Vertex")
        poses = np.array([pose_at(vertex)[:3] for vertex in vertices]).reshape(-1, 3)
        if len(poses) > 1 and not any(one.find(".//*[@h]") is not None for one in vertices):
            poses[:, 2] = np.arctan2(*np.gradient(poses[:, :2], axis=0).T[::-1])
        times = np.array([number(one, "time") if one.get("time") else math.nan for one in vertices])
    elif line.tag == "Clothoid":
        poses, times = _clothoid(line, pose_at(line))
    else:
        raise UnknownMotion(f"trajectory of {line.tag} is not read")
    way = Way(poses[:, :2], np.unwrap(poses[:, 2]))
    timing = action.find("TimeReference/Timing")
    if timing is not None and not np.isnan(times).any():
        begin_s = now_s if timing.get("domainAbsoluteRelative") == "relative" else 0.0
        way.times_s = begin_s + times * number(timing, "scale", "1") + number(timing, "offset", "0")
    if len(poses) < 2 or (way.times_s is not None and (np.diff(way.times_s) <= 0).any()):
        raise ValueError("a trajectory needs two points or more, in the order of their times")
    if way.times_s is not None:
        is_logged = len(mover.logged) == len(times)
        way.speeds = np.array(mover.logged) if is_logged else np.gradient(way.arcs, way.times_s)
    return way


def _clothoid(line: Element, start: Pose) -> tuple[FloatArray, FloatArray]:
    length, first = number(line, "length"), number(line, "curvature")
    rate = number(line, "curvaturePrime", line.get("curvatureDot", "0"))
    s = np.linspace(0.0, length, int(np.clip(length / _CLOTHOID_M, 1, 10**6)) + 1)
    middle = (s[1:] + s[:-1]) / 2
    turned = start.heading + middle * (first + rate / 2 * middle)
    steps = np.diff(s)[:, None] * np.column_stack([np.cos(turned), np.sin(turned)])
    places = start[:2] + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    ends = [number(line, k) if line.get(k) else math.nan for k in ("startTime", "stopTime")]
    times = np.interp(s, [0.0, length], ends)
    return np.column_stack([places, start.heading + s * (first + rate / 2 * s)]), times
