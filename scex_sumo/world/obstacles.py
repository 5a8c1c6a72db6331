"""Pedestrians, cyclists and replayed vehicles in SUMO's world, for SUMO's drivers and for sumo-gui."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.converters.tracks.road_users import obstacle_kinds, road_user
from scex_sumo.scene import HISTORY_STEPS, REPLAYED, Obstacles, SeedScene, States
from scex_sumo.world.batch import MATCH_M, NO_LANE, OWN_LANE, RunningBatch, obstacle_id, to_sumo
from scex_sumo.world.persons import Person, Persons
from scex_sumo.world.session import ANY_ROUTE
from scex_sumo.world.tiles import tile_id
from scex_sumo.world.vehicle_types import PERSON, WALKER, TypeBook

_STANDS_MPS, _WALKS_MPS = 0.3, 1.39
REACH_M = 250.0  # between vehicles that can meet within some seconds


def put_obstacles(
    scene: SeedScene,
    batch: RunningBatch,
    persons: Persons,
    sumo: Any,
    types: TypeBook,
    states: States,
    present: BoolArray,
) -> None:
    """Set the states (O,) after the next step, in futures with SUMO drivers or a watcher."""
    others = scene.obstacles
    assert others is not None
    front_x, front_y, angle = to_sumo(states, others.length)
    kinds, (places, front_x, front_y) = obstacle_kinds(others), persons.places.find(front_x, front_y, angle)
    starts = _starts(scene, persons)
    for future in np.flatnonzero(batch.mixed):
        slot, (dx, dy) = batch.slots[future], batch.offset[:, future, 0]
        for o in obstacles_in_reach(scene):
            key = obstacle_id(slot, others.ids[o])
            if key in batch.loaded:
                continue
            x, y, turned = float(front_x[o] + dx), float(front_y[o] + dy), float(angle[o])
            if road_user(kinds[o]) == "pedestrian":
                if present[o] and (at_m := starts[o]) is not None:
                    persons.walk(
                        key, types.obstacle(o) + WALKER, slot, others.walks[o], at_m, _speed(others, o)
                    )
                elif present[o]:
                    persons.put(Person(key, types.obstacle(o) + PERSON, slot, places[o]), x, y, turned)
                else:
                    persons.remove(key)
            elif present[o]:
                if key not in batch.obstacles:
                    sumo.vehicle.add(key, tile_id(slot, ANY_ROUTE), types.obstacle(o))
                    sumo.vehicle.setVehicleClass(key, persons.places.road_class(kinds[o]))
                    batch.obstacles.add(key)
                sumo.vehicle.moveToXY(key, "", NO_LANE, x, y, turned, OWN_LANE, MATCH_M)
            elif key in batch.obstacles:
                sumo.vehicle.remove(key)
                batch.obstacles.remove(key)


def _starts(scene: SeedScene, persons: Persons) -> list[float | None]:
    """Return where persons (O,) of a simulation begin on their walks, m; None of others."""
    others = scene.obstacles
    assert others is not None
    x, y, _ = to_sumo(others.states[:, HISTORY_STEPS], others.length)
    rows = zip(others.walks, x.tolist(), y.tolist(), strict=True) if others.walks else ()
    return [persons.places.along(*row) for row in rows] or [None] * len(others.ids)


def _speed(others: Obstacles, o: int) -> float:
    """Return the speed of a person, m/s: its largest one in the last second, if it does not stand."""
    speed = float(others.states.speed[o, : HISTORY_STEPS + 1].max())
    return speed if speed > _STANDS_MPS else _WALKS_MPS


def put_pedestrians(
    batch: RunningBatch, persons: Persons, types: TypeBook, poses: tuple[FloatArray, FloatArray, FloatArray]
) -> None:
    """Set the poses (C, V) of pedestrians that take part after the next step."""
    at = np.nonzero(batch.walking)
    x, y, angle = (values[at] for values in poses)
    dx, dy = batch.offset[:, at[0], 0]
    places, at_x, at_y = persons.places.find(x - dx, y - dy, angle)
    x, y = at_x + dx, at_y + dy
    rows = zip(*(values.tolist() for values in (*at, places, x, y, angle)), strict=True)
    for future, v, place, *pose in rows:
        key, slot = batch.id_of(future, v), batch.slots[future]
        persons.put(Person(key, types.overridden(v) + PERSON, slot, place), *pose)


@owner_cache
def obstacles_in_reach(scene: SeedScene) -> list[int]:
    """Return the obstacles of SUMO's world: replayed vehicles far from all simulated ones are left out."""
    if (others := scene.obstacles) is None:
        return []
    now, there = scene.now, others.states[:, HISTORY_STEPS]
    apart = np.hypot(there.x[:, None] - now.x, there.y[:, None] - now.y).min(axis=1)
    return [o for o, kind in enumerate(others.types) if kind != REPLAYED or apart[o] <= REACH_M]
