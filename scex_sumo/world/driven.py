"""Vehicles that SUMO drives in its world: start, stops, lane changes under way, arrival.

A vehicle of a SUMO simulation arrives where it does there, and leaves. Where the end of a route is the
map's, a vehicle drives on, straight ahead.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.intention import PARKS, Stop
from scex_sumo.scene import STEP_S, SeedScene
from scex_sumo.world.base import SumoDriven
from scex_sumo.world.batch import MATCH_M, NO_LANE, OWN_LANE, RunningBatch
from scex_sumo.world.tiles import tile_id

_NO_CHANGES = 0  # SUMO's lane change mode
_MAX_GAIN_MPS = 1.0  # in one step
_ARRIVAL_M = 0.2  # SUMO removes vehicles 0.1 m before the end


class _Pose(NamedTuple):
    """Pose of a vehicle in SUMO's frame: front bumper in m, degrees clockwise from north, m/s."""

    key: str
    x: float
    y: float
    angle: float
    speed: float

    def ahead(self) -> _Pose:
        """Return the pose after one step, straight on at constant speed."""
        heading, travelled_m = math.radians(90.0 - self.angle), self.speed * STEP_S
        return self._replace(
            x=self.x + travelled_m * math.cos(heading), y=self.y + travelled_m * math.sin(heading)
        )


@dataclass(kw_only=True, eq=False)
class _LaneChange:
    """Lane change under way that a SUMO driver goes on with, as the simulation it comes from had it.

    SUMO cannot begin in the middle of a change: its own saved states end it in the first step, on the wrong
    lane. So the vehicle is moved sideways step by step, and makes no other change until it is there.

    Attributes:
        speed_mps: lateral, positive to the left.
        offset_m: lateral offset from the middle of the lane that SUMO has the vehicle on.
        limit_m: greatest offset, where no lane is beside.
        mode: SUMO's lane change mode after it.
    """

    key: str
    speed_mps: float
    offset_m: float
    limit_m: float
    mode: int

    @classmethod
    def of(cls, sumo: Any, key: str, speed_mps: float) -> _LaneChange:
        """Return the change of a vehicle; raises SUMO's error if no lane is where it goes."""
        ask, side = sumo.vehicle, 1 if speed_mps > 0 else -1
        lane, offset, mode = ask.getLaneID(key), ask.getLateralLanePosition(key), ask.getLaneChangeMode(key)
        limit = sumo.lane.getWidth(lane)
        if side * offset >= 0:
            limit = (limit + sumo.lane.getWidth(_beside(ask, key, lane, side))) / 2
        ask.setLaneChangeMode(key, _NO_CHANGES)
        return cls(key=key, speed_mps=speed_mps, offset_m=offset, limit_m=limit, mode=mode)

    def switch(self, sumo: Any) -> None:
        """Before a step: put the vehicle on its new lane once its body has left the old one.

        Until then it follows its old leader, as in SUMO. Raises SUMO's error if no lane is there.
        """
        ask, lane = sumo.vehicle, sumo.vehicle.getLaneID(self.key)
        half, side = sumo.lane.getWidth(lane) / 2, 1 if self.speed_mps > 0 else -1
        if side * self.offset_m > half + ask.getWidth(self.key) / 2:
            beside = _beside(ask, self.key, lane, side)
            ask.moveTo(self.key, beside, ask.getLanePosition(self.key))
            self.offset_m -= side * (half + sumo.lane.getWidth(beside) / 2)

    def go_on(self, sumo: Any) -> bool:
        """Set the offset after a step; return whether the change goes on."""
        side = 1 if self.speed_mps > 0 else -1
        offset = side * (self.offset_m + self.speed_mps * STEP_S)
        done = side * self.offset_m < 0 <= offset
        self.offset_m = 0.0 if done else side * min(offset, self.limit_m)
        if done:
            sumo.vehicle.setLaneChangeMode(self.key, self.mode)
        sumo.vehicle.setLateralLanePosition(self.key, self.offset_m)
        return not done


def _beside(vehicles: Any, key: str, lane: str, side: int) -> str:
    return f"{lane.rpartition('_')[0]}_{vehicles.getLaneIndex(key) + side}"


