"""Running batch of SUMO's world: its vehicles, and those with SUMO drivers; poses in SUMO's frame.

Ours: centre, counter-clockwise from east. SUMO's: front bumper, clockwise from north.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, distinct
from scex_sumo.base.errors import SimulationError
from scex_sumo.scene import States
from scex_sumo.world.base import SumoDriven
from scex_sumo.world.tiles import tile_id

# moveToXY's keepRoute: 1 = lane on the route, 2 = exact position, on a lane for the vehicle's class.
OWN_LANE = 2
_OWN_ROUTE = 2 + 1
# Distance of a vehicle to its lane. Faster than SUMO's 100 m; 5 m misses some forking lanes.
MATCH_M = 20.0
NO_LANE = -1


def to_sumo(states: States, length: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y (m) and angle (degrees in [0, 360)) in SUMO's frame of states (..., V).

    ``length`` is (V,) in m.
    """
    x = states.x + 0.5 * length * np.cos(states.heading)
    y = states.y + 0.5 * length * np.sin(states.heading)
    return x, y, np.mod(90.0 - np.degrees(states.heading), 360.0)


def angle_read_back(angle: FloatArray) -> FloatArray:
    """Return the angle in degrees as SUMO returns it: SUMO stores radians, 0 = east."""
    stored = np.pi / 2 - angle * np.pi / 180
    back = (np.pi / 2 - stored) * 180 / np.pi
    back = np.where(back >= 360.0, back - 360.0, back)
    degrees: FloatArray = np.where(back < 0.0, back + 360.0, back)
    return degrees


def from_sumo(
    front_x: FloatArray, front_y: FloatArray, angle: FloatArray, speed: FloatArray, length: FloatArray
) -> States:
    """Return states from SUMO's frame, the inverse of `to_sumo`; headings in (-pi, pi]."""
    heading = np.pi - np.mod(np.pi - np.radians(90.0 - angle), 2.0 * np.pi)
    return States(
        x=front_x - 0.5 * length * np.cos(heading),
        y=front_y - 0.5 * length * np.sin(heading),
        heading=heading,
        speed=speed,
    )


def vehicle_ids(slots: Sequence[int], track_ids: IntArray) -> list[str]:
    """Return unique SUMO ids, future by future; futures may share a tile."""
    ids, before = [], Counter[int]()
    for slot in slots:
        mark = f"~{before[slot]}" if before[slot] else ""
        ids += [tile_id(slot, f"{track}{mark}") for track in track_ids]
        before[slot] += 1
    return ids


def obstacle_id(slot: int, name: str) -> str:
    """Return SUMO's id of a replayed road user in a tile."""
    return tile_id(slot, f"other{name}")


class SharedVehicles:
    """Vehicles with bit-equal poses so far, which share one vehicle in SUMO.

    Attributes:
        held: (k,) vehicles in SUMO, ascending; none leaves.
        place: (N,) index of the shared vehicle in ``held``.
    """

    def __init__(self, group: IntArray) -> None:
        """Start without vehicles; only vehicles with equal ``group`` (N,) may share."""
        self.held = np.zeros(0, dtype=np.int64)
        self.place = np.zeros(len(group), dtype=np.int64)
        self._group = group

    def split(self, poses: Sequence[FloatArray]) -> IntArray:
        """Separate vehicles with different poses, each (N,), and return those new to SUMO."""
        if len(self.held) == len(self._group):
            return np.zeros(0, dtype=np.int64)
        first, self.place = distinct(np.stack([self._group, *poses], axis=1))
        new = np.setdiff1d(first, self.held, assume_unique=True)
        self.held, self._group = first, first[self.place]
        return new


@dataclass(frozen=True, kw_only=True, eq=False)
class Selection:
    """Selection of n vehicles in SUMO.

    Attributes:
        index: (n,) flat index into (C, V).
        shared: (n,) index into the shared vehicles.
        ids: (n) SUMO's ids.
        lanes: (n) moveToXY's ``keepRoute``.
        watched: indices into n of vehicles in mixed futures.
    """

    index: IntArray
    shared: IntArray
    ids: list[str]
    lanes: list[int]
    watched: list[int]


