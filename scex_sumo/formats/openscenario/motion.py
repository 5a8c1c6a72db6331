"""Motion of one road user: along its way, under the actions of a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TypeAlias, TypeVar
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.opendrive.roads import ReferenceLine, number
from scex_sumo.formats.opendrive.ways import Places, Pose, Way
from scex_sumo.geometry.polylines import distances
from scex_sumo.geometry.rectangles import Rectangles

Action: TypeAlias = Callable[[float], bool]  # acts for a step, s, at its end; returns whether it goes on
Target: TypeAlias = Callable[[], float]  # returns the value that something changes to
_T = TypeVar("_T")

BODIES = {"Vehicle": "car", "Pedestrian": "pedestrian", "MiscObject": "object"}
_KINDS = {"motorbike": "motorcycle", "van": "car", "semitrailer": "truck"}
_PEAKS = {"cubic": 1.5, "sinusoidal": math.pi / 2}  # of the rate, over its mean
_SHARES: Mapping[str, Callable[[float], float]] = {
    "step": float,
    "linear": float,
    "cubic": lambda progress: progress**2 * (3 - 2 * progress),
    "sinusoidal": lambda progress: (1 - math.cos(math.pi * progress)) / 2,
}
_TO_GAP_S = 1.0  # in which a follower takes a wrong distance back, as far as its limits let it


class UnknownMotion(ValueError):
    """What a scenario leaves to players, or what is not read: its motion is known until then."""


class Mover:
    """Road user in motion; it is ``left`` of its way, at an arc length.

    Attributes:
        box_at: how far its box's centre is ahead and left of its reference point, m.
        logged: speeds at the vertices of its trajectory, m/s, where our own export wrote the file.
        roads: roads of its route that are ahead.
        actions: what changes its motion ``along`` and ``across`` its way.
        pose: of its reference point, and ``before`` its last step.
    """

    def __init__(self, element: Element, places: Places) -> None:
        self.name = element.get("name", "")
        body = next((child for child in element if child.tag in BODIES), None)
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
        self.time_s = self.speed = self.travelled = self.arc = self.left = 0.0
        self.actions: Mapping[str, Action] = {}
        self.pose = self.before = Pose(math.nan, math.nan, 0.0)
        self._places, self.way = places, places.way(self.pose)
        self._past = self.way, self.arc, self.left, self.speed

    def put(self, pose: Pose) -> None:
        """Put it at a pose, and on the way ahead of it."""
        self.there, self.way = True, self._places.way(pose, self.roads)
        self.arc, self.left = self.way.project(pose)
        self.pose = self.before = pose

    def sample(self) -> tuple[float, ...]:
        """Return x, y, vx, vy, heading, length and width of its box, m, m/s and rad."""
        x, y, heading, _ = self.pose.moved(*self.box_at)
        velocity = self.speed * math.cos(heading), self.speed * math.sin(heading)
        return x, y, *velocity, heading, self.length, self.width

    @property
    def box(self) -> Rectangles:
        """Its box."""
        x, y, _, _, heading, length, width = np.array(self.sample())
        return Rectangles(x=x, y=y, heading=heading, half_length=length / 2, half_width=width / 2)

    def passed(self, goal: Pose) -> float:
        """Return how near it came to a place in its last step, m."""
        return float(distances(np.array([goal[:2]]), np.array([self.before[:2], self.pose[:2]]))[0])

    def ahead(self, goal: Pose) -> float:
        """Return how far a place is ahead along its way, m."""
        return self.way.project(goal)[0] - self.arc

    def begin(self, kind: str, law: Callable[..., Action], *given: object) -> Action:
        """Begin an action by its law, in the place of another one of its kind."""
        self.end(self.actions.get(kind))
        action = law(self, *given)
        self.actions = {**self.actions, kind: action}
        return action

    def end(self, action: Action | None) -> None:
        """End an action if it goes on; from the end of a trajectory it drives on."""
        kinds = [kind for kind, running in self.actions.items() if running is action]
        self.actions = {kind: running for kind, running in self.actions.items() if kind not in kinds}
        if "across" in kinds and self.way.headings is not None:
            self.put(self.way.at(self.arc, self.left))

    def act(self, time_s: float, step_s: float) -> None:
        """Let its actions change its speed and its place across, as they are after a step at a time; once."""
        if self.time_s == time_s:
            return
        self.time_s, self._past = time_s, (self.way, self.arc, self.left, self.speed)
        for action in self.actions.values() if self.there else ():
            if not action(step_s):
                self.end(action)

    def move(self, step_s: float) -> None:
        """Move by a step; one that comes to the end of the road is gone."""
        if not self.there:
            return
        path, arc, left, speed = self._past
        length = (speed + self.speed) / 2 * step_s
        self.travelled += length
        if path.times_s is None:
            self.arc += length
        self.before = self.pose
        if self.way is path:
            gone = self.arc - arc
            slip = math.atan2(self.left - left, gone) if gone > 1e-9 else 0.0
            self.pose = path.at(self.arc, self.left).turned(slip)
            self.there = path.headings is not None or self.arc < path.arcs[-1]


def chosen(element: Element, name: str, default: str, choices: Mapping[str, _T]) -> _T:
    """Return what the word of an attribute stands for; `ValueError` if it is none of the choices."""
    word = element.get(name, default)
    if word not in choices:
        raise ValueError(f"{name} of its {element.tag} is {word[:24]!r}")
    return choices[word]


def changing(mover: Mover, name: str, dynamics: Element, target: Target, stays: bool = False) -> Action:
    """Change ``speed`` or ``left`` by a shape over a time, a distance or at a rate.

    What ``stays`` goes on, to a target that changes.
    """
    shape, by = dynamics.get("dynamicsShape", "step"), dynamics.get("dynamicsDimension", "time")
    share, value = chosen(dynamics, "dynamicsShape", "step", _SHARES), number(dynamics, "value", "0")
    first, last, begun_s, begun_m = getattr(mover, name), target(), mover.time_s, mover.travelled
    whole = 0.0 if shape == "step" else value
    if whole and by == "rate":
        whole = abs(last - first) * _PEAKS.get(shape, 1.0) / max(abs(value), 1e-9)
    elif whole and by == "distance" and name == "speed":
        whole = value / max((first + last) / 2, 1e-9)

    def change(step_s: float) -> bool:
        done = mover.time_s - begun_s
        if by == "distance" and name == "left":
            done = mover.travelled - begun_m + mover.speed * step_s
        progress = min(done / whole, 1.0) if whole > 0 else 1.0
        setattr(mover, name, first + ((target() if stays else last) - first) * share(progress))
        return stays or progress < 1 - 1e-9

    change(0.0)  # what needs no time is done at once
    return change


def synchronising(mover: Mover, goal: Pose, master: Mover, masters: Pose, final: Target | None) -> Action:
    """Change the speed to be at a place when another one is at its own."""

    def approach(step_s: float) -> bool:
        left, theirs, speed = mover.ahead(goal), master.ahead(masters), mover.speed
        time_s, final_mps = theirs / max(master.speed, 1e-3), None if final is None else final()
        if min(left, theirs) <= 0 or time_s <= step_s:
            mover.speed = speed if final_mps is None else final_mps
            return False
        change, jerk = 2 * (left - speed * time_s) / time_s**2, 0.0
        if final_mps is not None:
            change = (6 * left - (4 * speed + 2 * final_mps) * time_s) / time_s**2
            jerk = (6 * (speed + final_mps) * time_s - 12 * left) / time_s**3
        mover.speed = max(speed + (change + jerk / 2 * step_s) * step_s, 0.0)
        return True

    return approach


def following(mover: Mover, action: Element, other: Mover) -> Action:
    """Change the speed to keep a distance or a time gap to another one."""
    gap, gap_s = number(action, "distance", "0"), number(action, "timeGap", "0")
    gap += (mover.length + other.length) / 2 if action.get("freespace") == "true" else 0.0
    limits = action.find("DynamicConstraints")
    names = "maxDeceleration", "maxAcceleration", "maxSpeed"
    least, most, fastest = (math.inf if limits is None else number(limits, k, "1e9") for k in names)

    def follow(step_s: float) -> bool:
        free, speed, others = mover.ahead(other.pose) - gap, mover.speed, other.speed
        wrong, closing = free - gap_s * speed, others - speed
        # As they are in the middle of the step.
        change = (closing + (wrong + closing * step_s / 2) / _TO_GAP_S) / (_TO_GAP_S + step_s / 2)
        speed += min(max(change, -least), most) * step_s
        if limits is None:  # no inertia
            speed = (others * _TO_GAP_S + free) / (_TO_GAP_S + gap_s)
        mover.speed = min(max(speed, 0.0), fastest)
        return action.get("continuous") == "true" or abs(wrong) >= 0.1

    return follow


def driving(mover: Mover, path: Way) -> Action:
    """Follow a trajectory, by its times or at the own speed."""
    mover.way, mover.arc, mover.left = path, 0.0, 0.0
    mover.pose = mover.before = path.at(0.0)
    times = path.times_s

    def drive(step_s: float) -> bool:
        if mover.way is not path:  # it was put elsewhere
            return False
        if times is None:
            return bool(mover.arc + mover.speed * step_s < path.arcs[-1])
        mover.arc = float(np.interp(mover.time_s, times, path.arcs))
        mover.speed = float(np.interp(mover.time_s, times, path.speeds))
        return bool(mover.time_s < times[-1] - 1e-9)

    return drive


def trajectory(action: Element, mover: Mover, now_s: float, pose_at: Callable[[Element], Pose]) -> Way:
    """Return the trajectory of an action that begins now; ``pose_at`` returns the pose of a vertex.

    Raises:
        UnknownMotion, ValueError: its shape is not read; it has no two points in the order of their times.
    """
    line = next((shape[0] for shape in action.iter("Shape") if len(shape)), action)
    if line.tag == "Polyline":
        vertices = line.findall("Vertex")
        poses = np.array([pose_at(vertex)[:3] for vertex in vertices]).reshape(-1, 3)
        if len(poses) > 1 and not any(vertex.find(".//*[@h]") is not None for vertex in vertices):
            poses[:, 2] = np.arctan2(*np.gradient(poses[:, :2], axis=0).T[::-1])
        times = np.array([number(vertex, "time") if vertex.get("time") else math.nan for vertex in vertices])
    elif line.tag == "Clothoid":
        poses, times = _clothoid(line, pose_at(line))
    else:
        raise UnknownMotion(f"trajectory of {line.tag} is not read")
    path = Way(poses[:, :2], np.unwrap(poses[:, 2]))
    timing = action.find("TimeReference/Timing")
    if timing is not None and not np.isnan(times).any():
        begin_s = now_s if timing.get("domainAbsoluteRelative") == "relative" else 0.0
        path.times_s = begin_s + times * number(timing, "scale", "1") + number(timing, "offset", "0")
    if len(poses) < 2 or (path.times_s is not None and (np.diff(path.times_s) <= 0).any()):
        raise ValueError("a trajectory needs two points or more, in the order of their times")
    if path.times_s is not None:
        is_logged = len(mover.logged) == len(times)
        path.speeds = np.array(mover.logged) if is_logged else np.gradient(path.arcs, path.times_s)
    return path


def _clothoid(line: Element, start: Pose) -> tuple[FloatArray, FloatArray]:
    length, first = number(line, "length"), number(line, "curvature")
    last = first + length * number(line, "curvaturePrime", line.get("curvatureDot", "0"))
    place = {"x": start.x, "y": start.y, "hdg": start.heading, "s": 0.0, "length": length}
    road, texts = Element("road"), {name: str(value) for name, value in place.items()}
    stretch = SubElement(SubElement(road, "planView"), "geometry", texts)
    SubElement(stretch, "spiral", curvStart=str(first), curvEnd=str(last))
    drawn = ReferenceLine(road, ())
    ends = [number(line, k) if line.get(k) else math.nan for k in ("startTime", "stopTime")]
    return np.column_stack([drawn.places, drawn.headings]), np.interp(drawn.s, [0.0, length], ends)
