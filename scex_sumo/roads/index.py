"""Road index: the lanes of a road as tables, and how they relate; what the scene graph looks up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.derived import derived
from scex_sumo.road import Road
from scex_sumo.roads.relations import LaneRelations, lane_relations


@dataclass(frozen=True, kw_only=True, eq=False)
class RoadIndex:
    """The vehicle lanes of a road; make it with `road_index`.

    Attributes:
        lane_id: (L,) ascending; the other tables count lanes in this order.
        speed_limit: (L,) m/s.
        relations: how each lane relates to each other one.
    """

    lane_id: IntArray
    speed_limit: FloatArray
    relations: LaneRelations


@derived
def road_index(road: Road) -> RoadIndex:
    """The index of a road, kept with it."""
    lanes = sorted(road.vehicle_lanes.values(), key=lambda lane: lane.lane_id)
    return RoadIndex(
        lane_id=np.array([lane.lane_id for lane in lanes], dtype=np.int64),
        speed_limit=np.array([lane.speed_limit_mps for lane in lanes], dtype=np.float64),
        relations=lane_relations(lanes),
    )
