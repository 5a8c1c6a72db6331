"""Pedestrians, cyclists and replayed vehicles in SUMO's world, for SUMO's drivers and for sumo-gui."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.scene import HISTORY_STEPS, REPLAYED, SeedScene, States
from scex_sumo.world.batch import MATCH_M, NO_LANE, OWN_LANE, RunningBatch, to_sumo
from scex_sumo.world.session import ANY_ROUTE
from scex_sumo.world.tiles import tile_id
from scex_sumo.world.vehicle_types import TypeBook, road_class

REACH_M = 250.0  # between vehicles that can meet within some seconds


def put_obstacles(
    scene: SeedScene, batch: RunningBatch, sumo: Any, types: TypeBook, states: States, present: BoolArray
) -> None:
    """Set the states (O,) after the next step, in futures with SUMO drivers or a watcher."""
    others = scene.obstacles
    assert others is not None
    front_x, front_y, angle = to_sumo(states, others.length)
    for future in np.flatnonzero(batch.mixed):
        slot, (dx, dy) = batch.slots[future], batch.offset[:, future, 0]
        for o in obstacles_in_reach(scene):
            key = tile_id(slot, f"other{others.ids[o]}")
            if present[o]:
                if key not in batch.obstacles:
                    sumo.vehicle.add(key, tile_id(slot, ANY_ROUTE), types.obstacle(o))
                    sumo.vehicle.setVehicleClass(key, road_class(others.types[o]))
                    batch.obstacles.add(key)
                x, y = float(front_x[o] + dx), float(front_y[o] + dy)
                sumo.vehicle.moveToXY(key, "", NO_LANE, x, y, float(angle[o]), OWN_LANE, MATCH_M)
            elif key in batch.obstacles:
                sumo.vehicle.remove(key)
                batch.obstacles.remove(key)


@owner_cache
def obstacles_in_reach(scene: SeedScene) -> list[int]:
    """Return the obstacles of SUMO's world: replayed vehicles far from all simulated ones are left out."""
    if (others := scene.obstacles) is None:
        return []
    now, there = scene.now, others.states[:, HISTORY_STEPS]
    apart = np.hypot(there.x[:, None] - now.x, there.y[:, None] - now.y).min(axis=1)
    return [o for o, kind in enumerate(others.types) if kind != REPLAYED or apart[o] <= REACH_M]
