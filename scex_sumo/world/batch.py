"""What a world knows of its running batch, and what it does for the vehicles that SUMO drives."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.errors import SimulationError
from scex_sumo.scene import STEP_S, States
from scex_sumo.world.stand_ins import StandIns
from scex_sumo.world.tiles import tile_id

# moveToXY's keepRoute, which decides where SUMO looks for the lane that the vehicle is on; the vehicle is put
# exactly where it should be in any case (2). 1 = only along the vehicle's route; 4 = lanes of any permission.
ANY_LANE = 2 + 4
_OWN_ROUTE = 2 + 1

# No driver of SUMO's gains more speed than this in one step, m/s.
_MAX_GAIN_MPS = 1.0
# SUMO takes a vehicle for arrived 0.1 m before the end of its route.
_ARRIVAL_M = 0.2


@dataclass(frozen=True, kw_only=True)
class SumoDriven:
    """A vehicle that one of SUMO's own car-following models drives.

    Attributes:
        child: index in the batch.
        vehicle: index in the seed scene.
        model: SUMO's name of the model, e.g. ``EIDM``.
        parameters: attributes of SUMO's vehicle types, e.g. ``{"tau": "1.2"}``.
        edges: route in SUMO's edges, starting with the edge that the vehicle is on.
    """

    child: int
    vehicle: int
    model: str
    parameters: Mapping[str, str]
    edges: tuple[str, ...]


def vehicle_ids(slots: Sequence[int], track_ids: IntArray) -> list[str]:
    """SUMO's ids of the vehicles, child by child; children that share a tile are told apart."""
    ids, before = [], Counter[int]()
    for slot in slots:
        mark = f"~{before[slot]}" if before[slot] else ""
        ids += [tile_id(slot, f"{track}{mark}") for track in track_ids]
        before[slot] += 1
    return ids


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Where a vehicle is, in SUMO's terms.

    Attributes:
        key: SUMO's id of the vehicle.
        x: front bumper, m.
        y: front bumper, m.
        angle: degrees, 0 = north, clockwise.
        speed: m/s.
    """

    key: str
    x: float
    y: float
    angle: float
    speed: float

    def ahead(self) -> Pose:
        """The pose a step later, straight on at the same speed."""
        heading, way = math.radians(90.0 - self.angle), self.speed * STEP_S
        x, y = self.x + way * math.cos(heading), self.y + way * math.sin(heading)
        return Pose(key=self.key, x=x, y=y, angle=self.angle, speed=self.speed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Some:
    """Some vehicles of a batch, n of them.

    Attributes:
        index: (n,) flat index into (C, V).
        ids: (n) SUMO's ids.
        lanes: (n) which lanes SUMO looks for a vehicle on, moveToXY's ``keepRoute``.
        watched: those in children with drivers of SUMO's, or somebody who watches: index among the n.
    """

    index: IntArray
    ids: list[str]
    lanes: list[int]
    watched: list[int]


@dataclass(kw_only=True, eq=False)
class RunningBatch:
    """The running batch.

    Attributes:
        slots: tile slot of each child.
        ids: SUMO's ids of the vehicles, child by child.
        offset: (2, C, 1) x and y of the tiles, m.
        overridden: (C, V) False where SUMO drives.
        mixed: (C,) True where there are drivers of SUMO's, or somebody who watches.
        lanes: (C, V) which lanes SUMO looks for a vehicle on, moveToXY's ``keepRoute``.
        speed: (C, V) the speed last set, where overridden.
        held: (C, V) the same after the last step, never negative.
        stand_ins: the vehicles that SUMO holds, by flat index into (C, V).
        route_ends: last edge of the route of SUMO-driven vehicles, by id.
        straight_on: vehicles that SUMO drove until their route ended.
        obstacles: ids of the pedestrians and cyclists present.
    """

    slots: list[int]
    ids: list[str]
    offset: FloatArray
    overridden: BoolArray
    mixed: BoolArray
    lanes: IntArray
    speed: FloatArray
    held: FloatArray
    stand_ins: StandIns
    route_ends: dict[str, str] = field(default_factory=dict)
    straight_on: list[Pose] = field(default_factory=list)
    obstacles: set[str] = field(default_factory=set)
    _chosen: dict[bool, Some] = field(default_factory=dict)

    def id_of(self, child: int, vehicle: int) -> str:
        """SUMO's id of a vehicle."""
        vehicles: int = self.overridden.shape[1]
        return self.ids[child * vehicles + vehicle]

    @property
    def everybody(self) -> Some:
        """All vehicles that SUMO holds."""
        return self._some(driven=True)

    @property
    def moved(self) -> Some:
        """Those of them that SUMO does not drive."""
        return self._some(driven=False)

    def _some(self, *, driven: bool) -> Some:
        if driven not in self._chosen:
            index = self.stand_ins.held
            index = index if driven else index[self.overridden.reshape(-1)[index]]
            watched = self.mixed[index // self.overridden.shape[1]]
            self._chosen[driven] = Some(
                index=index,
                ids=[self.ids[i] for i in index.tolist()],
                lanes=self.lanes.reshape(-1)[index].tolist(),
                watched=np.flatnonzero(watched).tolist(),
            )
        return self._chosen[driven]

    def part_ways(self, poses: Sequence[FloatArray]) -> IntArray:
        """Tell vehicles apart that are put to different places, (C, V) each; who is new to SUMO (flat)."""
        new = self.stand_ins.part_ways([values.reshape(-1) for values in poses])
        if len(new):
            self._chosen.clear()
        return new

    def hand_over(self, driven: Sequence[SumoDriven], sumo: Any) -> None:
        """Let SUMO drive from here; on its lanes only: a vehicle beside them goes straight on instead."""
        for d in driven:
            key = self.id_of(d.child, d.vehicle)
            if sumo.vehicle.getLaneID(key):
                self.route_ends[key] = tile_id(self.slots[d.child], d.edges[-1])
            else:
                self._take_back(key, sumo)

    def watch_route_ends(self, sumo: Any) -> None:
        """Take back vehicles that SUMO would remove at the next step: their route ends there."""
        for key, edge in list(self.route_ends.items()):
            left = sumo.vehicle.getDrivingDistance(key, edge, sumo.lane.getLength(f"{edge}_0"))
            if 0 <= left <= (sumo.vehicle.getSpeed(key) + _MAX_GAIN_MPS) * STEP_S + _ARRIVAL_M:
                del self.route_ends[key]
                self._take_back(key, sumo)

    def go_straight_on(self) -> Iterator[Pose]:
        """Where the vehicles taken back are a step later."""
        self.straight_on = [pose.ahead() for pose in self.straight_on]
        yield from self.straight_on

    def refuse_shared_slots(self) -> None:
        """A `SimulationError` where children share a slot, one of them with drivers of SUMO's."""
        count = Counter(self.slots)
        mixed = {slot for slot, m in zip(self.slots, self.mixed, strict=True) if m}
        if shared := sorted(slot for slot in mixed if count[slot] > 1):
            raise SimulationError(
                f"slots {shared} hold several children, one of them with drivers of SUMO's or somebody who "
                "watches; give each a slot of its own"
            )

    def refuse_losses(self, held: Sequence[str]) -> None:
        """A `SimulationError` that names who is not among the vehicles that SUMO holds."""
        all_of_us = {*self.everybody.ids, *self.obstacles}
        lost = sorted(all_of_us - set(held))
        raise SimulationError(
            f"SUMO lost {len(lost)} of {len(all_of_us)} vehicles ({', '.join(lost[:3])}, ...); "
            "please report this with the seed scene"
        )

    def _take_back(self, key: str, sumo: Any) -> None:
        x, y = sumo.vehicle.getPosition(key)
        angle, speed = sumo.vehicle.getAngle(key), sumo.vehicle.getSpeed(key)
        self.straight_on.append(Pose(key=key, x=x, y=y, angle=angle, speed=speed))


def new_batch(
    start: States,
    driven: Sequence[SumoDriven],
    *,
    ids: list[str],
    slots: list[int],
    offsets: Sequence[tuple[float, float]],
    watched: bool,
) -> RunningBatch:
    """A batch that has not begun; arguments as `RunningBatch` has them, and whether somebody looks at it."""
    overridden = np.ones(start.shape, dtype=bool)
    for d in driven:
        overridden[d.child, d.vehicle] = False
    # Looking for lanes takes three quarters of the time, and is of use only to the drivers of SUMO's who
    # look for vehicles on their lanes: where there are none, SUMO need not look beyond one lane.
    mixed = np.full(len(slots), watched) | ~overridden.all(axis=1)
    children, vehicles = start.shape
    own = np.arange(children * vehicles).reshape(start.shape)
    alike = np.where(mixed[:, None], vehicles + own, np.arange(vehicles))
    return RunningBatch(
        slots=slots,
        ids=ids,
        offset=np.array(offsets, dtype=np.float64).T[..., None],
        overridden=overridden,
        mixed=mixed,
        lanes=np.where(mixed[:, None] & overridden, ANY_LANE, _OWN_ROUTE),
        speed=start.speed.copy(),
        held=np.empty(start.shape),
        stand_ins=StandIns(alike.reshape(-1)),
    )
