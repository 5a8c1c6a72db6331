"""Recorder of a running SUMO simulation: road users and traffic lights of each step.

The connection is libsumo, libtraci, traci or a connection of traci; nothing in the simulation is changed.
"""

from __future__ import annotations

import bisect
import dataclasses
from array import array
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.net.reader import net_root
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.sumo.fcd import numbers_of, tracks_of
from scex_sumo.formats.sumo.imported import kept_net
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SeedScene

# Variables of TraCI.
_SPEED, _POSITION, _ANGLE, _VEHICLE, _STOP = 0x40, 0x42, 0x43, 0xC3, 0xB5
_STATE, _PHASE, _PROGRAMME, _SPENT = 0x20, 0x28, 0x29, 0x38
_NOWHERE_M = 1e8  # SUMO's coordinates of vehicles that are not in the network are beyond
_PARKED = 2  # bit of a stop's state
_RAILS = ("rail", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car")
_RAIL_SIGNALS = (1, 2)
_LIGHTS = {0: "static", 3: "actuated", 5: "delay_based"}  # types that go on; others hold their state

Frame: TypeAlias = tuple[float, list[str], "array[float]"]
Light: TypeAlias = tuple[float, str, int, str]
"""Since when, s; programme, phase and state."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Programme:
    """Programme of a traffic light: type, attributes of the phases, and parameters."""

    kind: str | None
    phases: tuple[Mapping[str, str], ...]
    parameters: Mapping[str, str]


@dataclass(kw_only=True, eq=False)
class Recorded:
    """Steps of a SUMO simulation.

    Attributes:
        frames: time, names and their rows of x, y, angle, speed, in SUMO's units.
        users: kind, length and width of each road user.
        absent: time, teleporting vehicles, parked ones, and number of those that wait to be inserted.
        lights: changes of each traffic light, in order of time.
        programmes: by light and name.
        notes: on the simulation, one sentence each.
    """

    frames: deque[Frame] = field(default_factory=deque)
    users: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    absent: deque[tuple[float, tuple[str, ...], tuple[str, ...], int]] = field(default_factory=deque)
    lights: dict[str, list[Light]] = field(default_factory=dict)
    programmes: dict[tuple[str, str], Programme] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

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
    road, held = with_lights(scene.road, recorded, time_s)
    absent = [entry for entry in recorded.absent if abs(entry[0] - time_s) < STEP_S / 2]
    for _, teleporting, parked, waiting in absent[:1]:
        if teleporting:
            notes.append(f"vehicles that teleport at this moment are left out: {listed(teleporting)}")
        if parked:
            notes.append(f"vehicles that are parked are left out: {listed(parked)}")
        if waiting:
            notes.append(f"vehicles that wait to be inserted are left out: {waiting}")
    if held:
        notes.append(f"traffic lights that keep their present state in the futures: {listed(held)}")
    vehicles = {str(track): names[str(track)] for track in scene.track_ids}
    source = {"kind": "simulation", "simulation": str(path), "time_s": time_s, "vehicles": vehicles}
    return dataclasses.replace(scene, road=road, notes=(*scene.notes, *notes), source=source)


class Recorder:
    """Recorder of a simulation; `take` after each step.

    Args:
        sumo: the connection.
        keep_s: frames that are older are dropped; None keeps all.
    """

    def __init__(self, sumo: Any, keep_s: float | None = None) -> None:
        """Subscribe to the lights."""
        self._sumo, self._keep_s = sumo, keep_s
        self.recorded = Recorded()
        self._labels: dict[tuple[int, str], str] = {}  # a person may have the name of a vehicle
        for light in sumo.trafficlight.getIDList():
            if any(
                int(logic.type) in _RAIL_SIGNALS for logic in sumo.trafficlight.getAllProgramLogics(light)
            ):
                continue  # they have no programme; SUMO makes them of the trains
            sumo.trafficlight.subscribe(light, [_STATE, _PHASE, _PROGRAMME, _SPENT])

    def take(self) -> float:
        """Record the present step; return its time, s."""
        sumo, recorded = self._sumo, self.recorded
        time_s = round(float(sumo.simulation.getTime()), 3)
        while recorded.frames and recorded.frames[-1][0] >= time_s:  # no step was made, or a state was loaded
            recorded.frames.pop()
            recorded.absent.pop()
        names, parked, values = list[str](), list[str](), array("d")
        for domain, more in ((sumo.vehicle, _STOP), (sumo.person, _VEHICLE)):
            present, results = domain.getIDList(), domain.getAllSubscriptionResults()
            # A loaded state has none of the subscriptions before.
            if new := [name for name in present if more not in results.get(name, ())]:
                self._subscribe(domain, new, more)
                results = domain.getAllSubscriptionResults()
            for name in present:
                state = results.get(name, {})
                x, y = state.get(_POSITION, (np.inf, np.inf))
                if state.get(_STOP, 0) & _PARKED:
                    parked.append(name)
                elif abs(x) < _NOWHERE_M and not state.get(_VEHICLE):  # nobody in a vehicle
                    names.append(self._labels[more, name])
                    values.extend((x, y, state[_ANGLE], state[_SPEED]))
        recorded.frames.append((time_s, names, values))
        waiting = len(sumo.simulation.getPendingVehicles())
        teleporting = tuple(sumo.vehicle.getTeleportingIDList())
        recorded.absent.append((time_s, teleporting, tuple(parked), waiting))
        while self._keep_s is not None and recorded.frames[0][0] < time_s - self._keep_s:
            recorded.frames.popleft()
            recorded.absent.popleft()
        for light, state in sumo.trafficlight.getAllSubscriptionResults().items():
            if _SPENT not in state:  # subscribed by the user
                continue
            changes = recorded.lights.setdefault(light, [])
            now = state[_PROGRAMME], state[_PHASE], state[_STATE]
            while changes and changes[-1][0] > time_s:
                changes.pop()
            if not changes or changes[-1][1:] != now:
                changes.append((time_s - state[_SPENT], *now))
                self._learn(light, now[0])
        return time_s

    def _subscribe(self, domain: Any, names: Sequence[str], more: int) -> None:
        for name in names:
            taken = more == _VEHICLE and (_STOP, name) in self._labels
            label = f"{name} (person)" if taken else name
            label = self._labels.setdefault((more, name), label)
            domain.subscribe(name, [_SPEED, _POSITION, _ANGLE, more])
            kind = "pedestrian" if more == _VEHICLE else str(domain.getVehicleClass(name))
            size = float(domain.getLength(name)), float(domain.getWidth(name))
            self.recorded.users[label] = "tram" if kind in _RAILS else kind, *size

    def _learn(self, light: str, name: str) -> None:
        known = self.recorded.programmes
        if (light, name) in known:
            return
        for logic in self._sumo.trafficlight.getAllProgramLogics(light):
            phases = tuple(_phase(phase) for phase in logic.phases)
            kind = None if logic.programID == "online" else _LIGHTS.get(int(logic.type))  # set by TraCI
            parameters = dict(logic.subParameter)
            known[light, logic.programID] = Programme(kind=kind, phases=phases, parameters=parameters)


def _phase(phase: Any) -> dict[str, str]:
    limits = {"minDur": phase.minDur, "maxDur": phase.maxDur}
    attributes = {"duration": f"{phase.duration:g}", "state": phase.state}
    attributes |= {name: f"{value:g}" for name, value in limits.items() if 0 <= value < 1e6}
    return attributes | ({"next": " ".join(map(str, phase.next))} if phase.next else {})


def with_lights(road: Road | None, recorded: Recorded, time_s: float) -> tuple[Road | None, list[str]]:
    """Return a road whose net begins with the lights as they are at a time, and the lights that stay so."""
    if road is None or road.net is None:
        return road, []
    lights, held = {}, []
    for name, changes in recorded.lights.items():
        at = bisect.bisect_right(changes, time_s + 1e-6, key=lambda change: change[0]) - 1
        since, programme, phase, state = changes[max(at, 0)]
        logic = recorded.programmes.get((name, programme))
        if logic is None or logic.kind is None or not logic.phases[phase : phase + 1]:
            held.append(name)
            only = {"duration": "1000", "state": state}
            programme, phase = "held", 0  # SUMO wants none with phases under the name "off"
            logic = Programme(kind="static", phases=(only,), parameters={})
        lights[name] = _light(name, programme, logic, phase, time_s - since)
    if not lights:
        return road, []
    made_of = b"".join(ElementTree.tostring(light) for light in lights.values())
    given = road.net
    net = kept_net(given, given.read_bytes() + made_of, lambda: _relit(given, lights))
    return dataclasses.replace(road, net=net), held


def _light(name: str, programme: str, logic: Programme, phase: int, spent_s: float) -> ElementTree.Element:
    """Return a light whose simulation at 0.1 s, when a future begins, is in a phase since a time."""
    durations = [float(one["duration"]) for one in logic.phases]
    spent_s = min(spent_s, durations[phase] - STEP_S)  # an actuated phase may last longer
    begin = sum(durations[:phase]) + spent_s - STEP_S
    offset = f"{-begin % sum(durations):.2f}"
    kind = logic.kind or "static"
    light = ElementTree.Element("tlLogic", id=name, type=kind, programID=programme, offset=offset)
    for key, value in logic.parameters.items():
        ElementTree.SubElement(light, "param", key=key, value=value)
    for one in logic.phases:
        ElementTree.SubElement(light, "phase", dict(one))
    return light


def _relit(net: Path, lights: Mapping[str, ElementTree.Element]) -> bytes:
    root = net_root(net)
    others = [e for e in root if e.tag != "tlLogic" or e.get("id", "") not in lights]
    after = next((k for k, element in enumerate(others) if element.tag == "junction"), len(others))
    root[:] = [*others[:after], *lights.values(), *others[after:]]  # before the junctions, as SUMO has them
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))