class SumoDrivers:
    """Vehicles of a batch that SUMO drives."""

    def __init__(
        self,
        driven: Sequence[SumoDriven],
        batch: RunningBatch,
        scene: SeedScene,
        sumo: Any,
        refused: tuple[type[Exception], ...],
    ) -> None:
        """Let SUMO drive from now on; a vehicle on no lane goes straight on.

        ``refused``: SUMO's errors.
        """
        self._batch, self._sumo, self._refused = batch, sumo, refused
        self._route_ends: dict[str, str | None] = {}  # last edge, by id; None: it arrives there
        self._parks: set[str] = set()  # vehicles with a stop beside their lane
        self._straight_on: list[_Pose] = []  # vehicles beyond the end of their route
        self._changing: dict[str, _LaneChange] = {}
        for d in driven:
            key, slot = batch.id_of(d.future, d.vehicle), batch.slots[d.future]
            if sumo.vehicle.getLaneID(key):
                self._route_ends[key] = tile_id(slot, d.edges[-1]) if d.arrival is None else None
            else:
                self._take_back(key)
            if (intention := scene.intention(d.vehicle)) is not None:
                self._plan_stops(key, slot, intention.stops)
                if intention.change_mps and key in self._route_ends:
                    with suppress(*refused):  # no lane there
                        self._changing[key] = _LaneChange.of(sumo, key, intention.change_mps)
        self._watch_route_ends()

    def _plan_stops(self, key: str, slot: int, stops: Sequence[Stop]) -> None:
        for stop in stops:
            if stop.flags & PARKS:
                self._parks.add(key)
            if key in self._batch.loaded:
                continue
            edge, _, lane = stop.lane.rpartition("_")
            begin_s = STEP_S if stop.until_s >= 0 else 0.0  # a future begins at 0.1 s of its simulation
            times = stop.duration_s, stop.flags, stop.start_m, stop.until_s + begin_s
            with suppress(*self._refused):  # too near to brake, or off the route
                self._sumo.vehicle.setStop(key, tile_id(slot, edge), stop.end_m, int(lane), *times)

    def arrived(self) -> set[str]:
        """Return the vehicles that have arrived or parked in this step; those that parked are taken out."""
        parked = {key for key in self._parks if self._sumo.vehicle.isStoppedParking(key)}
        for key in parked:
            self._sumo.vehicle.remove(key)
        arrived = parked | (self._route_ends.keys() & set(self._sumo.simulation.getArrivedIDList()))
        for key in arrived:
            del self._route_ends[key]
        self._parks -= arrived
        return arrived

    def take_over(self, mask: BoolArray) -> None:
        """Let SUMO no longer drive the vehicles in the mask (C, V)."""
        for future, vehicle in np.argwhere(mask).tolist():
            key = self._batch.id_of(future, vehicle)
            self._route_ends.pop(key, None)
            self._parks.discard(key)
            self._changing.pop(key, None)
            self._straight_on = [pose for pose in self._straight_on if pose.key != key]
            self._batch.speed[future, vehicle] = self._sumo.vehicle.getSpeed(key)
            self._sumo.vehicle.setLaneChangeMode(key, _NO_CHANGES)
        self._batch.override(mask)

    def go_straight_on(self) -> Iterator[tuple[str, float, float]]:
        """Move vehicles on that were taken back, before a step; yield id, speed (m/s), acceleration."""
        for change in self._changing.values():
            with suppress(*self._refused):  # no lane there
                change.switch(self._sumo)
        self._straight_on = [pose.ahead() for pose in self._straight_on]
        for pose in self._straight_on:
            self._sumo.vehicle.moveToXY(pose.key, "", NO_LANE, pose.x, pose.y, pose.angle, OWN_LANE, MATCH_M)
            yield pose.key, pose.speed, 0.0

    def follow_routes(self) -> None:
        """After a step, take back vehicles at the end, and go on with the lane changes under way."""
        self._watch_route_ends()
        changing = [(key, change) for key, change in self._changing.items() if key in self._route_ends]
        self._changing = {key: change for key, change in changing if change.go_on(self._sumo)}

    def _watch_route_ends(self) -> None:
        """Take back vehicles that SUMO would remove at the next step."""
        for key, edge in list(self._route_ends.items()):
            if edge is None:
                continue
            left = self._sumo.vehicle.getDrivingDistance(key, edge, self._sumo.lane.getLength(f"{edge}_0"))
            if 0 <= left <= (self._sumo.vehicle.getSpeed(key) + _MAX_GAIN_MPS) * STEP_S + _ARRIVAL_M:
                del self._route_ends[key]
                self._take_back(key)

    def _take_back(self, key: str) -> None:
        x, y = self._sumo.vehicle.getPosition(key)
        angle, speed = self._sumo.vehicle.getAngle(key), self._sumo.vehicle.getSpeed(key)
        self._straight_on.append(_Pose(key, x, y, angle, speed))
