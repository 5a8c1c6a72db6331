"""Motion across lanes of drivers that break a rule: they cut in, or drift out of their lane."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, VehicleIndex

CHANGE_S = 3.0  # of a lane change, as SUMO's here
DRIFT_MPS = 0.8  # the fastest departure of ISO 17361, lane departure warning
DRIFT_M = 3.5
NEAR_M = 30.0  # along the way, to a vehicle beside
BESIDE_M = 1.5, 6.0  # across the way
LEFT, RIGHT = 1.0, -1.0


def offsets(
    history: SceneHistory, road: Road, paths: SeedPaths, row: IntArray, vehicles: VehicleIndex, kind: str
) -> FloatArray:
    """Return (n, 31) wanted offsets from the path, m, left positive, from the seed moment on.

    Towards the side on which another vehicle is nearest, else left; ``kind``: ``cuts_in`` or ``drifts``.
    """
    nearest = _nearest(history.scene)[vehicles.vehicle]
    time_s = STEP_S * (history.step + np.arange(PLAN_STEPS + 1.0))
    if kind == "drifts":
        side = np.where(nearest[:, 1] < nearest[:, 0], RIGHT, LEFT)
        return np.asarray(side[:, None] * np.minimum(DRIFT_MPS * time_s, DRIFT_M))
    width = np.array([_lane_widths(road, paths.lanes[k][:1]) for k in row.tolist()]).reshape(-1, 2)
    nearest = np.where(width > 0, nearest, np.inf)
    right = (nearest[:, 1] < nearest[:, 0]) | (width[:, 0] == 0)
    u = np.minimum(time_s / CHANGE_S, 1.0)
    lane_side: FloatArray = np.where(right, -width[:, 1], width[:, 0])[:, None]
    return np.asarray(lane_side * (u**3 * (10 - 15 * u + 6 * u**2)))


@owner_cache
def _nearest(scene: SeedScene) -> FloatArray:
    """Return (V, 2) distances along the way to the nearest vehicle on the left and on the right, m."""
    ahead, left = scene.now[:, None].ahead_and_left(scene.now.x, scene.now.y)
    aside = np.stack([LEFT * left, RIGHT * left], axis=1)  # (V, 2, V)
    beside = (aside > BESIDE_M[0]) & (aside < BESIDE_M[1]) & (np.abs(ahead) < NEAR_M)[:, None]
    return np.asarray(np.where(beside, np.abs(ahead)[:, None], np.inf).min(axis=2, initial=np.inf))


def _lane_widths(road: Road, lanes: tuple[int, ...]) -> tuple[float, float]:
    """Return the ways to the lanes on the left and right to which a change is allowed, m; 0 without."""
    if not lanes:
        return 0.0, 0.0
    lane = road.lanes[lanes[0]]
    beside = (None if i is None else road.lanes.get(i) for i in (lane.left, lane.right))
    left, right = ((lane.width_m + other.width_m) / 2 if other is not None else 0.0 for other in beside)
    return left, right
