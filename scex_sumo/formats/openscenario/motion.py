"""Motion of one road user: along its way or a trajectory, under the actions of a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.opendrive.reference import number
from scex_sumo.formats.openscenario.document import Entity
from scex_sumo.formats.openscenario.places import NOWHERE, Places, Pose, UnknownMotion, Way
from scex_sumo.geometry.polylines import arc_lengths

TICK_S: Final = 0.02
_PEAKS = {"linear": 1.0, "cubic": 1.5, "sinusoidal": math.pi / 2}  # of the rate, over its mean
_CLOTHOID_M = 0.5  # between points
DENSE_S = 0.2  # between points of a recorded motion
_TO_GAP_S, _MOST_MPS2 = 1.0, 5.0  # time in which a follower takes a wrong distance back, and how hard


@dataclass(eq=False)
class Mover:
    """Road user in motion; ``pose`` is that of its reference point.

    Attributes:
        way: None on no lane: it goes straight on. It is ``left`` of it, at an arc length.
        roads: roads of its route that are ahead.
        along: what changes its speed; ``across`` its place across; ``path``: the trajectory that it follows.
    """

    entity: Entity
    places: Places
    pose: Pose = NOWHERE
    there: bool = False
    speed: float = 0.0
    travelled: float = 0.0
    way: Way | None = None
    arc: float = 0.0
    left: float = 0.0
    roads: Sequence[str] = ()
    along: Callable[[Mover], bool] | None = None
    across: Callable[[Mover], bool] | None = None
    path: Trajectory | None = None

    def put(self, pose: Pose) -> None:
        """Put it at a pose, and on the way ahead of it."""
        self.pose, self.there, self.way = pose, True, self.places.way(pose, self.roads)
        self.arc, self.left = (0.0, 0.0) if self.way is None else self.way.project(pose)

    @property
    def centre(self) -> Pose:
        """Pose of the centre of its box."""
        return self.pose.moved(self.entity.ahead_m, self.entity.left_m)

    def ahead(self, goal: Pose) -> float:
        """Return how far a place is ahead along the way, m; straight on without a way."""
        if self.way is not None and self.path is None:
            return self.way.project(goal)[0] - self.arc
        return self.pose.seen(goal)[0]

    def step(self, time_s: float) -> None:
        """Move by `TICK_S`, to a time; one that comes to the end of the road is gone."""
        before, speed, left = self.pose, self.speed, self.left
        self.along = None if self.along is not None and self.along(self) else self.along
        gone = (speed + self.speed) / 2 * TICK_S
        if self.path is not None:
            self.pose, speed_then = self.path.pose(gone, time_s)
            if speed_then is not None:
                gone, self.speed = math.hypot(self.pose.x - before.x, self.pose.y - before.y), speed_then
            if self.path.is_done:
                self.path = None
                self.put(self.pose)
        elif self.way is None:
            self.pose = self.pose.moved(gone, 0.0)
        else:
            self.arc += gone
            self.across = None if self.across is not None and self.across(self) else self.across
            there = self.way.at(self.arc, self.left)
            slip = math.atan2(self.left - left, gone) if gone > 1e-6 else 0.0
            self.pose = Pose(x=there.x, y=there.y, heading=there.heading + slip)
            self.there = self.arc < self.way.length
        self.travelled += abs(gone)


class Change:
    """Change of speed or of the place across by a shape, over a time, at a rate or over a distance.

    Args:
        stays: it goes on, to a target that changes.
    """

    def __init__(
        self, name: str, dynamics: Element, target: Callable[[], float], *, stays: bool = False
    ) -> None:
        self._name, self._target, self._stays = name, target, stays
        self._shape = dynamics.get("dynamicsShape", "step")
        self._dimension, self._value = (
            dynamics.get("dynamicsDimension", "time"),
            number(dynamics, "value", "0"),
        )
        self._first, self._duration, self._done = 0.0, -1.0, 0.0

    @property
    def is_step(self) -> bool:
        """Whether it happens at once."""
        return self._shape == "step"

    def __call__(self, mover: Mover) -> bool:
        """Change it for a tick; return whether it is over."""
        target, is_speed = self._target(), self._name == "speed"
        if self._duration < 0:
            self._first = getattr(mover, self._name)
            self._duration = self._begun(abs(target - self._first), self._first + target, is_speed)
        by_way = self._dimension == "distance" and not is_speed
        self._done += mover.speed * TICK_S if by_way else TICK_S
        progress = min(self._done / self._duration, 1.0) if self._duration > 0 else 1.0
        setattr(mover, self._name, self._first + (target - self._first) * self._share(progress))
        return progress >= 1 - 1e-9 and not self._stays

    def _begun(self, change: float, sum_: float, is_speed: bool) -> float:
        if self.is_step:
            return 0.0
        if self._dimension == "rate":
            return change * _PEAKS.get(self._shape, 1.0) / max(abs(self._value), 1e-9)
        return (
            self._value / max(sum_ / 2, 1e-9) if self._dimension == "distance" and is_speed else self._value
        )

    def _share(self, progress: float) -> float:
        if self._shape == "cubic":
            return progress**2 * (3 - 2 * progress)
        return (1 - math.cos(math.pi * progress)) / 2 if self._shape == "sinusoidal" else progress


class Synchronised:
    """Speed with which a road user is at a place when another one is at its own."""

    def __init__(self, goal: Pose, master: Mover, masters: Pose, final_mps: float | None) -> None:
        self._goal, self._master, self._masters, self._final = goal, master, masters, final_mps

    def __call__(self, mover: Mover) -> bool:
        """Change the speed for a tick; return whether it is over."""
        left, theirs = mover.ahead(self._goal), self._master.ahead(self._masters)
        time_s = theirs / max(self._master.speed, 1e-3)
        if min(left, theirs) <= 0 or time_s <= TICK_S:
            mover.speed = mover.speed if self._final is None else self._final
            return True
        if self._final is None:
            change = 2 * (left - mover.speed * time_s) / time_s**2
        else:
            change = (6 * left - (4 * mover.speed + 2 * self._final) * time_s) / time_s**2
        mover.speed = max(mover.speed + change * TICK_S, 0.0)
        return False


class Following:
    """Speed that keeps a distance or a time gap to another road user."""

    def __init__(self, action: Element, other: Mover) -> None:
        self._other, self._stays, self._free = other, action.get("continuous"), action.get("freespace")
        self._gap = number(action, "distance", "0")
        self._time_s = number(action, "timeGap", "0")

    def __call__(self, mover: Mover) -> bool:
        """Change the speed for a tick; return whether it is over."""
        lengths = (mover.entity.length + self._other.entity.length) / 2 if self._free == "true" else 0.0
        wrong = mover.ahead(self._other.pose) - lengths - self._gap - self._time_s * mover.speed
        change = (self._other.speed + wrong / _TO_GAP_S - mover.speed) / _TO_GAP_S
        mover.speed = max(mover.speed + min(max(change, -_MOST_MPS2), _MOST_MPS2) * TICK_S, 0.0)
        return self._stays != "true" and abs(wrong) < 0.1


class Trajectory:
    """Path through poses, followed by its times or with the road user's own speed."""

    def __init__(self, poses: FloatArray, times_s: FloatArray | None) -> None:
        """``poses`` (n, 3): x, y and heading; ``times_s`` (n,) on the scenario's clock."""
        if len(poses) < 2 or (times_s is not None and (np.diff(times_s) <= 0).any()):
            raise ValueError("a trajectory needs two points or more, in the order of their times")
        arc = arc_lengths(poses[:, :2])
        self._at, self._gone, self.is_done = arc if times_s is None else times_s, 0.0, False
        speed = np.zeros(len(poses)) if times_s is None else _speeds(arc, times_s)
        self._rows = *poses[:, :2].T, np.unwrap(poses[:, 2]), speed
        self._is_timed = times_s is not None

    def pose(self, gone: float, time_s: float) -> tuple[Pose, float | None]:
        """Return the pose after a further distance, or that at a time and the speed then."""
        self._gone += gone
        at = time_s if self._is_timed else self._gone
        self.is_done = bool(at >= self._at[-1] - 1e-9)
        x, y, heading, speed = (float(np.interp(at, self._at, row)) for row in self._rows)
        return Pose(x=x, y=y, heading=heading), speed if self._is_timed else None


