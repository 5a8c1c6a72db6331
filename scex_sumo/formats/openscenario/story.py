"""Storyboard: which actions begin when, by triggers on the scenario's own motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from xml.etree.ElementTree import Element

from scex_sumo.formats.opendrive.reference import number
from scex_sumo.formats.opendrive.ways import Places, Pose
from scex_sumo.formats.openscenario import motion
from scex_sumo.formats.openscenario.motion import Action, Mover, UnknownMotion

_RULES: Mapping[str, Callable[[float, float], bool]] = {
    "greaterThan": lambda a, b: a > b,
    "lessThan": lambda a, b: a < b,
    "equalTo": lambda a, b: abs(a - b) < 1e-6,
    "greaterOrEqual": lambda a, b: a >= b - 1e-9,
    "lessOrEqual": lambda a, b: a <= b + 1e-9,
    "notEqualTo": lambda a, b: abs(a - b) >= 1e-6,
}
_STILL = (  # actions without a part in the motion
    *("VisibilityAction", "EnvironmentAction", "AppearanceAction", "LightStateAction", "AnimationAction"),
    *("ParameterAction", "VariableAction", "InfrastructureAction", "SetMonitorAction"),
)
_GROUPS = ("LongitudinalAction", "LateralAction", "RoutingAction", "ControllerAction")
_SWITCHES = ("longitudinal", "lateral", "activateLongitudinal", "activateLateral")
_BY_TIME = ("TimeHeadwayCondition", "TimeToCollisionCondition")
_BY_ENTITY = (
    *("SpeedCondition", "RelativeSpeedCondition", "TraveledDistanceCondition", "ReachPositionCondition"),
    *("DistanceCondition", "RelativeDistanceCondition", *_BY_TIME),
)


class Event:
    """Event within its maneuver, group, act and story; it goes on until its actions are over."""

    def __init__(self, *within: Element) -> None:
        self.element, self.maneuver, self.group, self.act, self.story = within
        self.began_s = self.ended_s = math.inf
        self.ending = ""  # ``end`` or ``stop``, once it is over
        self.times_left = number(self.element, "maximumExecutionCount", "1")
        self.running: list[tuple[Mover, Action]] = []

    def end(self, time_s: float, ending: str = "stop") -> None:
        """End it, and those of its actions that go on."""
        for mover, action in self.running:
            mover.end(action)
        self.ended_s, self.ending = time_s, ending


class Storyboard:
    """Motion of a scenario from its initial actions on.

    Attributes:
        movers: road users by name.
    """

    def __init__(self, root: Element, places: Places) -> None:
        board, self._places, self._time_s = _needed(root, "Storyboard"), places, 0.0
        movers = [Mover(one, places) for one in root.iterfind("Entities/ScenarioObject")]
        self.movers = {mover.name: mover for mover in movers}
        self._fired: dict[Element, tuple[bool, float]] = {}
        self._fixed: dict[Element, Pose] = {}  # places that no road user changes
        self._named: dict[Element, list[list[Event]]] = {}  # events of the parts that a condition names
        self._stop = board.find("StopTrigger")
        for private in board.iterfind("Init/Actions/Private"):
            for action in private:
                self._begin(action, [self._mover(private)])
        for action in board.iterfind("Init/Actions/GlobalAction"):
            self._begin(action, [])
        above = {below: one for one in board.iter() for below in one}
        self._events: list[Event] = []
        for event in board.iterfind("Story/Act/ManeuverGroup/Maneuver/Event"):
            within = [event]
            while within[-1].tag != "Story":
                within.append(above[within[-1]])
            self._events.append(Event(*within))
        self._begun: dict[Element, float] = {}  # acts

    @property
    def over_s(self) -> float:
        """Time at which all events were over, s; infinite until then."""
        return max((event.ended_s for event in self._events), default=0.0)

    def _mover(self, element: Element, key: str = "entityRef") -> Mover:
        name = element.get(key, "")
        if name not in self.movers:
            raise ValueError(f"entity {name[:40]!r} is not there")
        return self.movers[name]

    def _pose(self, element: Element) -> Pose:
        return self._placed(
            _needed(element, "*" if element.tag.startswith("TargetPosition") else "Position/*")
        )

    def _placed(self, position: Element) -> Pose:
        """Return the pose of a position; a lane's is headed as it is driven."""
        kind, turned, places = position.tag, position.find("Orientation"), self._places
        if kind == "WorldPosition":
            return Pose(number(position, "x"), number(position, "y"), number(position, "h", "0"))
        if kind in ("LanePosition", "RoadPosition"):
            if (known := self._fixed.get(position)) is not None:
                return known
            lane = int(number(position, "laneId")) if kind == "LanePosition" else None
            beside = number(position, "t" if lane is None else "offset", "0")
            there = places.at_station(position.get("roadId", ""), number(position, "s"), beside, lane)
            if turned is None and there.lane is not None and places.driven(there.lane, 1)[3] < 0:
                there = there.turned(math.pi)
        elif kind == "RelativeObjectPosition":
            there = self._mover(position).pose.moved(number(position, "dx"), number(position, "dy"))
        elif kind == "RelativeLanePosition":
            there = self._beside(position, self._mover(position).pose)
        elif kind == "RoutePosition" and position.find(".//Waypoint/Position/*") is not None:
            goals = [self._placed(one) for one in position.iterfind(".//Waypoint/Position/*")]
            way = places.way(goals[0], places.roads_of(goals))
            coordinates = next((one for one in position.iter() if one.get("pathS")), position)
            there = way.at(way.project(goals[0])[0] + number(coordinates, "pathS"))
        else:
            raise UnknownMotion(f"{kind} is not read")
        if turned is not None:
            relative = there.heading if turned.get("type") == "relative" else 0.0
            there = there._replace(heading=relative + number(turned, "h", "0"))
        if kind in ("LanePosition", "RoadPosition"):
            self._fixed[position] = there
        return there

    def _beside(self, position: Element, own: Pose) -> Pose:
        lane, ds = self._places.lane_of(own), number(position, "ds", position.get("dsLane", "0"))
        if lane is None:
            raise ValueError(f"{position.get('entityRef')} is on no lane")
        goal = self._places.known((*lane[:3], 1), int(number(position, "dLane")))
        back = math.pi if lane[3] * ds < 0 else 0.0
        way = self._places.way(own.turned(back)._replace(lane=goal[:3]))
        left = number(position, "offset", "0") * lane[3] * (-1 if back else 1)
        return way.at(way.project(own)[0] + abs(ds), left).turned(back)

    def step(self, time_s: float) -> bool:
        """Begin what its triggers let begin at a time, and move on by `TICK_S`; False at the stop trigger.

        Raises:
            UnknownMotion: the scenario does not decide what happens now, or it is not read.
        """
        self._time_s = time_s
        if self._is_on(self._stop, otherwise=False):
            return False
        for act in dict.fromkeys(event.act for event in self._events if event.ended_s > time_s):
            self._advance(act, [event for event in self._events if event.act is act])
        for mover in self.movers.values():
            if mover.there:
                mover.step(time_s + motion.TICK_S)
        return True

    def _advance(self, act: Element, events: Sequence[Event]) -> None:
        """Begin an act, and those of its events whose time has come; end those that are over."""
        now = self._time_s
        if act not in self._begun and self._is_on(act.find("StartTrigger"), otherwise=True):
            self._begun[act] = now
        if act not in self._begun:
            return
        is_stopped = self._is_on(act.find("StopTrigger"), otherwise=False)
        for event in (event for event in events if event.ended_s > now):
            goes_on = any(action in mover.actions.values() for mover, action in event.running)
            is_over = event.began_s <= now and not goes_on
            if is_over and event.times_left >= 1 and not is_stopped:
                event.began_s = math.inf
            elif is_over or is_stopped:
                event.end(now, "end" if is_over else "stop")
            if (
                event.began_s > now
                and not is_stopped
                and self._is_on(event.element.find("StartTrigger"), otherwise=True)
            ):
                self._start(event, [one for one in events if one.maneuver is event.maneuver])

    def _start(self, event: Event, others: Sequence[Event]) -> None:
        now, element = self._time_s, event.element
        others = [one for one in others if one.began_s <= now < one.ended_s]
        if element.get("priority") == "skip" and others:
            return
        for one in others if element.get("priority") in ("override", "overwrite") else ():
            one.end(now)
        event.began_s, event.times_left = now, event.times_left - 1
        actors = [self._mover(x) for x in event.group.iterfind("Actors/EntityRef")]
        for body in element.iterfind("Action/*"):
            event.running += self._begin(body, actors)

    def _begin(self, action: Element, movers: Sequence[Mover]) -> list[tuple[Mover, Action]]:
        """Begin an action of some road users, or of the world; return what goes on."""
        body = action[0] if len(action) else action
        if body.tag == "EntityAction":
            mover, added = self._mover(body), body.find("AddEntityAction")
            if added is not None:
                mover.put(self._pose(added))
            mover.there = added is not None
        if body.tag in (*_STILL, "EntityAction"):
            return []
        if action.tag != "PrivateAction":
            raise UnknownMotion(f"{body.tag} decides from then on")
        inner = body[0] if body.tag in _GROUPS and len(body) else body
        return [(mover, begun) for mover in movers if (begun := self._begun_by(inner, mover)) is not None]

    def _begun_by(self, action: Element, mover: Mover) -> Action | None:
        """Begin an action of a road user; return it if it goes on."""
        match action.tag:
            case "TeleportAction":
                mover.put(self._pose(action))
            case "SpeedAction":
                return self._change_speed(action, mover)
            case "LongitudinalDistanceAction":
                return mover.begin("along", motion.following(mover, action, self._mover(action)))
            case "SynchronizeAction":
                names, master = (
                    ("TargetPosition", "TargetPositionMaster"),
                    self._mover(action, "masterEntityRef"),
                )
                goal, masters = (self._pose(_needed(action, name)) for name in names)
                final = action.find("FinalSpeed/AbsoluteSpeed")
                final_mps = None if final is None else number(final, "value")
                return mover.begin("along", motion.synchronising(mover, goal, master, masters, final_mps))
            case "LaneChangeAction":
                return self._change_lane(action, mover)
            case "FollowTrajectoryAction":
                way = motion.trajectory(action, mover, self._time_s, self._pose)
                return mover.begin("across", motion.driving(mover, way))
            case "AssignRouteAction" | "AcquirePositionAction":
                goals = [self._pose(one) for one in [*action.iter("Waypoint")] or [action]]
                mover.roads = self._places.roads_of(goals)
                if mover.there:
                    mover.put(mover.pose)
            case "ActivateControllerAction" | "AssignControllerAction":
                is_on = any(action.get(name) == "true" for name in _SWITCHES)
                if is_on and (mover.is_controlled or action.tag.startswith("Assign")):
                    raise UnknownMotion(f"a controller drives {mover.name} from then on")
            case kind if kind not in _STILL:
                raise UnknownMotion(f"{kind} of {mover.name} is not read")
        return None

    def _change_speed(self, action: Element, mover: Mover) -> Action | None:
        target = _needed(action, "SpeedActionTarget/*")
        dynamics, value = _needed(action, "SpeedActionDynamics"), number(target, "value")
        stays, is_factor = target.get("continuous") == "true", target.get("speedTargetValueType") == "factor"
        is_relative = target.tag == "RelativeTargetSpeed"
        other = self._mover(target) if is_relative else None

        def wanted() -> float:
            """Return the target speed now, m/s."""
            theirs = 0.0 if other is None else other.speed
            return theirs * value if is_factor else theirs + value

        fixed, is_step = wanted(), dynamics.get("dynamicsShape", "step") == "step"
        if is_step:
            mover.speed = fixed
        if is_step and not stays:
            mover.end(mover.actions.get("along"))
            return None
        law = motion.changing(mover, "speed", dynamics, wanted if stays else lambda: fixed, stays=stays)
        return mover.begin("along", law)

    def _change_lane(self, action: Element, mover: Mover) -> Action:
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
        return mover.begin("across", motion.changing_lane(mover, goal[:3], dynamics, left))

    def _is_on(self, trigger: Element | None, *, otherwise: bool) -> bool:
        """Return whether a trigger fires now; ``otherwise`` if there is none."""
        if trigger is None or not len(trigger):
            return otherwise
        groups = [[self._condition(one) for one in group.findall("Condition")] for group in trigger]
        unmet = [[result for result in group if result is not True] for group in groups if False not in group]
        if unmet and all(unmet):
            raise UnknownMotion(f"a trigger waits for a {unmet[0][0]}")
        return bool(unmet)

    def _condition(self, condition: Element) -> bool | str:
        """Return whether a condition is met; the kind of one that is not read."""
        body = condition[0] if len(condition) else condition
        entity = body.find("EntityCondition")
        holder = body if entity is None else entity
        one = holder[0] if len(holder) else body
        if entity is not None and one.tag in _BY_ENTITY:
            now = self._by_entity(one, _needed(body, "TriggeringEntities"))
        elif one.tag == "SimulationTimeCondition":
            now = _RULES[one.get("rule", "greaterOrEqual")](self._time_s, number(one, "value"))
        elif one.tag == "StoryboardElementStateCondition":
            now = self._by_state(one)
        else:
            return one.tag
        edge, delay = condition.get("conditionEdge", "none"), number(condition, "delay", "0")
        before, fires = self._fired.get(condition, (False, math.inf))
        rises = now and not before
        met = {"none": now, "rising": rises, "falling": before and not now}.get(edge, now != before)
        fires = min(fires, self._time_s + delay) if met else fires
        self._fired[condition] = now, fires
        return self._time_s >= fires - 1e-9 if delay > 0 else met

    def _by_state(self, one: Element) -> bool:
        kind, wanted = one.get("storyboardElementType", "").lower(), one.get("state", "")
        now = self._time_s
        if one not in self._named:
            self._named[one] = self._parts(kind, one.get("storyboardElementRef", ""))
        for events in self._named[one]:
            acts = [self._begun.get(event.act, math.inf) for event in events]
            began = min([event.began_s for event in events] if kind in ("event", "action") else acts)
            last = max(events, key=lambda event: event.ended_s)
            began, ended = 0.0 if kind == "story" else began, last.ended_s
            state = "complete" if ended <= now else "running" if began <= now else "standby"
            changed = {"start": began, last.ending: ended}.get(wanted.removesuffix("Transition"))
            if wanted == f"{state}State" or (
                changed is not None and 0 <= now - changed < 1.5 * motion.TICK_S
            ):
                return True
        return False

    def _parts(self, kind: str, ref: str) -> list[list[Event]]:
        """Return the events of each part of the storyboard of a kind and name."""
        name = ref.replace("::", "/").rpartition("/")[2]
        parts: dict[Element, list[Event]] = {}
        for event in self._events:
            within = event.story, event.act, event.group, event.maneuver, event.element
            for part in (*within, *event.element.iterfind("Action")):
                if part.tag.lower() == kind and part.get("name") == name:
                    parts.setdefault(part, []).append(event)
        if not parts:
            raise ValueError(f"{kind[:20]} {name[:40]!r} is not in its storyboard")
        return [*parts.values()]

    def _by_entity(self, one: Element, entities: Element) -> bool:
        movers = [self._mover(x) for x in entities.findall("EntityRef")]
        how, value = _RULES[one.get("rule", "greaterThan")], number(one, "value", "0")
        if one.tag == "ReachPositionCondition":
            how, value = _RULES["lessOrEqual"], number(one, "tolerance")
        results = [how(self._measured(one, mover), value) for mover in movers if mover.there]
        return bool(results) and (all if entities.get("triggeringEntitiesRule") == "all" else any)(results)

    def _measured(self, one: Element, mover: Mover) -> float:
        if one.tag == "SpeedCondition":
            return mover.speed
        if one.tag == "TraveledDistanceCondition":
            return mover.travelled
        if one.tag == "ReachPositionCondition":
            return math.hypot(*mover.pose.seen(self._pose(one)))
        named = one if one.get("entityRef") else one.find(".//EntityRef")
        other = None if named is None else self._mover(named)
        if one.tag == "RelativeSpeedCondition" and other is not None:
            return mover.speed - other.speed
        holder = one if other is not None or one.find("Position") is not None else _needed(one, "*")
        goal = self._pose(holder) if other is None else other.pose
        apart = self._apart(one, mover, goal, other if one.get("freespace") == "true" else None)
        if one.tag not in _BY_TIME:
            return apart
        is_closing = one.tag == "TimeToCollisionCondition" and other is not None
        speed = mover.speed - (other.speed if is_closing and other is not None else 0.0)
        return apart / speed if speed > 1e-6 and mover.pose.seen(goal)[0] > 0 else math.nan

    def _apart(self, one: Element, mover: Mover, goal: Pose, free: Mover | None) -> float:
        """Return the distance that a condition means, m; between the boxes if another one is given."""
        kind, system = one.get("relativeDistanceType", ""), one.get("coordinateSystem", "entity")
        by_road = one.get("alongRoute") == "true" or system in ("road", "lane", "trajectory")
        dx, dy = mover.pose.seen(goal)
        if kind == "lateral":
            return max(abs(dy) - ((mover.width + free.width) / 2 if free else 0.0), 0.0)
        if by_road or kind == "longitudinal" or one.tag == "TimeHeadwayCondition":
            apart = abs(mover.ahead(goal) if by_road else dx)
            return max(apart - ((mover.length + free.length) / 2 if free else 0.0), 0.0)
        if free is None:
            return math.hypot(dx, dy)
        is_known = math.isfinite(mover.length + mover.width + free.length + free.width)
        return mover.outline.distance(free.outline) if is_known else math.nan


def _needed(element: Element, name: str) -> Element:
    found = element.find(name)
    if found is None:
        raise ValueError(f"a {element.tag} has no {name.replace('*', 'content')}")
    return found
