"""Perception: everyone on the road in one set of arrays, and the map around one vehicle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.road import Road
from scex_sumo.scene import SceneHistory, States


@dataclass(frozen=True, kw_only=True, eq=False)
class Everyone:
    """Vehicles and obstacles of all children together; M = V + O columns.

    Attributes:
        states: (C, M) now.
        present: (C, M).
        length: (M,) m.
        width: (M,) m.
        obstacle: (M,) False for the vehicles.
        longest: the largest diagonal, m.
    """

    states: States
    present: BoolArray
    length: FloatArray
    width: FloatArray
    obstacle: BoolArray
    longest: float


def everyone(history: SceneHistory) -> Everyone:
    """Vehicles and obstacles in one set of arrays."""
    scene, now = history.scene, history.now
    present = np.ones(now.shape, dtype=np.bool_)
    length, width = scene.length, scene.width
    obstacles = scene.obstacles
    if obstacles is not None and history.obstacle_states is not None and history.obstacle_present is not None:
        shape = (now.shape[0], len(obstacles.ids))
        spread = history.obstacle_states.map(lambda values: np.broadcast_to(values, shape))
        now = States.concatenate([now, spread], axis=1)
        present = np.concatenate([present, np.broadcast_to(history.obstacle_present, shape)], axis=1)
        length = np.concatenate([length, obstacles.length])
        width = np.concatenate([width, obstacles.width])
    longest = float(np.sqrt(length**2 + width**2).max(initial=0.0))
    obstacle = np.arange(len(length)) >= scene.vehicles
    return Everyone(
        states=now, present=present, length=length, width=width, obstacle=obstacle, longest=longest
    )


def narrow_road(road: Road, x: float, y: float, radius: float) -> Road:
    """The part of the map that a vehicle sees: lanes, markings and areas with a point within the radius.

    Args:
        x: the vehicle's centre, m.
        y: the vehicle's centre, m.
        radius: m.
    """

    def near(points: FloatArray) -> bool:
        return bool(len(points) and (np.hypot(points[:, 0] - x, points[:, 1] - y) <= radius).any())

    lanes = {
        i: lane
        for i, lane in road.lanes.items()
        if near(lane.centreline) or near(lane.left_bound) or near(lane.right_bound)
    }
    return replace(
        road,
        lanes=lanes,
        regulations=tuple(r for r in road.regulations if any(i in lanes for i in r.lanes)),
        markings=tuple(m for m in road.markings if near(m.points)),
        areas=tuple(a for a in road.areas if near(a.outline)),
    )
