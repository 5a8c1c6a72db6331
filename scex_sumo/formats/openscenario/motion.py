"""Motion of one road user: along its way, under the actions of a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.opendrive.reference import number
from scex_sumo.formats.openscenario.document import Entity
from scex_sumo.formats.openscenario.places import Places, Pose, UnknownMotion, Way

Action: TypeAlias = Iterator[None]  # goes on for a tick each time; it ends when it is over

TICK_S: Final = 0.02
_PEAKS = {"cubic": 1.5, "sinusoidal": math.pi / 2}  # of the rate, over its mean
_SHARES: Mapping[str, Callable[[float], float]] = {
    "cubic": lambda progress: progress**2 * (3 - 2 * progress),
    "sinusoidal": lambda progress: (1 - math.cos(math.pi * progress)) / 2,
}
_CLOTHOID_M = 0.5  # between points
_SPEED_S = 0.1  # before and after a time: their places tell the speed on a trajectory
_TO_GAP_S, _MOST_MPS2 = 1.0, 5.0  # time in which a follower takes a wrong distance back, and how hard


@dataclass(eq=False)
class Mover:
    """Road user in motion; ``pose`` is that of its reference point.

    Attributes:
        way: lanes or a trajectory. It is ``left`` of it, at an arc length.
        roads: roads of its route that are ahead.
        along: what changes its speed; ``across`` its place across.
    """

    entity: Entity
    places: Places
    pose: Pose
    way: Way
    there: bool = False
    speed: float = 0.0
    travelled: float = 0.0
    arc: float = 0.0
    left: float = 0.0
    roads: Sequence[str] = ()
    along: Action | None = None
    across: Action | None = None

    def put(self, pose: Pose) -> None:
        """Put it at a pose, and on the way ahead of it."""
        self.pose, self.there, self.way = pose, True, self.places.way(pose, self.roads)
        self.arc, self.left = self.way.project(pose)

    @property
    def centre(self) -> Pose:
        """Pose of the centre of its box."""
        return self.pose.moved(self.entity.ahead_m, self.entity.left_m)

    def ahead(self, goal: Pose) -> float:
        """Return how far a place is ahead along the lanes, m; straight on without lanes."""
        return self.way.project(goal)[0] - self.arc if self.way.lanes else self.pose.seen(goal)[0]

    def step(self, time_s: float) -> None:
        """Move by `TICK_S`, to a time; one that comes to the end of the road is gone."""
        arc, speed, left, way = self.arc, self.speed, self.left, self.way
        self.along = _tick(self.along)
        if way.times_s is not None:
            self.arc, self.speed = float(np.interp(time_s, way.times_s, way.arcs)), _speed(way, time_s)
        else:
            self.arc += (speed + self.speed) / 2 * TICK_S
            self.across = _tick(self.across)
        gone = self.arc - arc
        slip = math.atan2(self.left - left, gone) if gone > 1e-6 else 0.0
        there = way.at(self.arc, self.left)
        self.pose = Pose(x=there.x, y=there.y, heading=there.heading + slip)
        self.travelled += abs(gone)
        if (time_s >= way.times_s[-1] - 1e-9) if way.times_s is not None else self.arc >= way.arcs[-1]:
            if way.headings is None:
                self.there = False
            else:
                self.put(self.pose)


def _tick(action: Action | None) -> Action | None:
    """Let an action go on for a tick; return it, or None where it is over."""
    return action if action is not None and next(action, "over") is None else None


def _speed(way: Way, time_s: float) -> float:
    assert way.times_s is not None
    if way.speeds is not None:
        return float(np.interp(time_s, way.times_s, way.speeds))
    times = np.clip([time_s - _SPEED_S, time_s + _SPEED_S], way.times_s[0], way.times_s[-1])
    return float(np.diff(np.interp(times, way.times_s, way.arcs))[0] / max(np.diff(times)[0], 1e-9))


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
        share = _SHARES.get(shape, float)(progress)
        setattr(mover, name, first + (target() - first) * share)
        if progress >= 1 - 1e-9 and not stays:
            return
        yield


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
    if action.get("freespace") == "true":
        gap += (mover.entity.length + other.entity.length) / 2
    wrong = math.inf
    while action.get("continuous") == "true" or abs(wrong) >= 0.1:
        wrong = mover.ahead(other.pose) - gap - gap_s * mover.speed
        change = (other.speed + wrong / _TO_GAP_S - mover.speed) / _TO_GAP_S
        mover.speed = max(mover.speed + min(max(change, -_MOST_MPS2), _MOST_MPS2) * TICK_S, 0.0)
        yield


def trajectory(action: Element, mover: Mover, now_s: float, pose_at: Callable[[Element], Pose]) -> Way:
    """Return the trajectory of a `FollowTrajectoryAction` that begins now.

    Args:
        pose_at: returns the pose of the position within an element.

    Raises:
        UnknownMotion: its shape is not read.
        ValueError: it has no two points in the order of their times.
    """
    line = next((one[0] for one in action.iter("Shape") if len(one)), action)
    if line.tag == "Polyline":
        vertices = line.findall("Vertex")
        poses = np.array([(p.x, p.y, p.heading) for p in map(pose_at, vertices)]).reshape(-1, 3)
        if len(poses) > 1 and not any(one.find(".//*[@h]") is not None for one in vertices):
            poses[:, 2] = np.arctan2(*np.gradient(poses[:, :2], axis=0).T[::-1])
        times = np.array([number(one, "time") if one.get("time") else math.nan for one in vertices])
    elif line.tag == "Clothoid":
        poses, times = _clothoid(line, pose_at(line))
    else:
        raise UnknownMotion(f"trajectory of {line.tag} is not read")
    way = Way(points=poses[:, :2], headings=np.unwrap(poses[:, 2]))
    timing = action.find("TimeReference/Timing")
    if timing is not None and not np.isnan(times).any():
        begin_s = now_s if timing.get("domainAbsoluteRelative") == "relative" else 0.0
        way.times_s = begin_s + times * number(timing, "scale", "1") + number(timing, "offset", "0")
        logged = mover.entity.speeds
        way.speeds = np.array(logged) if len(logged) == len(times) else None
    if len(poses) < 2 or (way.times_s is not None and (np.diff(way.times_s) <= 0).any()):
        raise ValueError("a trajectory needs two points or more, in the order of their times")
    return way


def _clothoid(line: Element, start: Pose) -> tuple[FloatArray, FloatArray]:
    length, first = number(line, "length"), number(line, "curvature")
    rate = number(line, "curvaturePrime", line.get("curvatureDot", "0"))
    s = np.linspace(0.0, length, int(np.clip(length / _CLOTHOID_M, 1, 10**6)) + 1)
    middle = (s[1:] + s[:-1]) / 2
    turned = start.heading + middle * (first + rate / 2 * middle)
    steps = np.diff(s)[:, None] * np.column_stack([np.cos(turned), np.sin(turned)])
    places = np.array([start.x, start.y]) + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    ends = [number(line, k) if line.get(k) else math.nan for k in ("startTime", "stopTime")]
    times = np.interp(s, [0.0, length], ends)
    return np.column_stack([places, start.heading + s * (first + rate / 2 * s)]), times
