"""SUMO's world: vehicles in tiles of libsumo or sumo-gui, moved to their planned states and read back."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.colors import Rgb, model_colors
from scex_sumo.base.errors import SimulationError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.scene import HISTORY_STEPS, REPLAYED, STEP_S, SeedScene, States
from scex_sumo.world.base import BatchStart, SumoDriven, World, WorldRequest
from scex_sumo.world.batch import (
    ANY_LANE,
    CAR_LANE,
    RunningBatch,
    Selection,
    from_sumo,
    new_batch,
    to_sumo,
    vehicle_ids,
)
from scex_sumo.world.session import ANY_ROUTE, SumoSession, VehicleCalls, load_sumo
from scex_sumo.world.tiles import TILE_SLOTS, tile_id
from scex_sumo.world.vehicle_types import TypeBook

if TYPE_CHECKING:
    from scex_sumo.converters.net.sumo_net import SumoNet

__all__ = ["TILE_SLOTS", "SumoDriven", "SumoSimulator", "SumoWorld"]
# Distance of a vehicle to its lane. Faster than SUMO's 100 m; 5 m misses some forking lanes.
_MATCH_M = 20.0
_REACH_M = 250.0  # between vehicles that can meet within some seconds
_NO_LANE = -1
_AS_TOLD = 0b0001010101  # SUMO's lane change mode: its own decisions, and told ones without regard of gaps


class SumoWorld:
    """SUMO simulation of a batch, each future in its tile; a context manager, one per process.

    Futures without SUMO drivers may share a tile, because moved vehicles do not react. One vehicle in SUMO
    then represents all with the same way, see `SharedVehicles`.
    """

    def __init__(
        self,
        net: SumoNet,
        scene: SeedScene,
        *,
        slots: Sequence[int],
        gui: bool = False,
        delay_ms: int = 100,
        legend: Sequence[tuple[str, Rgb]] = (),
    ) -> None:
        """Build the tiles; SUMO starts with the first batch.

        Args:
            slots: tile slots of all batches, each below ``TILE_SLOTS``.
            gui: show sumo-gui; the last bits of positions may differ.
        """
        self._scene = scene
        self._temporary = TemporaryFolder()
        self._types = TypeBook(scene)
        self._session = SumoSession(
            net, slots, self._types, Path(self._temporary.name), gui=gui, delay_ms=delay_ms, legend=legend
        )
        self._gui = gui
        self._length = np.asarray(scene.length, dtype=np.float64)
        self._sumo: Any = None
        self._running: RunningBatch | None = None
        self._speeds: list[tuple[str, float, float]] = []
        self._routes = 0
        self._changing: dict[str, int] = {}
        self._obstacles = _obstacles_in_reach(scene)

    def __enter__(self) -> SumoWorld:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the simulation; may be called again."""
        self._session.stop()
        self._running = None
        self._temporary.cleanup()

    def begin(self, start: States, slots: IntArray, driven: Sequence[SumoDriven] = ()) -> None:
        """Set all vehicles to the start of a batch; ``read`` then equals ``start``.

        Args:
            start: (C, V) states of the seed scene.
            slots: (C,) tile slots; futures without SUMO drivers may share one.
            driven: vehicles that SUMO drives; all others must be moved before each step.
        """
        wanted, tiles = [int(slot) for slot in slots], self._session.slots
        if missing := sorted(set(wanted) - set(tiles)):
            raise SimulationError(f"no tile for slots {missing}; this world has tiles for {tiles}")
        for d in driven:
            self._types.enter(d.vehicle, d.model, d.parameters)
        self._running = None
        self._speeds.clear()
        self._changing.clear()
        self._sumo = self._session.ready(load_sumo(gui=self._gui))
        self._call = VehicleCalls.of(self._sumo)
        ids = vehicle_ids(wanted, self._scene.track_ids)
        offsets = [self._session.layout.offset(slot) for slot in wanted]
        batch = new_batch(start, driven, ids=ids, slots=wanted, offsets=offsets, watched=self._gui)
        self._running = batch
        batch.refuse_shared_slots()
        with self._session.refusals(f"set up a batch of {len(wanted)} futures"):
            poses = self._poses(start)
            self._add_vehicles(batch.split(poses), driven)
            self._place(poses, batch.everybody, start.speed, np.zeros(start.shape))
        if others := self._scene.obstacles:
            self.move_obstacles(others.states[:, HISTORY_STEPS], others.present[:, HISTORY_STEPS])
        self._advance(batch)
        with self._session.refusals("hand vehicles over to its drivers"):
            batch.hand_over(driven, self._sumo)
            self._plan_stops(batch, driven)
            self._go_on_changing(batch, driven)

    def _plan_stops(self, batch: RunningBatch, driven: Sequence[SumoDriven]) -> None:
        for d in driven:
            intention = self._scene.intention(d.vehicle)
            key, slot = batch.id_of(d.future, d.vehicle), batch.slots[d.future]
            for stop in () if intention is None else intention.stops:
                edge, _, lane = stop.lane.rpartition("_")
                begin_s = STEP_S if stop.until_s >= 0 else 0.0  # a future begins at 0.1 s of its simulation
                with suppress(*self._session.errors):  # too near to brake, or off the route
                    self._sumo.vehicle.setStop(
                        key,
                        tile_id(slot, edge),
                        stop.end_m,
                        int(lane),
                        stop.duration_s,
                        stop.flags,
                        stop.start_m,
                        stop.until_s + begin_s,
                    )

    def _go_on_changing(self, batch: RunningBatch, driven: Sequence[SumoDriven]) -> None:
        """Let vehicles go on that change their lanes, whoever is beside them, as SUMO had decided."""
        for d in driven:
            intention, key = self._scene.intention(d.vehicle), batch.id_of(d.future, d.vehicle)
            if intention is not None and intention.change:
                with suppress(*self._session.errors):  # no lane there
                    self._changing[key] = self._sumo.vehicle.getLaneChangeMode(key)
                    self._sumo.vehicle.setLaneChangeMode(key, _AS_TOLD)
                    self._sumo.vehicle.changeLaneRelative(key, intention.change, STEP_S)

    def move(self, states: States, mask: BoolArray) -> None:
        """Set the next states (C, V) of the vehicles in the mask: from now on SUMO drives the others only."""
        batch = self._batch
        if left := int((~mask & batch.overridden).sum()):
            raise SimulationError(f"{left} vehicles not moved that SUMO does not drive")
        with self._session.refusals("move vehicles"):
            batch.take_over(mask & ~batch.overridden, self._sumo)
            poses = self._poses(states)
            self._add_vehicles(batch.split(poses))
            self._place(poses, batch.moved, states.speed, (states.speed - batch.speed) / STEP_S)
        np.copyto(batch.speed, states.speed, where=mask)

    def move_obstacles(self, states: States, present: BoolArray) -> None:
        """Set the states (O,) of pedestrians and cyclists after the next step, for SUMO's drivers."""
        batch, others = self._batch, self._scene.obstacles
        if others is None:
            return
        front_x, front_y, angle = to_sumo(states, others.length)
        with self._session.refusals("move pedestrians and cyclists"):
            for future in np.flatnonzero(batch.mixed):
                slot, (dx, dy) = batch.slots[future], batch.offset[:, future, 0]
                for o in self._obstacles:
                    name = others.ids[o]
                    key = tile_id(slot, f"other{name}")
                    if present[o]:
                        if key not in batch.obstacles:
                            self._sumo.vehicle.add(key, tile_id(slot, ANY_ROUTE), self._types.obstacle(o))
                            # Vehicles on crossings and walking areas crash libsumo 1.28.
                            self._sumo.vehicle.setVehicleClass(key, "passenger")
                            batch.obstacles.add(key)
                        x, y = float(front_x[o] + dx), float(front_y[o] + dy)
                        self._put(key, x, y, float(angle[o]), lanes=CAR_LANE)
                    elif key in batch.obstacles:
                        self._sumo.vehicle.remove(key)
                        batch.obstacles.remove(key)

    def step(self) -> None:
        """Advance by 0.1 s."""
        batch = self._batch
        with self._session.refusals("move vehicles on beyond the end of their route"):
            for pose in batch.go_straight_on():
                self._put(pose.key, pose.x, pose.y, pose.angle)
                self._speeds.append((pose.key, pose.speed, 0.0))
        self._advance(batch)
        with self._session.refusals("follow routes"):
            for key, mode in self._changing.items():
                self._sumo.vehicle.setLaneChangeMode(key, mode)
            self._changing.clear()
            batch.watch_route_ends(self._sumo)

    def read(self) -> States:
        """Return SUMO's states (C, V), headings in (-pi, pi].

        The speed of a moved vehicle is the one that was set, see ``_advance``.
        """
        batch, get = self._batch, self._call
        shape = batch.overridden.shape
        with self._session.refusals("read vehicles"):
            held, place = batch.everybody.ids, batch.shared.place.reshape(shape)
            ends = chain.from_iterable(map(get.getPosition, held))
            front = np.fromiter(ends, np.float64, 2 * len(held)).reshape(-1, 2)[place]
            angle = np.fromiter(map(get.getAngle, held), np.float64, len(held))[place]
            speed = batch.held.copy()
            for future in np.flatnonzero(batch.mixed):
                mine = batch.ids[future * shape[1] : (future + 1) * shape[1]]
                speed[future] = list(map(get.getSpeed, mine))
        x, y = front[..., 0] - batch.offset[0], front[..., 1] - batch.offset[1]
        return from_sumo(x, y, angle, speed, self._length)

    def save(self, folder: Path) -> None:
        """Write net, vehicle types and a state for ``--load-state``."""
        for file in ("tiles.net.xml", "types.add.xml"):
            shutil.copyfile(Path(self._temporary.name) / file, folder / file)
        with self._session.refusals("save its state"):
            self._sumo.simulation.saveState(str(folder / "state.xml"))

    def color(self, future: int, vehicle: int, rgb: Rgb) -> None:
        """Colour a vehicle in sumo-gui; does nothing without it."""
        if self._gui:
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
        self, poses: Sequence[FloatArray], some: Selection, speed: FloatArray, acceleration: FloatArray
    ) -> None:
        x, y, degrees = (values.reshape(-1)[some.index].tolist() for values in poses)
        move = self._call.moveToXY
        for key, to_x, to_y, turned, lanes in zip(some.ids, x, y, degrees, some.lanes, strict=True):
            move(key, "", _NO_LANE, to_x, to_y, turned, lanes, _MATCH_M)
        if some.watched:
            at = some.index[some.watched]
            speeds, changes = (values.reshape(-1)[at].tolist() for values in (speed, acceleration))
            self._speeds.extend(zip([some.ids[i] for i in some.watched], speeds, changes, strict=True))

    def _put(self, key: str, x: float, y: float, angle: float, *, lanes: int = ANY_LANE) -> None:
        self._sumo.vehicle.moveToXY(key, "", _NO_LANE, x, y, angle, lanes, _MATCH_M)

    def _advance(self, batch: RunningBatch) -> None:
        """Run one step of SUMO, count the vehicles, and set the speeds of moved vehicles."""
        with self._session.refusals("advance"):
            self._sumo.simulation.step()
            if self._sumo.vehicle.getIDCount() != len(batch.everybody.ids) + len(batch.obstacles):
                batch.refuse_losses(self._sumo.vehicle.getIDList())
            set_speed = self._call.setPreviousSpeed
            for key, speed, acceleration in self._speeds:
                set_speed(key, speed, acceleration)
        self._speeds.clear()
        batch.held = np.where(batch.speed < 0, 0.0, batch.speed)

    def _add_vehicles(self, new: IntArray, driven: Sequence[SumoDriven] = ()) -> None:
        batch, vehicles = self._batch, self._scene.vehicles
        by_sumo = {d.future * vehicles + d.vehicle: d for d in driven}
        for index in new.tolist():
            future, v = divmod(index, vehicles)
            key, slot = batch.ids[index], batch.slots[future]
            if d := by_sumo.get(index):
                self._routes += 1
                route = f"route{self._routes}"
                self._sumo.route.add(route, [tile_id(slot, edge) for edge in d.edges])
                self._sumo.vehicle.add(key, route, self._types.driven(v, d.model, d.parameters))
                if (intention := self._scene.intention(v)) is not None:
                    self._sumo.vehicle.setSpeedFactor(key, intention.speed_factor)
            else:
                self._sumo.vehicle.add(key, tile_id(slot, ANY_ROUTE), self._types.overridden(v))
                if batch.mixed[future]:
                    # Else others give way to lane changes that never happen.
                    self._sumo.vehicle.setLaneChangeMode(key, 0)