class RunningBatch:
    """Running batch of C futures.

    Attributes:
        offset: (2, C, 1) of the tiles, m.
        overridden: (C, V) False where SUMO drives.
        mixed: (C,) True with SUMO drivers or a watcher.
        walking: (C, V) SUMO's persons: pedestrians that take part in mixed futures.
        lanes: (C, V) moveToXY's ``keepRoute``.
        speed: (C, V) last speed set, where overridden.
        held: (C, V) the same after the last step, never negative.
        obstacles: ids of present obstacles which are vehicles in SUMO.
        gone: (C, V) vehicles that SUMO drove, and that have arrived.
        loaded: ids of road users that are in SUMO as their simulation saved them.
    """

    def __init__(
        self,
        start: States,
        driven: Sequence[SumoDriven],
        ids: list[str],
        slots: list[int],
        offsets: Sequence[tuple[float, float]],
        *,
        watched: bool,
        pedestrians: BoolArray,
    ) -> None:
        """Make a batch before its start; ``watched``: sumo-gui shows it; ``pedestrians`` (V,) take part."""
        self.slots, self.ids = slots, ids
        self.offset = np.array(offsets, dtype=np.float64).T[..., None]
        self.overridden = np.ones(start.shape, dtype=bool)
        for d in driven:
            self.overridden[d.future, d.vehicle] = False
        # Looking for lanes takes three quarters of the time, and only SUMO's drivers need it.
        self.mixed = np.full(len(slots), watched) | ~self.overridden.all(axis=1)
        mixed, vehicles = self.mixed[:, None], start.shape[1]
        self.walking = mixed & self.overridden & pedestrians
        self.lanes = np.where(mixed & self.overridden, OWN_LANE, _OWN_ROUTE)
        self.speed, self.held = start.speed.copy(), np.empty(start.shape)
        self.gone = np.zeros(start.shape, dtype=bool)
        own = np.arange(self.gone.size).reshape(start.shape)
        group = np.where(mixed, vehicles + own, np.arange(vehicles))
        self.shared = SharedVehicles(group.reshape(-1))
        self.obstacles, self.loaded = set[str](), set[str]()
        self._selected: dict[str, Selection] = {}

    def id_of(self, future: int, vehicle: int) -> str:
        """Return SUMO's id of a vehicle."""
        vehicles: int = self.overridden.shape[1]
        return self.ids[future * vehicles + vehicle]

    @property
    def everybody(self) -> Selection:
        """Vehicles in SUMO."""
        return self._select("everybody", ~self.walking & ~self.gone)

    @property
    def moved(self) -> Selection:
        """Vehicles in SUMO that it does not drive."""
        return self._select("moved", self.overridden & ~self.walking)

    def _select(self, name: str, mask: BoolArray) -> Selection:
        if name not in self._selected:
            shared = np.flatnonzero(mask.reshape(-1)[self.shared.held])
            index = self.shared.held[shared]
            watched = self.mixed[index // self.overridden.shape[1]]
            self._selected[name] = Selection(
                index=index,
                shared=shared,
                ids=[self.ids[i] for i in index.tolist()],
                lanes=self.lanes.reshape(-1)[index].tolist(),
                watched=np.flatnonzero(watched).tolist(),
            )
        return self._selected[name]

    def split(self, poses: Sequence[FloatArray]) -> IntArray:
        """Separate vehicles with different poses (C, V), and return the flat indices of those new to SUMO."""
        new = self.shared.split([values.reshape(-1) for values in poses])
        if len(new):
            self._selected.clear()
        return new

    def override(self, mask: BoolArray) -> None:
        """Move the vehicles in the mask (C, V) from now on, which SUMO drove."""
        self.overridden = self.overridden | mask
        self.lanes = np.where(mask, OWN_LANE, self.lanes)
        self._selected.clear()

    def leave(self, keys: Container[str]) -> None:
        """Take out vehicles that SUMO drove, by id."""
        there = np.flatnonzero(~(self.overridden | self.gone)).tolist()
        self.gone.flat[[k for k in there if self.ids[k] in keys]] = True
        self._selected.clear()

    def refuse_losses(self, held: Sequence[str]) -> None:
        """Raise a `SimulationError` with the vehicles that SUMO lost."""
        all_of_us = {*self.everybody.ids, *self.obstacles}
        lost = sorted(all_of_us - set(held))
        raise SimulationError(
            f"SUMO lost {len(lost)} of {len(all_of_us)} vehicles ({', '.join(lost[:3])}, ...); "
            "please report this with the seed scene"
        )
