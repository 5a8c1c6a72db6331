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
    Change,
    Following,
    Mover,
    Synchronised,
    trajectory_of,
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
_APART = (
    "DistanceCondition",
    "RelativeDistanceCondition",
    "TimeHeadwayCondition",
    "TimeToCollisionCondition",
)
_PARTS = {"Story": "Act", "Act": "ManeuverGroup", "ManeuverGroup": "Maneuver", "Maneuver": "Event"}
_STANDBY, _RUNNING, _COMPLETE = "standbyState", "runningState", "completeState"


@dataclass(eq=False)
class Part:
    """Element of the storyboard and its state; an event's actions are ``running`` until they are over."""

    element: Element
    above: Part | None
    parts: list[Part] = field(default_factory=list)
    state: str = _STANDBY
    changed: tuple[str, float] = ("", -1.0)
    times: int = 0
    running: list[tuple[Mover, str, Any]] = field(default_factory=list)

    def all(self) -> Iterator[Part]:
        """Yield it and all below."""
        yield self
        for part in self.parts:
            yield from part.all()


def _part(element: Element, above: Part | None) -> Part:
    part = Part(element, above)
    part.parts = [_part(one, part) for one in element.findall(_PARTS.get(element.tag, "Nothing"))]
    return part


class Storyboard:
    """Motion of a scenario from its initial actions on.

    Attributes:
        movers: road users by name.
        over_s: time at which all stories were complete, s; infinite until then.
    """

    def __init__(self, root: Element, entities: Mapping[str, Entity], places: Places) -> None:
        board = _needed(root, "Storyboard")
        self.movers = {name: Mover(entity, places) for name, entity in entities.items()}
        self._places, self._time, self.over_s = places, 0.0, math.inf
        self._fired: dict[Element, tuple[bool, float]] = {}
        self._stop = board.find("StopTrigger")
        for private in board.iterfind("Init/Actions/Private"):
            for action in private:
                self._begin(action, [self._mover(private)], None)
        for action in board.iterfind("Init/Actions/GlobalAction"):
            self._begin(action, [], None)
        self._stories = [_part(story, None) for story in board.findall("Story")]
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
        if part.element.tag == "Event":
            self._advance_event(part)
            return
        if part.state == _STANDBY and self._is_on(part.element.find("StartTrigger"), otherwise=True):
            self._turn(part, _RUNNING, "startTransition")
        if part.state != _RUNNING:
            return
        if self._is_on(part.element.find("StopTrigger"), otherwise=False):
            for below in part.all():
                self._end(below)
            return
        for one in part.parts:
            self._advance(one)
        if all(one.state == _COMPLETE for one in part.parts):
            self._turn(part, _COMPLETE, "endTransition")

    def _advance_event(self, event: Part) -> None:
        if event.state == _RUNNING:
            event.running = [one for one in event.running if getattr(one[0], one[1]) is one[2]]
            if not event.running:
                again = event.times < number(event.element, "maximumExecutionCount", "1")
                self._turn(event, _STANDBY if again else _COMPLETE, "endTransition")
        maneuver = event.above
        if (
            event.state != _STANDBY
            or not maneuver
            or not self._is_on(event.element.find("StartTrigger"), otherwise=True)
        ):
            return
        others = [one for one in maneuver.parts if one is not event and one.state == _RUNNING]
        if event.element.get("priority") == "skip" and others:
            return
        for one in others if event.element.get("priority") in ("override", "overwrite") else ():
            self._end(one)
        self._turn(event, _RUNNING, "startTransition")
        event.times += 1
        group = maneuver.above.element if maneuver.above is not None else event.element
        actors = [self._mover(one) for one in group.iterfind("Actors/EntityRef")]
        for body in (one for action in event.element.findall("Action") for one in action):
            self._begin(body, actors, event)

    def _end(self, part: Part) -> None:
        if part.state == _COMPLETE:
            return
        for mover, domain, action in part.running:
            if getattr(mover, domain) is action:
                setattr(mover, domain, None)
        part.running = []
        self._turn(part, _COMPLETE, "stopTransition")

    def _begin(self, action: Element, movers: list[Mover], event: Part | None) -> None:
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
                domain, made = self._made(inner, mover)
                if domain:
                    setattr(mover, domain, made)
                if domain and event is not None:
                    event.running.append((mover, domain, made))

    def _made(self, action: Element, mover: Mover) -> tuple[str, Any]:
        """Return what an action of a road user begins: along, across or on a path; else it is over."""
        kind = action.tag
        if kind == "TeleportAction":
            mover.put(self._pose(action))
        elif kind == "SpeedAction":
            return self._speed_change(action, mover)
        elif kind == "LongitudinalDistanceAction":
            return "along", Following(action, self._mover(action))
        elif kind == "SynchronizeAction":
            final = action.find("FinalSpeed/AbsoluteSpeed")
            goals = [self._pose(_needed(action, name)) for name in ("TargetPosition", "TargetPositionMaster")]
            final_mps = None if final is None else number(final, "value")
            return "along", Synchronised(
                goals[0], self._mover(action, "masterEntityRef"), goals[1], final_mps
            )
        elif kind == "LaneChangeAction":
            return "across", self._lane_change(action, mover)
        elif kind == "FollowTrajectoryAction":
            return "path", trajectory_of(action, self._time, self._pose)
        elif kind in ("AssignRouteAction", "AcquirePositionAction"):
            goals = [self._pose(one) for one in [*action.iter("Waypoint")] or [action]]
            lanes = [self._places.lane_of(goal) for goal in goals]
            mover.roads = [lane[0] for lane in lanes if lane is not None]
            mover.put(mover.pose)
        elif kind in ("ActivateControllerAction", "AssignControllerAction"):
            is_on = any(action.get(name) == "true" for name in _SWITCHES)
            if is_on and (mover.entity.is_controlled or kind.startswith("Assign")):
                raise UnknownMotion(f"a controller drives {mover.entity.name} from then on")
        elif kind not in _STILL:
            raise UnknownMotion(f"{kind} of {mover.entity.name} is not read")
        return "", None

    def _speed_change(self, action: Element, mover: Mover) -> tuple[str, Any]:
        target = _first(_needed(action, "SpeedActionTarget"))
        value, stays = number(target, "value"), target.get("continuous") == "true"
        other = self._mover(target) if target.tag == "RelativeTargetSpeed" else None
        is_factor = target.get("speedTargetValueType") == "factor"

        def wanted() -> float:
            """Return the target speed now, m/s."""
            added = 0.0 if other is None else other.speed
            return added * value if is_factor else added + value

        fixed = wanted()
        wanted_now = wanted if stays else lambda: fixed
        change = Change("speed", _needed(action, "SpeedActionDynamics"), wanted_now, stays=stays)
        if change.is_step and not stays:
            mover.speed = fixed
            return "", None
        return "along", change

    def _lane_change(self, action: Element, mover: Mover) -> Change:
        if mover.way is None:
            raise UnknownMotion(f"{mover.entity.name} is on no lane for its {action.tag}")
        target, lane = _first(_needed(action, "LaneChangeTarget")), mover.way.lane_at(mover.arc)
        if target.tag == "AbsoluteTargetLane":
            goal = self._places.known((*lane[:2], int(number(target, "value"))))
        else:
            other = self._mover(target)
            theirs, against = (
                (lane, mover.way.against)
                if other.way is None
                else (other.way.lane_at(other.arc), other.way.against)
            )
            leftwards = -self._places.direction(theirs) if against else self._places.direction(theirs)
            goal = self._places.beside((*lane[:2], theirs[2]), leftwards * int(number(target, "value")))
        here = mover.pose
        mover.put(Pose(x=here.x, y=here.y, heading=here.heading, lane=goal))
        left = (
            number(action, "targetLaneOffset", "0")
            * self._places.direction(goal)
            * (-1 if mover.way.against else 1)
        )
        return Change("left", _needed(action, "LaneChangeActionDynamics"), lambda: left)

    def _is_on(self, trigger: Element | None, *, otherwise: bool) -> bool:
        """Return whether a trigger fires now; ``otherwise`` if there is none."""
        if trigger is None or not len(trigger):
            return otherwise
        unknown = None
        for group in trigger.findall("ConditionGroup"):
            results = [self._condition(one) for one in group.findall("Condition")]
            if all(result is True for result in results):
                return True
            if not any(result is False for result in results):
                unknown = next(result for result in results if isinstance(result, str))
        if unknown is not None:
            raise UnknownMotion(f"a trigger waits for a {unknown}")
        return False

    def _condition(self, condition: Element) -> bool | str:
        """Return whether a condition is met; the kind of one that is not read."""
        body = _first(condition)
        now = self._by_entity(body) if body.tag == "ByEntityCondition" else self._by_value(_first(body))
        if isinstance(now, str):
            return now
        before, fires = self._fired.get(condition, (False, math.inf))
        edges = {
            "rising": now and not before,
            "falling": before and not now,
            "risingOrFalling": now != before,
        }
        met, delay = edges.get(condition.get("conditionEdge", ""), now), number(condition, "delay", "0")
        fires = min(fires, self._time + delay) if met else fires
        self._fired[condition] = now, fires
        return self._time >= fires - 1e-9 if delay > 0 else met

    def _by_value(self, one: Element) -> bool | str:
        if one.tag == "SimulationTimeCondition":
            return _RULES[one.get("rule", "greaterOrEqual")](self._time, number(one, "value"))
        if one.tag != "StoryboardElementStateCondition":
            return one.tag
        name = one.get("storyboardElementRef", "").replace("::", "/").rpartition("/")[2]
        kind, wanted = one.get("storyboardElementType", "").lower(), one.get("state", "")
        parts = [
            part
            for part in self._all
            if part.element.tag.lower() == kind and part.element.get("name") == name
        ]
        if kind == "action":
            parts = [
                part
                for part in self._all
                if any(x.get("name") == name for x in part.element.findall("Action"))
            ]
        if not parts:
            raise ValueError(f"{kind[:20]} {name[:40]!r} is not in its storyboard")
        if wanted.endswith("Transition"):
            return any(
                part.changed[0] == wanted and self._time - part.changed[1] < 1.5 * TICK_S for part in parts
            )
        return any(part.state == wanted for part in parts)

    def _by_entity(self, body: Element) -> bool | str:
        rule, condition = _needed(body, "TriggeringEntities"), _first(_needed(body, "EntityCondition"))
        movers = [mover for one in rule.findall("EntityRef") if (mover := self._mover(one)).there]
        results = [self._holds(condition, mover) for mover in movers]
        if unknown := next((result for result in results if isinstance(result, str)), None):
            return unknown
        return bool(results) and (all if rule.get("triggeringEntitiesRule") == "all" else any)(results)

    def _holds(self, one: Element, mover: Mover) -> bool | str:
        """Return whether a condition holds for a road user; its kind if it is not read."""
        rule, value = _RULES[one.get("rule", "greaterThan")], number(one, "value", "0")
        if one.tag == "SpeedCondition":
            return rule(mover.speed, value)
        if one.tag == "RelativeSpeedCondition":
            return rule(mover.speed - self._mover(one).speed, value)
        if one.tag == "TraveledDistanceCondition":
            return mover.travelled >= value
        if one.tag == "ReachPositionCondition":
            return math.hypot(*mover.pose.seen(self._pose(one))) <= number(one, "tolerance")
        if one.tag not in _APART:
            return one.tag
        named = one if one.get("entityRef") else one.find(".//EntityRef")
        other = None if named is None else self._mover(named)
        goal = (
            self._pose(_first(one) if one.find("Position") is None else one) if other is None else other.pose
        )
        apart = self._apart(one, mover, goal, other)
        if one.tag.endswith("DistanceCondition"):
            return rule(apart, value)
        by_time = one.tag == "TimeHeadwayCondition"
        closing = mover.speed if by_time or other is None else mover.speed - other.speed
        return closing > 1e-6 and rule(apart / closing, value)

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
    values = (at.x, at.y, at.heading, size.length / 2, size.width / 2)
    x, y, heading, half_length, half_width = (np.array([value]) for value in values)
    return Rectangles(x=x, y=y, heading=heading, half_length=half_length, half_width=half_width)


def _needed(element: Element, name: str) -> Element:
    found = element.find(name)
    if found is None:
        raise ValueError(f"a {element.tag} has no {name}")
    return found


def _first(element: Element) -> Element:
    if not len(element):
        raise ValueError(f"a {element.tag} is empty")
    return element[0]
