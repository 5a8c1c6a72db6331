"""Storyboard: which actions begin when, by triggers on the scenario's own motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.formats.opendrive.reference import number
from scex_sumo.formats.openscenario.document import Entity
from scex_sumo.formats.openscenario.motion import (
    TICK_S,
    Mover,
    changing,
    following,
    synchronising,
    trajectory,
)
from scex_sumo.formats.openscenario.places import Places, Pose, UnknownMotion, placed
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance

_RULES: Mapping[str, Callable[[float, float], bool]] = {
    "greaterThan": lambda a, b: a > b,
    "lessThan": lambda a, b: a < b,
    "equalTo": lambda a, b: abs(a - b) < 1e-6,
    "greaterOrEqual": lambda a, b: a >= b - 1e-9,
    "lessOrEqual": lambda a, b: a <= b,
    "notEqualTo": lambda a, b: abs(a - b) >= 1e-6,
}
_STILL = (  # actions without a part in the motion
    *("VisibilityAction", "EnvironmentAction", "AppearanceAction", "LightStateAction", "AnimationAction"),
    *("ParameterAction", "VariableAction", "InfrastructureAction", "SetMonitorAction"),
)
_GROUPS = ("LongitudinalAction", "LateralAction", "RoutingAction", "ControllerAction")
_SWITCHES = ("longitudinal", "lateral", "activateLongitudinal", "activateLateral")
_PARTS = {"Story": "Act", "Act": "ManeuverGroup", "ManeuverGroup": "Maneuver", "Maneuver": "Event"}
_STANDBY, _RUNNING, _COMPLETE = "standbyState", "runningState", "completeState"
_EDGES: Mapping[str, Callable[[bool, bool], bool]] = {
    "rising": lambda before, now: now and not before,
    "falling": lambda before, now: before and not now,
    "risingOrFalling": lambda before, now: now != before,
}


@dataclass(eq=False)
class Part:
    """Element of the storyboard and its state; an event's actions are ``running`` until they are over."""

    element: Element
    above: Part | None
    state: str = _STANDBY
    changed: tuple[str, float] = ("", -1.0)
    times: int = 0
    running: list[tuple[Mover, str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.parts = [Part(x, self) for x in self.element.findall(_PARTS.get(self.element.tag, "Nothing"))]

    def all(self) -> Iterator[Part]:
        """Yield it and all below."""
        yield self
        for part in self.parts:
            yield from part.all()


class Storyboard:
    """Motion of a scenario from its initial actions on.

    Attributes:
        movers: road users by name.
        over_s: time at which all stories were complete, s; infinite until then.
    """

    def __init__(self, root: Element, entities: Mapping[str, Entity], places: Places) -> None:
        board, nowhere = _needed(root, "Storyboard"), Pose(x=math.nan, y=math.nan, heading=0.0)
        way = places.way(nowhere)
        self.movers = {name: Mover(one, places, nowhere, way) for name, one in entities.items()}
        self._places, self._time, self.over_s = places, 0.0, math.inf
        self._fired: dict[Element, tuple[bool, float]] = {}
        self._stop = board.find("StopTrigger")
        for private in board.iterfind("Init/Actions/Private"):
            for action in private:
                self._begin(action, [self._mover(private)], [])
        for action in board.iterfind("Init/Actions/GlobalAction"):
            self._begin(action, [], [])
        self._stories = [Part(story, None) for story in board.findall("Story")]
        self._all = [part for story in self._stories for part in story.all()]

    def _mover(self, element: Element, name: str = "entityRef") -> Mover:
        return self._named(element.get(name, ""))

    def _named(self, entity: str) -> Mover:
        if entity not in self.movers:
            raise ValueError(f"entity {entity[:40]!r} is not there")
        return self.movers[entity]

    def _pose(self, element: Element) -> Pose:
        """Return the pose of the position within an element."""
        position = element if element.tag.startswith("TargetPosition") else _needed(element, "Position")
        return placed(_first(position), self._places, lambda name: self._named(name).pose)

    def step(self, time_s: float) -> bool:
        """Begin what its triggers let begin at a time, and move on by `TICK_S`; False at the stop trigger.

        Raises:
            UnknownMotion: the scenario does not decide what happens now, or it is not read.
        """
        self._time = time_s
        if self._is_on(self._stop, otherwise=False):
            return False
        for story in self._stories:
            self._advance(story)
        for mover in self.movers.values():
            if mover.there:
                mover.step(time_s + TICK_S)
        is_over = all(story.state == _COMPLETE for story in self._stories)
        self.over_s = min(self.over_s, time_s) if is_over else math.inf
        return True

    def _turn(self, part: Part, state: str, transition: str) -> None:
        part.state, part.changed = state, (transition, self._time)

    def _advance(self, part: Part) -> None:
        """Begin a part of the storyboard, what is below it, or end it."""
        is_event = part.element.tag == "Event"
        if is_event and part.state == _RUNNING:
            part.running = [one for one in part.running if getattr(one[0], one[1]) is one[2]]
            if not part.running:
                again = part.times < number(part.element, "maximumExecutionCount", "1")
                self._turn(part, _STANDBY if again else _COMPLETE, "endTransition")
        if part.state == _STANDBY and self._is_on(part.element.find("StartTrigger"), otherwise=True):
            if is_event:
                self._start(part)
            else:
                self._turn(part, _RUNNING, "startTransition")
        if is_event or part.state != _RUNNING:
            return
        if self._is_on(part.element.find("StopTrigger"), otherwise=False):
            for below in part.all():
                self._end(below)
            return
        for one in part.parts:
            self._advance(one)
        if all(one.state == _COMPLETE for one in part.parts):
            self._turn(part, _COMPLETE, "endTransition")

    def _start(self, event: Part) -> None:
        """Begin the actions of an event, by its priority over others of its maneuver."""
        assert event.above is not None and event.above.above is not None
        others = [one for one in event.above.parts if one is not event and one.state == _RUNNING]
        if event.element.get("priority") == "skip" and others:
            return
        for one in others if event.element.get("priority") in ("override", "overwrite") else ():
            self._end(one)
        self._turn(event, _RUNNING, "startTransition")
        event.times += 1
        actors = [self._mover(one) for one in event.above.above.element.iterfind("Actors/EntityRef")]
        for body in (one for action in event.element.findall("Action") for one in action):
            self._begin(body, actors, event.running)

    def _end(self, part: Part) -> None:
        if part.state == _COMPLETE:
            return
        for mover, domain, action in part.running:
            if getattr(mover, domain) is not action:
                continue
            if domain == "way":
                mover.put(mover.pose)
            else:
                setattr(mover, domain, None)
        part.running = []
        self._turn(part, _COMPLETE, "stopTransition")

    def _begin(self, action: Element, movers: list[Mover], running: list[tuple[Mover, str, Any]]) -> None:
        """Begin an action of some road users, or of the world."""
        body = action[0] if len(action) else action
        if body.tag == "EntityAction":
            mover, placed_at = self._mover(body), body.find("AddEntityAction")
            if placed_at is not None:
                mover.put(self._pose(placed_at))
            mover.there = placed_at is not None
        elif body.tag not in _STILL:
            if action.tag != "PrivateAction":
                raise UnknownMotion(f"{body.tag} decides from then on")
            inner = body[0] if body.tag in _GROUPS and len(body) else body
            for mover in movers:
                if (domain := self._begun(inner, mover)) and getattr(mover, domain) is not None:
                    running.append((mover, domain, getattr(mover, domain)))

    def _begun(self, action: Element, mover: Mover) -> str:
        """Begin an action of a road user; return what it changes until it is over: along, across or way."""
        kind = action.tag
        if kind == "TeleportAction":
            mover.put(self._pose(action))
        elif kind == "SpeedAction":
            return self._change_speed(action, mover)
        elif kind == "LongitudinalDistanceAction":
            mover.along = following(mover, action, self._mover(action))
            return "along"
        elif kind == "SynchronizeAction":
            final = action.find("FinalSpeed/AbsoluteSpeed")
            goal, masters = (
                self._pose(_needed(action, name)) for name in ("TargetPosition", "TargetPositionMaster")
            )
            final_mps = None if final is None else number(final, "value")
            mover.along = synchronising(
                mover, goal, self._mover(action, "masterEntityRef"), masters, final_mps
            )
            return "along"
        elif kind == "LaneChangeAction":
            return self._change_lane(action, mover)
        elif kind == "FollowTrajectoryAction":
            mover.way = trajectory(action, mover, self._time, self._pose)
            mover.arc, mover.left, mover.across = 0.0, 0.0, None
            return "way"
        elif kind in ("AssignRouteAction", "AcquirePositionAction"):
            goals = [self._pose(one) for one in [*action.iter("Waypoint")] or [action]]
            mover.roads = self._places.roads_of(goals)
            if mover.there:
                mover.put(mover.pose)
        elif kind in ("ActivateControllerAction", "AssignControllerAction"):
            is_on = any(action.get(name) == "true" for name in _SWITCHES)
            if is_on and (mover.entity.is_controlled or kind.startswith("Assign")):
                raise UnknownMotion(f"a controller drives {mover.entity.name} from then on")
        elif kind not in _STILL:
            raise UnknownMotion(f"{kind} of {mover.entity.name} is not read")
        return ""

    def _change_speed(self, action: Element, mover: Mover) -> str:
        target, dynamics = (
            _first(_needed(action, "SpeedActionTarget")),
            _needed(action, "SpeedActionDynamics"),
        )
        value, stays = number(target, "value"), target.get("continuous") == "true"
        other = self._mover(target) if target.tag == "RelativeTargetSpeed" else None

        def wanted() -> float:
            """Return the target speed now, m/s."""
            theirs = 0.0 if other is None else other.speed
            return theirs * value if target.get("speedTargetValueType") == "factor" else theirs + value

        fixed = wanted()
        mover.along = changing(mover, "speed", dynamics, wanted if stays else lambda: fixed, stays=stays)
        if dynamics.get("dynamicsShape", "step") == "step":
            mover.speed, mover.along = fixed, mover.along if stays else None
        return "along"

    def _change_lane(self, action: Element, mover: Mover) -> str:
        target, lane = _first(_needed(action, "LaneChangeTarget")), mover.way.lane_at(mover.arc)
        if target.tag == "AbsoluteTargetLane":
            goal = self._places.known((*lane[:2], int(number(target, "value"))))
        else:
            other = self._mover(target)
            theirs = other.way.lane_at(other.arc)
            leftwards = self._places.direction(theirs) * (-1 if other.way.against else 1)
            goal = self._places.beside((*lane[:2], theirs[2]), leftwards * int(number(target, "value")))
        here = mover.pose
        mover.put(Pose(x=here.x, y=here.y, heading=here.heading, lane=goal))
        leftwards = self._places.direction(goal) * (-1 if mover.way.against else 1)
        left = number(action, "targetLaneOffset", "0") * leftwards
        mover.across = changing(mover, "left", _needed(action, "LaneChangeActionDynamics"), lambda: left)
        return "across"

    def _is_on(self, trigger: Element | None, *, otherwise: bool) -> bool:
        """Return whether a trigger fires now; ``otherwise`` if there is none."""
        if trigger is None or not len(trigger):
            return otherwise
        groups = [[self._condition(one) for one in group.findall("Condition")] for group in trigger]
        if any(all(result is True for result in group) for group in groups):
            return True
        if unknown := [group for group in groups if False not in group]:
            kind = next(result for result in unknown[0] if isinstance(result, str))
            raise UnknownMotion(f"a trigger waits for a {kind}")
        return False

    def _condition(self, condition: Element) -> bool | str:
        """Return whether a condition is met; the kind of one that is not read."""
        body = _first(condition)
        now = self._by_entity(body) if body.tag == "ByEntityCondition" else self._by_value(_first(body))
        if isinstance(now, str):
            return now
        before, fires = self._fired.get(condition, (False, math.inf))
        edge, delay = _EDGES.get(condition.get("conditionEdge", "")), number(condition, "delay", "0")
        met = now if edge is None else edge(before, now)
        fires = min(fires, self._time + delay) if met else fires
        self._fired[condition] = now, fires
        return self._time >= fires - 1e-9 if delay > 0 else met

    def _by_value(self, one: Element) -> bool | str:
        if one.tag == "SimulationTimeCondition":
            return _RULES[one.get("rule", "greaterOrEqual")](self._time, number(one, "value"))
        if one.tag != "StoryboardElementStateCondition":
            return one.tag
        name = one.get("storyboardElementRef", "").replace("::", "/").rpartition("/")[2]
        kind, wanted = one.get("storyboardElementType", ""), one.get("state", "")
        parts = [part for part in self._all if part.element.tag.lower() == kind.lower()]
        parts = [part for part in parts if part.element.get("name") == name]
        if kind.lower() == "action":
            parts = [
                part
                for part in self._all
                if any(x.get("name") == name for x in part.element.findall("Action"))
            ]
        if not parts:
            raise ValueError(f"{kind[:20]} {name[:40]!r} is not in its storyboard")
        if wanted.endswith("Transition"):
            return any(x.changed[0] == wanted and self._time - x.changed[1] < 1.5 * TICK_S for x in parts)
        return any(part.state == wanted for part in parts)

    def _by_entity(self, body: Element) -> bool | str:
        rule, condition = _needed(body, "TriggeringEntities"), _first(_needed(body, "EntityCondition"))
        movers = [mover for one in rule.findall("EntityRef") if (mover := self._mover(one)).there]
        measured = [self._measured(condition, mover) for mover in movers]
        if unknown := next((result for result in measured if isinstance(result, str)), None):
            return unknown
        how, value = _RULES[condition.get("rule", "greaterThan")], number(condition, "value", "0")
        if condition.tag == "ReachPositionCondition":
            how, value = _RULES["lessOrEqual"], number(condition, "tolerance")
        results = [how(one, value) for one in measured if not isinstance(one, str)]
        return bool(results) and (all if rule.get("triggeringEntitiesRule") == "all" else any)(results)

    def _measured(self, one: Element, mover: Mover) -> float | str:
        """Return the value of a road user that a condition compares; its kind if it is not read."""
        if one.tag == "SpeedCondition":
            return mover.speed
        if one.tag == "RelativeSpeedCondition":
            return mover.speed - self._mover(one).speed
        if one.tag == "TraveledDistanceCondition":
            return mover.travelled + 1e-9
        if one.tag == "ReachPositionCondition":
            return math.hypot(*mover.pose.seen(self._pose(one)))
        by_time = one.tag in ("TimeHeadwayCondition", "TimeToCollisionCondition")
        if not by_time and one.tag not in ("DistanceCondition", "RelativeDistanceCondition"):
            return one.tag
        named = one if one.get("entityRef") else one.find(".//EntityRef")
        other = None if named is None else self._mover(named)
        goal = (
            other.pose
            if other is not None
            else self._pose(one if one.find("Position") is not None else _first(one))
        )
        apart = self._apart(one, mover, goal, other)
        if not by_time:
            return apart
        closing = mover.speed
        if one.tag == "TimeToCollisionCondition" and other is not None:
            closing -= other.speed
        is_ahead = mover.pose.seen(goal)[0] > 0
        return apart / closing if closing > 1e-6 and is_ahead else math.nan

    def _apart(self, one: Element, mover: Mover, goal: Pose, other: Mover | None) -> float:
        """Return the distance that a condition means, m."""
        free = other if one.get("freespace") == "true" else None
        kind, system = one.get("relativeDistanceType", ""), one.get("coordinateSystem", "entity")
        by_road = one.get("alongRoute") == "true" or system in ("road", "lane", "trajectory")
        dx, dy = mover.pose.seen(goal)
        if kind == "lateral":
            apart, sizes = abs(dy), free and (mover.entity.width + free.entity.width) / 2
        elif by_road or kind == "longitudinal" or one.tag == "TimeHeadwayCondition":
            apart = abs(mover.ahead(goal) if by_road else dx)
            sizes = free and (mover.entity.length + free.entity.length) / 2
        elif free is not None:
            return float(rectangle_distance(_box(mover), _box(free))[0])
        else:
            return math.hypot(dx, dy)
        return max(apart - (sizes or 0.0), 0.0)


def _box(mover: Mover) -> Rectangles:
    at, size = mover.centre, mover.entity
    names = ("x", "y", "heading", "half_length", "half_width")
    values = (at.x, at.y, at.heading, size.length / 2, size.width / 2)
    return Rectangles(**{name: np.array([value]) for name, value in zip(names, values, strict=True)})


def _needed(element: Element, name: str) -> Element:
    found = element.find(name)
    if found is None:
        raise ValueError(f"a {element.tag} has no {name}")
    return found


def _first(element: Element) -> Element:
    if not len(element):
        raise ValueError(f"a {element.tag} is empty")
    return element[0]
