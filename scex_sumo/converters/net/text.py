"""Text in SUMO's nets: shapes, and the stretches of lanelets under the lanes of a converted net.

Junctions hold the same ground under several lanes, so `convert` writes the stretches into each lane.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray

DECIMALS = 3  # millimetres: what SUMO's tools expect
KEY = "lanelets"
JOINT_M = 0.05  # where road follows road, the lane between takes this much of both
BEYOND = 0  # road before or behind the map's border, and between lanelets that do not meet
LANE_WIDTH_M = 3.2  # SUMO's own for lanes without a width
CHANGED_M = 1e-3  # difference of lengths from which a lane was changed


def shape_text(line: FloatArray, decimals: int = DECIMALS) -> str:
    """Format a polyline as SUMO does: ``x,y x,y``."""
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return " ".join(
        f"{x:.{decimals}f},{y:.{decimals}f}" for x, y in (np.round(line, decimals) + 0.0).tolist()
    )


def points_of(shape: str) -> FloatArray:
    """Return the points (P, 2) of a shape; SUMO may mix points with and without a height."""
    return np.array([point.split(",")[:2] for point in shape.split()], dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class LaneletPart:
    """A stretch of a lanelet (or `BEYOND`) under a lane, in m along the lanelet; width and limit are the
    lanelet's.
    """

    lanelet: int
    start: float
    end: float
    width: float
    speed: float


def parts_text(stretches: Iterable[LaneletPart]) -> str:
    """Format the stretches as a value of the net."""
    return " ".join(
        ",".join([str(s.lanelet), *(f"{v:.9f}" for v in (s.start, s.end, s.width, s.speed))])
        for s in stretches
    )