def _obstacles_in_reach(scene: SeedScene) -> list[int]:
    """Return the obstacles of SUMO's world: replayed vehicles far from all simulated ones are left out."""
    if (others := scene.obstacles) is None:
        return []
    now, there = scene.now, others.states[:, HISTORY_STEPS]
    apart = np.hypot(there.x[:, None] - now.x, there.y[:, None] - now.y).min(axis=1)
    return [o for o, kind in enumerate(others.types) if kind != REPLAYED or apart[o] <= _REACH_M]


class SumoSimulator:
    """Simulator of SUMO's worlds: one `SumoWorld`, vehicles in the colours of their models."""

    has_sumo = True

    def __init__(self, request: WorldRequest) -> None:
        self._scene, self._gui = request.scene, request.gui
        self._colors = model_colors(request.models)
        legend = tuple(zip(request.models, self._colors, strict=True))
        self._world = SumoWorld(
            request.net, request.scene, slots=request.slots, gui=request.gui, legend=legend
        )

    def __enter__(self) -> SumoSimulator:
        return self

    def __exit__(self, *error: object) -> None:
        self._world.close()

    def begin(self, batch: BatchStart) -> World:
        """Return the world, set to the seed scene."""
        self._world.begin(self._scene.now.repeat(len(batch.slots)), batch.slots, batch.driven)
        if self._gui:
            for (future, vehicle), model in np.ndenumerate(batch.assignment):
                self._world.color(future, vehicle, self._colors[model])
        return self._world
