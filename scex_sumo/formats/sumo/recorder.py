"""Recorder of a running SUMO simulation: road users and traffic lights of each step.

The connection is libsumo, libtraci, traci or a connection of traci. It is only asked: with subscriptions
the simulation's own steps fail once a vehicle is removed, and its owner's subscriptions have more values.
"""

from __future__ import annotations

import dataclasses
from array import array
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.datasets.scene import FUTURE_STEPS
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.sumo.fcd import numbers_of, tracks_of
from scex_sumo.formats.sumo.intentions import intention_at, intentions_now, with_lanes
from scex_sumo.formats.sumo.phases import Light, Programme, with_lights
from scex_sumo.formats.sumo.saved import (
    person_label,
    road_users,
    saved_lights,
    saved_state,
    text_of,
    types_and_arrivals,
)
from scex_sumo.intention import Intention, Walk
from scex_sumo.scene import STEP_S, SeedScene

_NOWHERE_M = 1e8  # SUMO's coordinates of vehicles that are not in the network are beyond
_PARKED = 2  # bit of a stop's state
_LET_GO = 100  # road users that have left, before they are forgotten
_STANDING_MPS = 0.1  # nobody parks faster
_RAILS = ("rail", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car")
_RAIL_SIGNALS = (1, 2)
_STATIC, _BY_TRAFFIC = 0, (3, 5)  # types with known phases: fixed ones; actuated and delay-based ones

Frame: TypeAlias = tuple[float, list[str], "array[float]"]


@dataclass(kw_only=True, eq=False)
class Recorded:
    """Steps of a SUMO simulation.

    Attributes:
        frames: time, names and their rows of x, y, angle, speed, in SUMO's units.
        users: kind, length and width of each road user.
        absent: time, teleporting vehicles, parked ones, and number of those that wait to be inserted.
        lights: changes of each traffic light, in order of time.
        programmes: by light and name.
        walks: times at which each person came to an edge, and its walk from there.
        intentions: changes of what each vehicle is to do, in order of time; stops count from time 0.
        states: SUMO's packed states, by the times at which intentions were recorded.
        notes: on the simulation, one sentence each.
        lateral_m: resolution of the sublane model; 0 without it.
    """

    frames: deque[Frame] = field(default_factory=deque)
    users: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    absent: deque[tuple[float, tuple[str, ...], tuple[str, ...], int]] = field(default_factory=deque)
    lights: dict[str, list[Light]] = field(default_factory=dict)
    programmes: dict[tuple[str, str], Programme] = field(default_factory=dict)
    walks: dict[str, list[tuple[float, Walk]]] = field(default_factory=dict)
    intentions: dict[str, list[tuple[float, Intention]]] = field(default_factory=dict)
    states: dict[float, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    lateral_m: float = 0.0

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
    end_s = min(recorded.absent[-1][0], time_s + FUTURE_STEPS * STEP_S)
    state = recorded.states.get(round(time_s, 3))
    lights = saved_lights(state or b"")
    road, on_lights = with_lights(scene.road, recorded.lights, recorded.programmes, time_s, end_s, lights)
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
    users = road_users(state or b"")

    def known(name: str) -> tuple[Intention | None, str]:
        """Return what a road user is to do, and what the state has of it."""
        changes, user = recorded.intentions.get(name, ()), users.get(name)
        intention = intention_at(changes, time_s, asked=state is not None)
        return intention, "" if user is None else text_of(user, intention)

    intentions = [
        intention and dataclasses.replace(intention, saved=saved)
        for intention, saved in map(known, vehicles.values())
    ]
    if road is not None and road.net is not None and any(intentions):
        scene = dataclasses.replace(scene, intentions=with_lanes(road.net, intentions))
    if (others := scene.obstacles) is not None:
        past = [[w for s, w in recorded.walks.get(name, ()) if s <= time_s + 1e-6] for name in others.ids]
        walks = tuple(
            (walks[-1] if walks else Walk())._replace(saved=known(name)[1])
            for name, walks in zip(others.ids, past, strict=True)
        )
        scene = dataclasses.replace(scene, obstacles=dataclasses.replace(others, walks=walks))
    source: dict[str, Any] = {"kind": "simulation", "simulation": str(path), "time_s": time_s}
    source |= {"vehicles": vehicles, "lateral_m": recorded.lateral_m}
    return dataclasses.replace(scene, road=road, notes=(*scene.notes, *notes), source=source)


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
        lateral_m = float(sumo.simulation.getOption("lateral-resolution"))  # -1: without
        self.recorded = Recorded(lateral_m=max(lateral_m, 0.0))
        self._labels: dict[tuple[bool, str], str] = {}  # a person may have the name of a vehicle
        self._present: set[tuple[bool, str]] = set()
        self._types: dict[str, dict[str, str]] = {}
        self._arrivals: dict[str, str] = {}
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
                if walks:
                    self._take_walk(names[-1], name, time_s)
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
        if self._keep_s is not None and len(self._labels) > 2 * len(here) + _LET_GO:
            self._forget(time_s - self._keep_s)
        return time_s

    def _take_walk(self, label: str, name: str, time_s: float) -> None:
        """Record the edges of a person's walk from the one that it has come to."""
        road = str(self._sumo.person.getRoadID(name))
        changes = self.recorded.walks.setdefault(label, [])
        if road.startswith(":") or (changes and changes[-1][1].edges[:1] == (road,)):
            return
        stage = self._sumo.person.getStage(name)
        edges = tuple(stage.edges)
        first = edges.index(road) if road in edges else len(edges)
        changes.append((time_s, Walk(edges[first:], float(stage.arrivalPos))))

    def _forget(self, before_s: float) -> None:
        """Let go of road users that have left, and of what the lights did before a time, s."""
        recorded = self.recorded
        kept = {name for _, names, _ in recorded.frames for name in names}
        kept |= {self._labels[user] for user in self._present}
        self._labels = {user: label for user, label in self._labels.items() if label in kept}
        for what in ("users", "walks", "intentions"):
            known = getattr(recorded, what)
            setattr(recorded, what, {name: known[name] for name in known if name in kept})
        recorded.states = {asked_s: s for asked_s, s in recorded.states.items() if asked_s >= before_s}
        for changes in recorded.lights.values():
            while len(changes) > 1 and changes[1].since_s < before_s:
                del changes[0]

    def _meet(self, users: Sequence[tuple[bool, str]]) -> None:
        """Label road users that are new, and learn their kinds and sizes."""
        for walks, name in users:
            taken = walks and (False, name) in self._labels
            label = self._labels.setdefault((walks, name), person_label(name, taken=taken))
            domain = self._sumo.person if walks else self._sumo.vehicle
            kind = "pedestrian" if walks else str(domain.getVehicleClass(name))
            size = float(domain.getLength(name)), float(domain.getWidth(name))
            self.recorded.users[label] = "tram" if kind in _RAILS else kind, *size

    def take_intentions(self, names: Iterable[str] | None = None) -> None:
        """Record where vehicles of the present step go, how they drive and where they stop; None: all do."""
        time_s = round(float(self._sumo.simulation.getTime()), 3)
        names = list(self._sumo.vehicle.getIDList() if names is None else names)
        state = self.recorded.states[time_s] = saved_state(self._sumo)
        if not self._arrivals.keys() >= set(names):
            types, self._arrivals = types_and_arrivals(state)
            self._types |= types
        known = self._types, self._arrivals
        for name, intention in intentions_now(self._sumo.vehicle, names, *known, self._model, time_s):
            if self.recorded.lateral_m:  # always beside the middle of the lane
                intention = dataclasses.replace(intention, change_mps=0.0)
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
