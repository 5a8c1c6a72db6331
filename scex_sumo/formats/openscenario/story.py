"""Storyboard: which actions begin when, by triggers on the scenario's own motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias
from xml.etree.ElementTree import Element

from scex_sumo.formats.opendrive.roads import number
from scex_sumo.formats.opendrive.ways import Places, Pose
from scex_sumo.formats.openscenario import motion
from scex_sumo.formats.openscenario.motion import Action, Mover, Target, UnknownMotion, chosen
from scex_sumo.geometry.rectangles import rectangle_distance

_TICKS, _TICKS_PER_S = 50, 1000  # of a step; at 50 m/s, what begins a tick late is 5 cm off
_RULES: Mapping[str, Callable[[float, float], bool]] = {
    "greaterThan": lambda a, b: a > b,
    "lessThan": lambda a, b: a < b,
    "equalTo": lambda a, b: abs(a - b) < 1e-6,
    "greaterOrEqual": lambda a, b: a >= b - 1e-9,
    "lessOrEqual": lambda a, b: a <= b + 1e-9,
    "notEqualTo": lambda a, b: abs(a - b) >= 1e-6,
}
_Sides: TypeAlias = tuple[tuple[bool, bool], ...]  # above its value; its place is ahead: of each road user
_GROUPS = ("LongitudinalAction", "LateralAction", "RoutingAction", "ControllerAction")
_STILL = (  # actions without a part in the motion
    *("VisibilityAction", "EnvironmentAction", "AppearanceAction", "LightStateAction", "AnimationAction"),
    *("ParameterAction", "VariableAction", "InfrastructureAction", "SetMonitorAction"),
)
_SWITCHES = ("longitudinal", "lateral", "activateLongitudinal", "activateLateral")
_CONDITIONS = (
    *("SimulationTimeCondition", "StoryboardElementStateCondition", "SpeedCondition"),
    *("RelativeSpeedCondition", "TraveledDistanceCondition", "ReachPositionCondition", "DistanceCondition"),
    *("RelativeDistanceCondition", "TimeHeadwayCondition", "TimeToCollisionCondition", "CollisionCondition"),
)


class Event:
    """Event ``within`` its maneuver, group, act and story; it goes on until its actions are over."""

    def __init__(self, *within: Element) -> None:
        self.within = within
        self.element, self.maneuver, self.group, self.act, _ = within
        self.began_s = self.ended_s = math.inf
        self.ending = ""  # ``end`` or ``stop``, once it is over
        self.times_left = number(self.element, "maximumExecutionCount", "1")
        self.running: tuple[tuple[Mover, Action | None], ...] = ()

    def end(self, time_s: float, ending: str = "stop") -> None:
        """End it, and those of its actions that go on."""
        for mover, action in self.running:
            mover.end(action)
        self.ended_s, self.ending = time_s, ending


class Storyboard:
    """Motion, until ``time_s``, of a scenario's ``movers`` by name, in the ``events`` of all its stories."""

    def __init__(self, root: Element, places: Places) -> None:
        board, self._places = _needed(root, "Storyboard"), places
        self.time_s, self._last_s, self._ticks = 0.0, 0.0, 0
        entities = root.iterfind("Entities/ScenarioObject")
        self.movers = {element.get("name", ""): Mover(element, places) for element in entities}
        self._stop, self._is_settled = board.find("StopTrigger"), False
        self._unknown: UnknownMotion | None = None  # from the first moment on
        first = board.iterfind("Init/Actions/*")  # those that name another one come after it
        for element in sorted(first, key=lambda element: element.find(".//*[@entityRef]") is not None):
            movers = [self._mover(element)] if element.tag == "Private" else []
            for action in element if movers else [element]:
                try:
                    self._begin(action, movers)
                except UnknownMotion as why:
                    if action.find("TeleportAction") is not None:
                        raise
                    self._unknown = self._unknown or why
        self.events = [
            Event(event, maneuver, group, act, story)
            for story in board.iterfind("Story")
            for act in story.iterfind("Act")
            for group in act.iterfind("ManeuverGroup")
            for maneuver in group.iterfind("Maneuver")
            for event in maneuver.iterfind("Event")
        ]
        # What triggers change, by conditions and by acts; replaced, never changed, to go back in time.
        self._fired: Mapping[Element, tuple[bool, float, _Sides]] = {}
        self._begun: Mapping[Element, float] = {}

    def go_on(self) -> None:
        """Move on by a step, in ticks if a condition changes within it, or something begins or ends.

        Raises:
            UnknownMotion: the scenario does not decide what happens now; without words at its stop trigger.
        """
        if self._unknown is not None:
            raise self._unknown
        if not self._is_settled:
            self._trigger()
        things = [vars(thing) for thing in (self, *self.events, *self.movers.values())]
        saved, before = [{**thing} for thing in things], self._changes()
        self._move(_TICKS)
        try:
            self._trigger()
            is_quiet = self._changes() == before
        except UnknownMotion:
            is_quiet = False
        if not is_quiet:
            for thing, earlier in zip(things, saved, strict=True):
                thing.update(earlier)
            for tick in range(_TICKS):
                if tick:
                    self._trigger()
                self._move(1)
        self._is_settled = is_quiet  # else something may begin now

    def _changes(self) -> tuple[object, ...]:
        events = [(event.began_s, event.ended_s) for event in self.events]
        return self._fired, self._begun, events, [mover.actions for mover in self.movers.values()]

    def _move(self, ticks: int) -> None:
        self._ticks += ticks
        self._last_s, self.time_s = self.time_s, self._ticks / _TICKS_PER_S
        for mover in self.movers.values():
            mover.act(self.time_s, ticks / _TICKS_PER_S)
        for mover in self.movers.values():
            mover.move(ticks / _TICKS_PER_S)

    def _trigger(self) -> None:
        if self._is_on(self._stop, otherwise=False):
            raise UnknownMotion
        for act in dict.fromkeys(event.act for event in self.events if event.ended_s > self.time_s):
            if act not in self._begun and self._is_on(act.find("StartTrigger"), otherwise=True):
                self._begun = {**self._begun, act: self.time_s}
            if act in self._begun:
                self._advance(act, [event for event in self.events if event.act is act])

    def _advance(self, act: Element, events: Sequence[Event]) -> None:
        """End those events of an act that are over, and begin those whose time has come."""
        now, is_stopped = self.time_s, self._is_on(act.find("StopTrigger"), otherwise=False)
        for event in (event for event in events if event.ended_s > now):
            goes_on = any(action in mover.actions.values() for mover, action in event.running)
            is_over, priority = event.began_s <= now and not goes_on, event.element.get("priority")
            if is_stopped or (is_over and event.times_left < 1):
                event.end(now, "end" if is_over else "stop")
                continue
            event.began_s = math.inf if is_over else event.began_s
            if event.began_s <= now or not self._is_on(event.element.find("StartTrigger"), otherwise=True):
                continue
            others = [other for other in events if other.maneuver is event.maneuver]
            others = [other for other in others if other.began_s <= now < other.ended_s]
            for other in others if priority in ("override", "overwrite") else ():
                other.end(now)
            if priority != "skip" or not others:
                event.began_s, event.times_left = now, event.times_left - 1
                actors = [self._mover(x) for x in event.group.iterfind("Actors/EntityRef")]
                actions = event.element.iterfind("Action/*")
                event.running = tuple(begun for action in actions for begun in self._begin(action, actors))

    def _begin(self, action: Element, movers: Sequence[Mover]) -> list[tuple[Mover, Action | None]]:
        """Begin an action of some road users, or of the world."""
        body = next((inner for inner in action.iterfind(".//*") if inner.tag not in _GROUPS), action)
        if body.tag in _STILL:
            return []
        if body.tag == "EntityAction":
            movers = [self._mover(body)]
        elif action.tag != "PrivateAction":
            raise UnknownMotion(f"{body.tag} decides from then on")
        return [(mover, self._begin_of(mover, body)) for mover in movers]

    def _begin_of(self, mover: Mover, action: Element) -> Action | None:
        """Begin an action of a road user; return it if it goes on."""
        match action.tag:
            case "EntityAction":
                added = action.find("AddEntityAction")
                if added is not None:
                    mover.put(self._pose(added))
                mover.there = added is not None
            case "TeleportAction":
                mover.put(self._pose(action))
            case "SpeedAction":
                target, how = _needed(action, "SpeedActionTarget/*"), _needed(action, "SpeedActionDynamics")
                other = self._mover(target) if target.tag == "RelativeTargetSpeed" else mover
                wanted, stays = _wanted(target, mover, other), target.get("continuous") == "true"
                return mover.begin("along", motion.changing, "speed", how, wanted, stays)
            case "LongitudinalDistanceAction":
                return mover.begin("along", motion.following, action, self._mover(action))
            case "SynchronizeAction":
                master, final = self._mover(action, "masterEntityRef"), action.find("FinalSpeed/*")
                goal, masters = (self._pose(action, f"TargetPosition{whose}") for whose in ("", "Master"))
                then = None if final is None else _wanted(final, mover, master)
                return mover.begin("along", motion.synchronising, goal, master, masters, then)
            case "LaneChangeAction":
                return self._change_lane(mover, action)
            case "FollowTrajectoryAction":
                path = motion.trajectory(action, mover, self.time_s, self._pose)
                return mover.begin("across", motion.driving, path)
            case "AssignRouteAction" | "AcquirePositionAction":
                goals = [self._pose(waypoint) for waypoint in [*action.iter("Waypoint")] or [action]]
                mover.roads = self._places.roads_of(goals)
                if mover.there:
                    mover.put(mover.pose)
            case "ActivateControllerAction" | "AssignControllerAction":
                is_on = any(action.get(name) == "true" for name in _SWITCHES)
                if is_on and (mover.is_controlled or action.tag.startswith("Assign")):
                    raise UnknownMotion(f"a controller drives {mover.name} from then on")
            case _:
                raise UnknownMotion(f"{action.tag} of {mover.name} is not read")
        return None

    def _change_lane(self, mover: Mover, action: Element) -> Action:
        target = _needed(action, "LaneChangeTarget/*")
        is_absolute, value = target.tag == "AbsoluteTargetLane", int(number(target, "value"))
        other = mover if is_absolute else self._mover(target)
        own, theirs = self._places.lane_of(mover.pose), self._places.lane_of(other.pose)
        if own is None or theirs is None:
            raise UnknownMotion("a road user on no lane changes lanes")
        near = *own[:2], value if is_absolute else theirs[2], theirs[3]
        goal = self._places.known(near, 0 if is_absolute else value)
        left = number(action, "targetLaneOffset", "0") * own[3]
        dynamics = _needed(action, "LaneChangeActionDynamics")
        mover.put(mover.pose._replace(lane=goal[:3]))
        return mover.begin("across", motion.changing, "left", dynamics, lambda: left)

    def _mover(self, element: Element, key: str = "entityRef") -> Mover:
        name = element.get(key, "")
        if name not in self.movers:
            raise ValueError(f"entity {name[:40]!r} is not there")
        return self.movers[name]

    def _pose(self, element: Element, holder: str = "Position") -> Pose:
        """Return the pose of a position; a lane's is headed as it is driven."""
        position = _needed(element, f".//{holder}/*")
        turned, places = position.find("Orientation"), self._places
        match position.tag:
            case "WorldPosition":
                return Pose(number(position, "x"), number(position, "y"), number(position, "h", "0"))
            case "LanePosition" | "RoadPosition" as kind:
                lane = int(number(position, "laneId")) if kind == "LanePosition" else None
                beside = number(position, "t" if lane is None else "offset", "0")
                pose = places.at_station(position.get("roadId", ""), number(position, "s"), beside, lane)
                if pose.lane is not None and places.driven(pose.lane, 1)[3] < 0:
                    pose = pose.turned(math.pi)
            case "RelativeObjectPosition":
                pose = self._mover(position).pose.moved(*(number(position, k, "0") for k in ("dx", "dy")))
            case "RelativeLanePosition":
                pose = self._beside(position, self._mover(position).pose)
            case "RoutePosition" if position.find(".//Waypoint/Position/*") is not None:
                goals = [self._pose(waypoint) for waypoint in position.iter("Waypoint")]
                path = places.way(goals[0], places.roads_of(goals))
                coordinates = next((inner for inner in position.iter() if inner.get("pathS")), position)
                pose = path.at(path.project(goals[0])[0] + number(coordinates, "pathS"))
            case kind:
                raise UnknownMotion(f"{kind} is not read")
        if turned is not None:
            relative = pose.heading if turned.get("type") == "relative" else 0.0
            pose = pose._replace(heading=relative + number(turned, "h", "0"))
        return pose

    def _beside(self, position: Element, own: Pose) -> Pose:
        lane, ds = self._places.lane_of(own), number(position, "ds", position.get("dsLane", "0"))
        if lane is None:
            raise ValueError(f"{position.get('entityRef')} is on no lane")
        goal = self._places.known((*lane[:3], 1), int(number(position, "dLane")))
        back = math.pi if lane[3] * ds < 0 else 0.0
        path = self._places.way(own.turned(back)._replace(lane=goal[:3]))
        left = number(position, "offset", "0") * lane[3] * (-1 if back else 1)
        return path.at(path.project(own)[0] + abs(ds), left).turned(back)

    def _is_on(self, trigger: Element | None, *, otherwise: bool) -> bool:
        """Return whether a trigger fires now; ``otherwise`` if there is none."""
        if trigger is None or not len(trigger):
            return otherwise
        groups = [[*map(self._condition, group.findall("Condition"))] for group in trigger]
        unmet = [[result for result in group if result is not True] for group in groups if False not in group]
        if unmet and all(unmet):
            raise UnknownMotion(f"a trigger waits for a {unmet[0][0]}")
        return bool(unmet)

    def _condition(self, condition: Element) -> bool | str:
        """Return whether a condition is met; the kind of one that is not read."""
        criterion, *_ = *condition.iterfind("*/EntityCondition/*"), *condition.iterfind("*/*"), condition
        if criterion.tag not in _CONDITIONS or criterion.find("ByType") is not None:
            ahead = [self._mover(x).there for x in condition.iter("EntityRef")]
            return criterion.tag if criterion.tag != "EndOfRoadCondition" or not all(ahead) else False
        is_state = criterion.tag.startswith("Story")
        now, sides = (self._by_state(criterion), ()) if is_state else self._holds(criterion, condition)
        delay = number(condition, "delay", "0")
        before, fires, _ = self._fired.get(condition, (now, math.inf, ()))  # without an edge at first
        edges = {"rising": now > before, "falling": now < before, "risingOrFalling": now != before}
        met = chosen(condition, "conditionEdge", "none", {"none": now, **edges})
        fires = min(fires, self.time_s + delay) if met else fires
        self._fired = {**self._fired, condition: (now, fires, sides)}
        return self.time_s >= fires - 1e-9 if delay > 0 else met

    def _by_state(self, criterion: Element) -> bool:
        kind, wanted = criterion.get("storyboardElementType", "").lower(), criterion.get("state", "")
        name = criterion.get("storyboardElementRef", "").replace("::", "/").rpartition("/")[2]
        now, elements = self.time_s, dict[Element, list[Event]]()  # of that kind and name, with their events
        for event in self.events:
            for element in (*event.within, *event.element.iterfind("Action")):
                if element.tag.lower() == kind and element.get("name") == name:
                    elements.setdefault(element, []).append(event)
        if not elements:
            raise ValueError(f"{kind[:20]} {name[:40]!r} is not in its storyboard")
        for events in elements.values():
            acts = [self._begun.get(event.act, math.inf) for event in events]
            began = min([event.began_s for event in events] if kind in ("event", "action") else acts)
            last = max(events, key=lambda event: event.ended_s)
            began, ended = 0.0 if kind == "story" else began, last.ended_s
            state = "complete" if ended <= now else "running" if began <= now else "standby"
            changed = {"start": began, last.ending: ended}.get(wanted.removesuffix("Transition"), math.inf)
            if wanted == f"{state}State" or self._last_s <= changed <= now:
                return True
        return False

    def _holds(self, criterion: Element, condition: Element) -> tuple[bool, _Sides]:
        """Return whether what a condition measures is as it says now, and on which sides it is.

        One that is met for less than a step, as near a place, is on another side after it.
        """
        how = chosen(criterion, "rule", "greaterThan", _RULES)
        if criterion.tag == "SimulationTimeCondition":
            limit = number(criterion, "value")
            return how(self.time_s, limit), ((self.time_s > limit, False),)
        limit, is_hit = number(criterion, "value", "0"), criterion.tag == "CollisionCondition"
        if criterion.tag == "ReachPositionCondition" or is_hit:
            how, limit = _RULES["lessOrEqual"], 0.0 if is_hit else number(criterion, "tolerance")
        entities = _needed(condition, ".//TriggeringEntities")
        movers = [self._mover(x) for x in entities.iterfind("EntityRef")]
        measured = [self._measured(criterion, mover) for mover in movers if mover.there]
        results = [how(value, limit) for value, _ in measured]
        is_met = (all if entities.get("triggeringEntitiesRule") == "all" else any)(results)
        return bool(results) and is_met, tuple((value > limit, is_ahead) for value, is_ahead in measured)

    def _measured(self, criterion: Element, mover: Mover) -> tuple[float, bool]:
        """Return what a condition measures of a road user, and whether its place is ahead."""
        named = criterion if criterion.get("entityRef") else criterion.find(".//EntityRef")
        other = None if named is None else self._mover(named)
        match criterion.tag:
            case "SpeedCondition":
                return mover.speed, False
            case "TraveledDistanceCondition":
                return mover.travelled, False
            case "RelativeSpeedCondition":
                return mover.speed - self._mover(criterion).speed, False
            case "ReachPositionCondition":
                return mover.passed(self._pose(criterion)), False
        goal = self._pose(criterion) if other is None else other.pose
        is_ahead = mover.pose.seen(goal)[0] > 0
        is_free = criterion.get("freespace") == "true" or criterion.tag == "CollisionCondition"
        apart = self._apart(criterion, mover, goal, other if is_free else None)
        if not criterion.tag.startswith("Time"):
            return apart, is_ahead
        theirs = 0.0 if other is None or criterion.tag == "TimeHeadwayCondition" else other.speed
        closing = mover.speed - theirs
        return apart / closing if closing > 1e-6 and is_ahead else math.nan, is_ahead

    def _apart(self, criterion: Element, mover: Mover, goal: Pose, free: Mover | None) -> float:
        """Return the distance that a condition means, m; between the boxes if another one is given."""
        kind, system = criterion.get("relativeDistanceType", ""), criterion.get("coordinateSystem", "entity")
        by_road = criterion.get("alongRoute") == "true" or system in ("road", "lane", "trajectory")
        dx, dy = mover.pose.seen(goal)
        if kind == "lateral":
            return max(abs(dy) - ((mover.width + free.width) / 2 if free else 0.0), 0.0)
        if by_road or kind == "longitudinal" or criterion.tag == "TimeHeadwayCondition":
            apart = abs(mover.ahead(goal) if by_road else dx)
            return max(apart - ((mover.length + free.length) / 2 if free else 0.0), 0.0)
        if free is None:
            return math.hypot(dx, dy)
        is_known = math.isfinite(mover.length + mover.width + free.length + free.width)
        return float(rectangle_distance(mover.box, free.box)) if is_known else math.nan


def _needed(element: Element, path: str) -> Element:
    child = element.find(path)
    if child is None:
        raise ValueError(f"a {element.tag} has no {path.lstrip('./').replace('*', 'content')}")
    return child


def _wanted(target: Element, mover: Mover, other: Mover) -> Target:
    """Return what says a target speed now, m/s: its own, or one by another road user's."""
    value, is_factor = number(target, "value"), target.get("speedTargetValueType") == "factor"

    def wanted() -> float:
        other.act(mover.time_s, mover.time_s - other.time_s)  # unless it has, in this step
        return other.speed * value if is_factor else other.speed + value

    return wanted if target.tag.startswith("Relative") else lambda: value