def _speeds(arc: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the speeds (n,) at points: those of the way there, by the change before if points are dense."""
    step = np.diff(times_s)
    speed = np.diff(arc) / step
    ends = speed.copy()
    dense = np.maximum(step[1:], step[:-1]) <= DENSE_S
    ends[1:] += np.where(dense, np.diff(speed) * step[1:] / (step[1:] + step[:-1]), 0.0)
    return np.asarray(np.maximum(np.append(speed[0], ends), 0.0))


def trajectory_of(action: Element, now_s: float, pose_at: Callable[[Element], Pose]) -> Trajectory:
    """Return the trajectory of a `FollowTrajectoryAction` that begins now.

    Args:
        pose_at: returns the pose of the position within an element.

    Raises:
        UnknownMotion: its shape is not read.
    """
    line = next((one[0] for one in action.iter("Shape") if len(one)), action)
    if line.tag not in ("Polyline", "Clothoid"):
        raise UnknownMotion(f"trajectory of {line.tag} is not read")
    if line.tag == "Polyline":
        vertices = line.findall("Vertex")
        poses = np.array([(p.x, p.y, p.heading) for p in map(pose_at, vertices)]).reshape(-1, 3)
        if len(poses) > 1 and not any(one.find(".//*[@h]") is not None for one in vertices):
            poses[:, 2] = np.arctan2(*np.gradient(poses[:, :2], axis=0).T[::-1])
        times = np.array([number(one, "time") if one.get("time") else math.nan for one in vertices])
    else:
        poses, times = _clothoid(line, pose_at(line))
    timing = action.find("TimeReference/Timing")
    if timing is None or np.isnan(times).any():
        return Trajectory(poses, None)
    begin_s = now_s if timing.get("domainAbsoluteRelative") == "relative" else 0.0
    return Trajectory(poses, begin_s + times * number(timing, "scale", "1") + number(timing, "offset", "0"))


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
