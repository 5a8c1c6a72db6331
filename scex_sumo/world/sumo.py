"""SUMO's world: vehicles in tiles of libsumo or sumo-gui, moved to their planned states and read back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.scene import STEP_S, States
from scex_sumo.world.base import BatchStart, SumoDriven, WorldRequest
from scex_sumo.world.batch import (
    MATCH_M,
    NO_LANE,
    RunningBatch,
    Selection,
    angle_read_back,
    from_sumo,
    to_sumo,
    vehicle_ids,
)
from scex_sumo.world.session import ANY_ROUTE, SumoSession, load_sumo
from scex_sumo.world.tiles import tile_id
from scex_sumo.world.vehicle_types import TypeBook, road_class

if TYPE_CHECKING:
    from scex_sumo.base.colors import Rgb
    from scex_sumo.world.driven import SumoDrivers
    from scex_sumo.world.persons import People

_SAME_M = 0.5  # between a vehicle's start and where its simulation saved it


class SumoWorld:
    """SUMO simulation of a batch, each future in its tile; a context manager, one per process.

    Futures without SUMO drivers may share a tile, because moved vehicles do not react. One vehicle in SUMO
    then represents all with the same way, see `SharedVehicles`.
    """

    has_sumo = True

    def __init__(self, request: WorldRequest) -> None:
        """Build the tiles; SUMO starts with the first batch.

        ``request.gui`` shows sumo-gui; the last bits of positions may differ.
        """
        self._request, self._scene, self._gui = request, request.scene, request.gui
        self._temporary = TemporaryFolder()
        self._types = TypeBook(request.scene)
        self._session = SumoSession(request, self._types, Path(self._temporary.name))
        self._length = np.asarray(request.scene.length, dtype=np.float64)
        self._sumo: Any = None
        self._running: RunningBatch | None = None
        self._speeds: list[tuple[str, float, float]] = []
        self._routes = 0
        self._drivers: SumoDrivers | None = None
        self._persons: People | None = None
        self._walked: tuple[FloatArray, FloatArray, FloatArray] | None = None
        kinds = np.array([road_user(kind) == "pedestrian" for kind in self._scene.types], dtype=np.bool_)
        people = self._scene.people
        self._pedestrians = np.zeros_like(kinds) if people is None else kinds & people

    def __enter__(self) -> SumoWorld:
        return self

    def __exit__(self, *error: object) -> None:
        """End the simulation."""
        self._session.stop()
        self._running = None
        self._temporary.cleanup()

    def begin(
        self, batch: BatchStart, start: States | None = None, lights: Sequence[Element] | None = None
    ) -> SumoWorld:
        """Set all vehicles to the start of a batch; ``read`` of the world, this one, then equals it.

        Args:
            start: (C, V) states; None: those of the seed scene.
            lights: as a simulation saved them, in slot 0; its road users, all saved, then begin where they
                were, though the scene has them elsewhere, e.g. in a lane change that is drawn.
        """
        wanted, driven = [int(slot) for slot in batch.slots], batch.driven
        start = self._scene.now.repeat(len(wanted)) if start is None else start
        for d in driven:
            self._types.enter(d.vehicle, d.model, d.parameters)
        self._running = self._drivers = None
        self._speeds.clear()
        ids, offsets = vehicle_ids(wanted, self._scene.track_ids), map(self._session.layout.offset, wanted)
        watched, people = self._gui, self._pedestrians
        running = RunningBatch(start, driven, ids, wanted, list(offsets), watched=watched, pedestrians=people)
        self._running = running
        poses = self._poses(start)
        self._load(running, driven, poses, lights)
        self._persons = self._new_persons(running)
        with self._session.refusals(f"set up a batch of {len(wanted)} futures"):
            self._add_vehicles(running.split(poses), driven)
            placed = running.moved if running.loaded else running.everybody
            self._place(poses, placed, start.speed, np.zeros(start.shape))
            self._walk(poses)
        if others := self._scene.obstacles:
            self.move_obstacles(*others.at(0))
        if not running.loaded:
            self._advance(running)
        self._speeds.clear()
        running.held = np.where(running.speed < 0, 0.0, running.speed)
        if driven:
            from scex_sumo.world.driven import SumoDrivers

            with self._session.refusals("hand vehicles over to its drivers"):
                self._drivers = SumoDrivers(driven, running, self._scene, self._sumo, self._session.errors)
        if self._gui:
            from scex_sumo.base.colors import model_colors

            colors = model_colors(self._request.models)
            for (future, vehicle), model in np.ndenumerate(batch.assignment):
                self.color(future, vehicle, colors[model])
        return self

    def move(self, states: States, mask: BoolArray) -> None:
        """Set the next states (C, V) of the vehicles in the mask: from now on SUMO drives the others only."""
        batch = self._batch
        if left := int((~mask & batch.overridden).sum()):
            raise SimulationError(f"{left} vehicles not moved that SUMO does not drive")
        with self._session.refusals("move vehicles"):
            taken = mask & ~batch.overridden & ~batch.gone
            if self._drivers is not None and taken.any():
                self._drivers.take_over(taken)
            poses = self._poses(states)
            self._add_vehicles(batch.split(poses))
            self._place(poses, batch.moved, states.speed, (states.speed - batch.speed) / STEP_S)
            self._walk(poses)
        np.copyto(batch.speed, states.speed, where=mask)

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Set the states (O,) of pedestrians and cyclists after the next step, for SUMO's drivers."""
        if self._persons is not None and (others := self._scene.obstacles) is not None:
            with self._session.refusals("move pedestrians and cyclists"):
                self._persons.put_obstacles(others, states, present)

    def step(self) -> None:
        """Advance by 0.1 s."""
        batch = self._batch
        if self._drivers is not None:
            with self._session.refusals("move vehicles on beyond the end of their route"):
                self._speeds += self._drivers.go_straight_on()
        self._advance(batch)
        if self._drivers is not None:
            with self._session.refusals("follow routes"):
                self._drivers.follow_routes()

    def read(self) -> States:
        """Return SUMO's states (C, V), headings in (-pi, pi]; NaN of vehicles that have arrived.

        The speed of a moved vehicle is the one that was set, see ``_advance``; so is the pose of a person.
        """
        batch, get = self._batch, self._sumo.vehicle
        with self._session.refusals("read vehicles"):
            ids, shared = batch.everybody.ids, batch.everybody.shared
            read = np.full((3, len(batch.shared.held)), np.nan)
            fronts = chain.from_iterable(map(get.getPosition, ids))
            read[:2, shared] = np.fromiter(fronts, np.float64, 2 * len(ids)).reshape(-1, 2).T
            read[2, shared] = np.fromiter(map(get.getAngle, ids), np.float64, len(ids))
            speed = batch.held.copy()
            speed[batch.gone] = np.nan
            for k in np.flatnonzero(~(batch.overridden | batch.gone)):
                speed.flat[k] = get.getSpeed(batch.ids[k])
        place = batch.shared.place.reshape(batch.overridden.shape)
        x, y, angle = read[:, place]
        if self._walked is not None:
            x, y, angle = np.where(batch.walking, self._walked, read[:, place])
        return from_sumo(x - batch.offset[0], y - batch.offset[1], angle, speed, self._length)

    def follow(self, vehicle: int, edges: Sequence[str]) -> None:
        """Set the route of a vehicle in the first future, unless it leads to the last of the edges."""
        batch, ask = self._batch, self._sumo.vehicle
        key, slot = batch.id_of(0, vehicle), batch.slots[0]
        with suppress(*self._session.errors):  # none from its lane
            if ask.getRoute(key)[-1] != tile_id(slot, edges[-1]):
                ask.setRoute(key, [tile_id(slot, edge) for edge in edges])

    def save(self, folder: Path) -> None:
        """Write a state for ``--load-state``, without persons that stand where they were put."""
        with self._session.refusals("save its state"):
            if self._persons is not None:
                self._persons.remove_put()
            self._sumo.simulation.saveState(str(folder / "state.xml"))

    def color(self, future: int, vehicle: int, rgb: Rgb) -> None:
        """Colour a vehicle in sumo-gui; does nothing without it, nor to a person."""
        if self._gui and not self._batch.walking[future, vehicle]:
            with self._session.refusals("colour a vehicle"):
                self._sumo.vehicle.setColor(self._batch.id_of(future, vehicle), (*rgb, 255))

    @property
    def _batch(self) -> RunningBatch:
        if self._running is None:
            raise SimulationError("no batch is running in this world; begin one first")
        return self._running

    def _poses(self, states: States) -> tuple[FloatArray, FloatArray, FloatArray]:
        front_x, front_y, angle = to_sumo(states, self._length)
        return front_x + self._batch.offset[0], front_y + self._batch.offset[1], angle

    def _place(
        self, poses: Sequence[FloatArray], selection: Selection, speed: FloatArray, acceleration: FloatArray
    ) -> None:
        x, y, degrees = (values.reshape(-1)[selection.index].tolist() for values in poses)
        move = self._sumo.vehicle.moveToXY
        for key, to_x, to_y, turned, lanes in zip(selection.ids, x, y, degrees, selection.lanes, strict=True):
            move(key, "", NO_LANE, to_x, to_y, turned, lanes, MATCH_M)
        if selection.watched:
            ids, index = [selection.ids[i] for i in selection.watched], selection.index[selection.watched]
            speeds, changes = (values.reshape(-1)[index].tolist() for values in (speed, acceleration))
            self._speeds.extend(zip(ids, speeds, changes, strict=True))

    def _load(
        self,
        batch: RunningBatch,
        driven: Sequence[SumoDriven],
        poses: Sequence[FloatArray],
        lights: Sequence[Element] | None,
    ) -> None:
        """Get SUMO ready: empty, or with the road users of a simulation as that one saved them."""
        module = load_sumo(gui=self._gui)
        if driven and self._scene.intentions:
            from scex_sumo.world.loaded import state_with, users_of

            if users := users_of(self._scene, batch, driven, self._types):
                now_s, own = self._scene.time_s, lights or ()
                filled = partial(state_with, users=users.values(), time_s=now_s, lights=own)
                self._sumo = self._session.ready(module, filled)
                places = zip(batch.ids, *(values.reshape(-1).tolist() for values in poses[:2]), strict=True)
                ask = self._sumo.vehicle.getPosition
                mine = ((key, there) for key, *there in places if key in users)
                if lights is not None or all(math.dist(ask(key), there) < _SAME_M for key, there in mine):
                    batch.loaded = set(users)
                    batch.obstacles = batch.loaded & set(self._sumo.vehicle.getIDList()) - set(batch.ids)
                    return  # else the scene was changed since
        self._sumo = self._session.ready(module)

    def _new_persons(self, batch: RunningBatch) -> People | None:
        """Return the persons of a batch; None if SUMO sees nobody on foot or bicycle in it."""
        self._walked = None
        if not batch.mixed.any() or (self._scene.obstacles is None and self._scene.people is None):
            return None
        from scex_sumo.world.persons import People, walking_places

        return People(
            self._sumo, walking_places(self._request.net.path.read_bytes()), self._scene, batch, self._types
        )

    def _walk(self, poses: tuple[FloatArray, FloatArray, FloatArray]) -> None:
        """Set the poses (C, V) of SUMO's persons after the next step."""
        batch = self._batch
        if self._persons is not None and batch.walking.any():
            self._persons.put_pedestrians(poses)
            self._walked = *poses[:2], angle_read_back(poses[2])

    def _advance(self, batch: RunningBatch) -> None:
        """Run one step of SUMO, count the vehicles, and set the speeds of moved vehicles."""
        with self._session.refusals("advance"):
            self._sumo.simulation.step()
            if self._drivers is not None and (arrived := self._drivers.arrived()):
                batch.leave(arrived)
            if batch.loaded:
                batch.obstacles.difference_update(self._sumo.simulation.getArrivedIDList())
            if self._sumo.vehicle.getIDCount() != len(batch.everybody.ids) + len(batch.obstacles):
                batch.refuse_losses(self._sumo.vehicle.getIDList())
            set_speed = self._sumo.vehicle.setPreviousSpeed
            for key, speed, acceleration in self._speeds:
                set_speed(key, speed, acceleration)
        self._speeds.clear()
        batch.held = np.where(batch.speed < 0, 0.0, batch.speed)

    def _add_vehicles(self, new: IntArray, driven: Sequence[SumoDriven] = ()) -> None:
        batch, vehicles = self._batch, self._scene.vehicles
        by_sumo = {d.future * vehicles + d.vehicle: d for d in driven}
        there = batch.loaded
        for index in new.tolist():
            future, v = divmod(index, vehicles)
            key, slot = batch.ids[index], batch.slots[future]
            if (d := by_sumo.get(index)) and key in there:
                continue
            if d:
                self._routes += 1
                route, intention = f"route{self._routes}", self._scene.intention(v)
                behind = () if intention is None else intention.behind
                self._sumo.route.add(route, [tile_id(slot, edge) for edge in (*behind, *d.edges)])
                kind = self._types.driven(v, d.model, d.parameters)
                self._sumo.vehicle.add(key, route, kind, arrivalPos=d.arrival or "max")
                if intention is not None:
                    self._sumo.vehicle.setSpeedFactor(key, intention.speed_factor)
            elif not batch.walking[future, v]:
                if key not in there:
                    self._sumo.vehicle.add(key, tile_id(slot, ANY_ROUTE), self._types.overridden(v))
                if batch.mixed[future]:
                    # Else others give way to lane changes that never happen.
                    self._sumo.vehicle.setLaneChangeMode(key, 0)
                    kind = self._scene.types[v]
                    own = road_class(kind) if self._persons is None else self._persons.places.road_class(kind)
                    self._sumo.vehicle.setVehicleClass(key, own)
