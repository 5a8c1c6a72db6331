"""Recorder of a running SUMO simulation: road users and traffic lights of each step.

The connection is libsumo, libtraci, traci or a connection of traci. It is only asked: with subscriptions
the simulation's own steps fail once a vehicle is removed, and its owner's subscriptions have more values.
"""

from __future__ import annotations

import bisect
import dataclasses
import sys
from array import array
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import listed
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.programs import usable_parameters
from scex_sumo.converters.datasets.scene import FUTURE_STEPS
from scex_sumo.converters.net.reading import lane_places, net_root, read_ends
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.sumo.fcd import numbers_of, tracks_of
from scex_sumo.formats.sumo.imported import kept_net
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Intention, SeedScene, Stop

_NOWHERE_M = 1e8  # SUMO's coordinates of vehicles that are not in the network are beyond
_PARKED = 2  # bit of a stop's state
_STANDING_MPS = 0.1  # nobody parks faster
_RAILS = ("rail", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car")
_RAIL_SIGNALS = (1, 2)
_STATIC, _BY_TRAFFIC = 0, (3, 5)  # types with known phases: fixed ones; actuated and delay-based ones
_HELD_S = 1000.0
_SIDEWAYS_MPS = 0.01  # slower vehicles change no lane
_PARKS, _TRIGGERED = 1, 2 + 4  # bits of a planned stop's flags
MAX_EDGES, MAX_STOPS = 50, 3  # of a vehicle that are kept
INTENTIONS_S = 1.0  # between records of intentions

Frame: TypeAlias = tuple[float, list[str], "array[float]"]


@dataclass(frozen=True, kw_only=True)
class Light:
    """State of a traffic light, which vehicles see in the steps that begin at ``since_s`` or later."""

    since_s: float
    programme: str
    phase: int
    state: str


@dataclass(frozen=True, kw_only=True)
class Programme:
    """Programme of a traffic light: state, longest duration, s, and following phase of each phase.

    ``fixed``: whether traffic does not shorten the phases.
    """

    fixed: bool
    phases: tuple[tuple[str, float, int], ...]


@dataclass(kw_only=True, eq=False)
class Recorded:
    """Steps of a SUMO simulation.

    Attributes:
        frames: time, names and their rows of x, y, angle, speed, in SUMO's units.
        users: kind, length and width of each road user.
        absent: time, teleporting vehicles, parked ones, and number of those that wait to be inserted.
        lights: changes of each traffic light, in order of time.
        programmes: by light and name.
        intentions: changes of what each vehicle is to do, in order of time; stops count from time 0.
        asked_s: times at which all of them were recorded.
        notes: on the simulation, one sentence each.
    """

    frames: deque[Frame] = field(default_factory=deque)
    users: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    absent: deque[tuple[float, tuple[str, ...], tuple[str, ...], int]] = field(default_factory=deque)
    lights: dict[str, list[Light]] = field(default_factory=dict)
    programmes: dict[tuple[str, str], Programme] = field(default_factory=dict)
    intentions: dict[str, list[tuple[float, Intention]]] = field(default_factory=dict)
    asked_s: set[float] = field(default_factory=set)
    notes: tuple[str, ...] = ()

    @property
    def end_s(self) -> float:
        """Time of the last step."""
        return self.absent[-1][0]

    def tracks(self, path: Path) -> tuple[TrackTable, tuple[str, ...]]:
        """Return the tracks, and one phrase for each guess; at least one frame must hold a vehicle."""
        names, rows = [], []
        for time_s, present, values in self.frames:
            names += present
            states = np.frombuffer(values).reshape(-1, 4)
            rows.append(np.column_stack([np.full(len(states), time_s), states]))
        sizes = np.array([self.users[name][1:] for name in names]).reshape(-1, 2)
        table: FloatArray = np.column_stack([np.vstack(rows), sizes])
        tracks, findings = tracks_of(path, names, [self.users[name][0] for name in names], table)
        ordered = np.unique(names).tolist()
        simulated = dict(zip(map(str, numbers_of(ordered)), ordered, strict=True))
        complete = partial(_completed, dataclasses.replace(self, frames=deque()), path, simulated)
        return dataclasses.replace(tracks, complete=complete), (*self.notes, *findings)


def _completed(recorded: Recorded, path: Path, names: Mapping[str, str], scene: SeedScene) -> SeedScene:
    """Complete a seed scene: lights in their phases, names of vehicles, notes on absent ones."""
    time_s, notes = scene.time_s, list[str]()
    road, on_lights = with_lights(scene.road, recorded, time_s)
    absent = [entry for entry in recorded.absent if abs(entry[0] - time_s) < STEP_S / 2]
    for _, teleporting, parked, waiting in absent[:1]:
        if teleporting:
            notes.append(f"vehicles that teleport at this moment are left out: {listed(teleporting)}")
        if parked:
            notes.append(f"vehicles that are parked are left out: {listed(parked)}")
        if waiting:
            notes.append(f"vehicles that wait to be inserted are left out: {waiting}")
    notes += on_lights
    vehicles = {str(track): names[str(track)] for track in scene.track_ids}
    intentions = [_intention_at(recorded, name, time_s) for name in vehicles.values()]
    if road is not None and road.net is not None and any(intentions):
        scene = dataclasses.replace(scene, intentions=with_lanes(road.net, intentions))
    source = {"kind": "simulation", "simulation": str(path), "time_s": time_s, "vehicles": vehicles}
    return dataclasses.replace(scene, road=road, notes=(*scene.notes, *notes), source=source)


def _intention_at(recorded: Recorded, name: str, time_s: float) -> Intention | None:
    """Return the last intention before a time, else the first one after it; stops count from the time."""
    changes = recorded.intentions.get(name, ())
    if not changes:
        return None
    known = [intention for since_s, intention in changes if since_s <= time_s + 1e-6]
    intention = known[-1] if known else changes[0][1]
    stops = [
        dataclasses.replace(stop, until_s=stop.until_s - time_s if stop.until_s >= 0 else -1.0)
        for stop in intention.stops
    ]
    change_mps = intention.change_mps if round(time_s, 3) in recorded.asked_s else 0.0
    return dataclasses.replace(intention, stops=tuple(stops), change_mps=change_mps)


def with_lanes(net: Path, intentions: Sequence[Intention | None]) -> tuple[Intention | None, ...]:
    """Return intentions with the lanes of the net's road along their routes."""
    root = net_root(net)
    under = {name: [number for number, _ in places] for name, places in lane_places(root)}
    of_edge: dict[str, set[int]] = {}
    for name, numbers in under.items():
        of_edge.setdefault(name.rpartition("_")[0], set()).update(numbers)
    within: dict[tuple[str, str], set[int]] = {}
    for name, ends in read_ends(root).items():
        within.setdefault(ends, set()).update(under.get(name, ()))

    def lanes(edges: Sequence[str]) -> frozenset[int]:
        parts = [of_edge.get(edge, set()) for edge in edges]
        parts += [within.get(ends, set()) for ends in pairwise(edges)]
        return frozenset().union(*parts)

    return tuple(known and dataclasses.replace(known, lanes=lanes(known.edges)) for known in intentions)


class Recorder:
    """Recorder of a simulation; `take` after each step.

    Args:
        sumo: the connection.
        keep_s: frames that are older are dropped; None keeps all.
    """

    def __init__(self, sumo: Any, keep_s: float | None = None) -> None:
        """Find the lights that have programmes."""
        self._sumo, self._keep_s = sumo, keep_s
        self._model = str(sumo.simulation.getOption("default.carfollowmodel"))
        self.recorded = Recorded()
        self._labels: dict[tuple[bool, str], str] = {}  # a person may have the name of a vehicle
        self._present: set[tuple[bool, str]] = set()
        self._types: dict[str, dict[str, str]] = {}
        # SUMO makes rail signals of the trains.
        programmes = sumo.trafficlight.getAllProgramLogics
        self._lights = [
            light
            for light in sumo.trafficlight.getIDList()
            if not any(int(logic.type) in _RAIL_SIGNALS for logic in programmes(light))
        ]

    def take(self) -> float:
        """Record the present step; return its time, s."""
        sumo, recorded = self._sumo, self.recorded
        time_s = round(float(sumo.simulation.getTime()), 3)
        while recorded.frames and recorded.frames[-1][0] >= time_s:  # no step was made, or a state was loaded
            recorded.frames.pop()
            recorded.absent.pop()
            self._present = set()
        before_s = recorded.frames[-1][0] if recorded.frames else -np.inf
        here = [(False, name) for name in sumo.vehicle.getIDList()]
        here += [(True, name) for name in sumo.person.getIDList()]
        self._meet([user for user in here if user not in self._present])
        self._present = set(here)
        names, parked, values = list[str](), list[str](), array("d")
        for user in here:
            walks, name = user
            domain = sumo.person if walks else sumo.vehicle
            x, y = domain.getPosition(name)
            if abs(x) >= _NOWHERE_M or (walks and domain.getVehicle(name)):
                continue
            speed = domain.getSpeed(name)
            if not walks and speed < _STANDING_MPS and domain.getStopState(name) & _PARKED:
                parked.append(name)
            else:
                names.append(self._labels[user])
                values.extend((x, y, domain.getAngle(name), speed))
        recorded.frames.append((time_s, names, values))
        waiting = len(sumo.simulation.getPendingVehicles())
        teleporting = tuple(sumo.vehicle.getTeleportingIDList())
        recorded.absent.append((time_s, teleporting, tuple(parked), waiting))
        while self._keep_s is not None and recorded.frames[0][0] < time_s - self._keep_s:
            recorded.frames.popleft()
            recorded.absent.popleft()
        for light in self._lights:
            self._take_light(light, time_s, before_s)
        return time_s

    def _meet(self, users: Sequence[tuple[bool, str]]) -> None:
        """Label road users that are new, and learn their kinds and sizes."""
        for walks, name in users:
            taken = walks and (False, name) in self._labels
            label = self._labels.setdefault((walks, name), f"{name} (person)" if taken else name)
            domain = self._sumo.person if walks else self._sumo.vehicle
            kind = "pedestrian" if walks else str(domain.getVehicleClass(name))
            size = float(domain.getLength(name)), float(domain.getWidth(name))
            self.recorded.users[label] = "tram" if kind in _RAILS else kind, *size

    def take_intentions(self) -> None:
        """Record where the vehicles of the present step go, how they drive and where they stop."""
        sumo, time_s = self._sumo, round(float(self._sumo.simulation.getTime()), 3)
        ask = sumo.vehicle
        types = {name: str(ask.getTypeID(name)) for name in ask.getIDList()}
        if any(kind not in self._types for kind in types.values()):
            self._types |= types_of(sumo)
        self.recorded.asked_s.add(time_s)
        for name, kind in types.items():
            attributes = self._types.get(kind, {})
            index = max(int(ask.getRouteIndex(name)), 0)
            edges = ask.getRoute(name)[index : index + MAX_EDGES]
            intention = Intention(
                edges=tuple(map(sys.intern, edges)),
                model=attributes.get("carFollowModel", self._model),
                vehicle_class=str(ask.getVehicleClass(name)),
                parameters=usable_parameters(attributes),
                speed_factor=float(ask.getSpeedFactor(name)),
                stops=tuple(_stop(ask, name, k, time_s) for k in range(len(ask.getStops(name, MAX_STOPS)))),
                change_mps=_change(ask, name),
            )
            changes = self.recorded.intentions.setdefault(self._labels[False, name], [])
            while changes and changes[-1][0] >= time_s:
                changes.pop()
            if not changes or changes[-1][1] != intention:
                changes.append((time_s, intention))

    def _take_light(self, light: str, time_s: float, before_s: float) -> None:
        ask, changes = self._sumo.trafficlight, self.recorded.lights.setdefault(light, [])
        while changes and changes[-1].since_s >= time_s:
            changes.pop()
        now = Light(
            since_s=changes[-1].since_s if changes else time_s,
            programme=str(ask.getProgram(light)),
            phase=int(ask.getPhase(light)),
            state=str(ask.getRedYellowGreenState(light)),
        )
        if not changes or now != changes[-1]:
            since_s = time_s - float(ask.getSpentDuration(light))  # of NEMA lights: the simulation's begin
            since_s = max(since_s, before_s) if changes else since_s
            changes.append(dataclasses.replace(now, since_s=since_s))
            self._learn(light, now.programme)

    def _learn(self, light: str, name: str) -> None:
        known = self.recorded.programmes
        if (light, name) in known:
            return
        for logic in self._sumo.trafficlight.getAllProgramLogics(light):
            by_traffic, phases = int(logic.type) in _BY_TRAFFIC, list[tuple[str, float, int]]()
            for k, phase in enumerate(logic.phases):
                limited = by_traffic and 0 <= phase.maxDur < 1e6
                after = phase.next[0] if phase.next else (k + 1) % len(logic.phases)
                phases.append((phase.state, phase.maxDur if limited else phase.duration, after))
            # States set by TraCI, and those of other types, go on in ways that nobody knows.
            if logic.programID != "online" and (by_traffic or int(logic.type) == _STATIC):
                known[light, logic.programID] = Programme(fixed=not by_traffic, phases=tuple(phases))


def types_of(sumo: Any) -> dict[str, dict[str, str]]:
    """Return the attributes of a simulation's vehicle types, as its saved state has them.

    Empty if it cannot write one here.
    """
    with TemporaryFolder() as folder:
        file = Path(folder, "state.xml")
        sumo.simulation.saveState(str(file))
        if not file.is_file():
            return {}
        found = {}
        for _, element in ElementTree.iterparse(file):
            if element.tag == "vType":
                found[element.get("id", "")] = dict(element.attrib)
            element.clear()
    return found


def _change(vehicles: Any, name: str) -> float:
    speed = float(vehicles.getLateralSpeed(name))
    return speed if abs(speed) > _SIDEWAYS_MPS else 0.0


def _stop(vehicles: Any, name: str, index: int, time_s: float) -> Stop:
    def asked(key: str) -> float:
        value = vehicles.getStopParameter(name, index, key)
        return float(value) if value else -1.0

    stop = vehicles.getStops(name, index + 1)[index]
    waits = stop.stopFlags & _TRIGGERED
    duration, started = max(float(stop.duration), 0.0), asked("started")
    if started >= 0:
        duration = max(duration - (time_s - started), 0.0)
    return Stop(
        lane=str(stop.lane),
        start_m=float(stop.startPos),
        end_m=float(stop.endPos),
        duration_s=_HELD_S if waits else duration,
        until_s=float(stop.until) if stop.until >= 0 else -1.0,
        flags=int(stop.stopFlags) & _PARKS,
    )


def with_lights(road: Road | None, recorded: Recorded, time_s: float) -> tuple[Road | None, list[str]]:
    """Return a road whose net begins with the lights as they are at a time, and notes on the lights."""
    if road is None or road.net is None:
        return road, []
    lights: dict[str, ElementTree.Element] = {}
    groups: dict[str, list[str]] = {}
    end_s = min(recorded.end_s, time_s + FUTURE_STEPS * STEP_S)
    for name, changes in recorded.lights.items():
        phases, group = _phases_from(changes, partial(_programme, recorded, name), time_s, end_s)
        groups.setdefault(group, []).append(name)
        # A future begins at 0.1 s of its simulation.
        light = ElementTree.Element("tlLogic", id=name, type="static", programID="0", offset=str(STEP_S))
        for state, duration in phases:
            if duration > 5e-4:
                ElementTree.SubElement(light, "phase", duration=f"{duration:.3f}", state=state)
        lights[name] = light
    if not lights:
        return road, []
    made_of = b"".join(ElementTree.tostring(light) for light in lights.values())
    given = road.net
    net = kept_net(given, given.read_bytes() + made_of, lambda: _relit(given, lights))
    notes = [f"{said}: {listed(groups[said])}" for said in (_FOLLOWED, _LONGEST, _STILL) if said in groups]
    return dataclasses.replace(road, net=net), notes


_FIXED = ""
_FOLLOWED = "traffic lights that do in each future what they do in the simulation, whatever the traffic"
_LONGEST = "traffic lights, actuated in the simulation, whose phases have their longest durations"
_STILL = "traffic lights that keep their present state in the futures"


def _programme(recorded: Recorded, light: str, name: str) -> Programme | None:
    return recorded.programmes.get((light, name))


def _phases_from(
    changes: Sequence[Light],
    programme: Callable[[str], Programme | None],
    time_s: float,
    end_s: float,
) -> tuple[list[tuple[str, float]], str]:
    """Return state and duration, s, of the phases of a light from a time on, and the note they need.

    A fixed programme goes on. Others follow the recording until ``end_s``, then their longest durations.
    """
    changes = [change for change in changes if change.since_s < end_s] or changes[:1]
    first = max(bisect.bisect_left(changes, time_s - 1e-6, key=lambda change: change.since_s) - 1, 0)
    now, last = changes[first], changes[-1]
    ends = [max(change.since_s, time_s) for change in changes[first + 1 :]]
    seen = [(a.state, d) for a, d in zip(changes[first:], np.diff([time_s, *ends, end_s]), strict=True)]
    logic = programme(now.programme)
    if logic is not None and logic.fixed:
        phases = _going_on(logic, now, time_s)
        if _begins_with(phases, seen):
            return [*phases, (now.state, max(time_s - now.since_s, STEP_S))], _FIXED
    at_s, logic = max(last.since_s, time_s), programme(last.programme)
    before = now.state, HISTORY_STEPS * STEP_S  # which a replay shows
    phases = [*seen[:-1], *_going_on(logic, last, at_s, at_least_s=end_s - at_s), before]
    return phases, _FOLLOWED if end_s - time_s > STEP_S else _STILL if logic is None else _LONGEST


def _begins_with(phases: Sequence[tuple[str, float]], seen: Sequence[tuple[str, float]]) -> bool:
    """Whether phases begin with the recorded ones, whose last one may be cut short by the recording's end."""
    *whole, cut = zip(phases, seen, strict=False)
    return (
        len(phases) >= len(seen)
        and all(a == b for (a, _), (b, _) in [*whole, cut])
        and all(abs(c - d) < STEP_S / 2 for (_, c), (_, d) in whole)
        and cut[0][1] > cut[1][1] - STEP_S / 2
    )


def _going_on(
    logic: Programme | None, now: Light, time_s: float, *, at_least_s: float = 0.0
) -> list[tuple[str, float]]:
    """Return state and duration, s, of each phase of a programme once, from a state at a time on."""
    if logic is None or now.phase >= len(logic.phases):
        return [(now.state, _HELD_S)]
    _, duration, after = logic.phases[now.phase]
    phases = [(now.state, max(duration - (time_s - now.since_s), at_least_s, 0.0))]
    while after != now.phase and len(phases) < len(logic.phases):
        state, duration, following = logic.phases[after]
        phases.append((state, duration))
        after = following
    return phases


def _relit(net: Path, lights: Mapping[str, ElementTree.Element]) -> bytes:
    root = net_root(net)
    others = [e for e in root if e.tag != "tlLogic" or e.get("id", "") not in lights]
    after = next((k for k, element in enumerate(others) if element.tag == "junction"), len(others))
    root[:] = [*others[:after], *lights.values(), *others[after:]]  # before the junctions, as SUMO has them
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))
