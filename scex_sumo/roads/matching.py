"""Map matching: the lanes that vehicles may be on, by position and heading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray, IntArray, least_of
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

OFFSET_SIGMA_M = 0.8  # half a lane off is two sigma
HEADING_SIGMA_RAD = 0.15  # 8.6 degrees
OFFSET_MARGIN_M = 1.0  # maps and tracks disagree that much
HEADING_LIMIT_RAD = float(np.deg2rad(60.0))
SLACK_M = 1e-6  # of boxes, against rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Candidate lanes of several vehicles, flat (m,), sorted by vehicle, most probable first."""

    vehicle: IntArray  # index into the arguments of `match`
    lane_id: IntArray
    s: FloatArray  # arc length of the foot point on the centreline, m
    offset: FloatArray  # from the centreline, m, left positive
    heading_error: FloatArray  # vehicle minus lane, rad
    probability: FloatArray  # sums to 1 over the candidates of a vehicle

    @property
    def best(self) -> IntArray:
        """Index of the most probable candidate of each vehicle that has one."""
        return np.unique(self.vehicle, return_index=True)[1].astype(np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneSegments:
    """Centreline segments of all vehicle lanes, flat; those of one lane are consecutive."""

    lane_id: IntArray  # (M,)
    reach: FloatArray  # (M,) half width and margin, m
    owner: IntArray  # (S,) index into lane_id
    start: FloatArray  # (S, 2)
    direction: FloatArray  # (S, 2) unit
    angle: FloatArray  # (S,) rad
    length: FloatArray  # (S,)
    s: FloatArray  # (S,) arc length at the start


@owner_cache
def lane_segments(road: Road) -> LaneSegments:
    """Return the centreline segments of a road's vehicle lanes, lanes by ascending id."""
    lanes = sorted(road.vehicle_lanes.values(), key=lambda lane: lane.lane_id)
    steps = [np.diff(lane.centreline, axis=0) for lane in lanes]
    lengths = [np.hypot(*step.T) for step in steps]
    step, length = np.concatenate([np.empty((0, 2)), *steps]), np.concatenate([np.empty(0), *lengths])
    s = np.concatenate([np.empty(0), *(np.cumsum(sizes) - sizes for sizes in lengths)])
    start = np.concatenate([np.empty((0, 2)), *(lane.centreline[:-1] for lane in lanes)])
    keep = length > 0
    direction = step[keep] / length[keep, None]
    counts = np.array([len(sizes) for sizes in lengths], dtype=np.int64)
    usable, owner = np.unique(np.repeat(np.arange(len(lanes)), counts)[keep], return_inverse=True)
    return LaneSegments(
        lane_id=np.array([lanes[i].lane_id for i in usable], dtype=np.int64),
        reach=np.array([lanes[i].width_m / 2 + OFFSET_MARGIN_M for i in usable]),
        owner=owner,
        start=start[keep],
        direction=direction,
        angle=np.arctan2(direction[:, 1], direction[:, 0]),
        length=length[keep],
        s=s[keep],
    )


@owner_cache
def _reaches(road: Road) -> shapely.STRtree:
    segments = lane_segments(road)
    reach = segments.reach[segments.owner][:, None] + SLACK_M
    end = segments.start + segments.length[:, None] * segments.direction
    low, high = np.minimum(segments.start, end) - reach, np.maximum(segments.start, end) + reach
    return shapely.STRtree(shapely.box(*low.T, *high.T))


def match(
    road: Road, x: FloatArray, y: FloatArray, heading: FloatArray, *, within_rad: float = HEADING_LIMIT_RAD
) -> Matches:
    """Find the lanes that vehicles (n,) may be on; a vehicle off the mapped lanes has none.

    A lane is a candidate if the centre is at most `OFFSET_MARGIN_M` outside its bounds and the heading within
    ``within_rad`` of the lane's. Its likelihood is that of its best centreline segment:
    exp(-(distance/0.8 m)^2/2 - (heading difference/0.15 rad)^2/2).
    """
    segments = lane_segments(road)
    near_by = _reaches(road).query(shapely.points(x, y))
    pose, segment = near_by[:, np.lexsort(near_by[::-1])]
    error = wrap(heading[pose] - segments.angle[segment])
    aligned = np.abs(error) <= within_rad
    pose, segment, error = pose[aligned], segment[aligned], error[aligned]
    dx, dy = x[pose] - segments.start[segment, 0], y[pose] - segments.start[segment, 1]
    ux, uy = segments.direction[segment, 0], segments.direction[segment, 1]
    t = np.clip(dx * ux + dy * uy, 0.0, segments.length[segment])
    distance = np.hypot(dx - t * ux, dy - t * uy)
    near = distance <= segments.reach[segments.owner[segment]]
    offset = (ux * dy - uy * dx)[near]
    pose, segment, error, t = pose[near], segment[near], error[near], t[near]
    cost = (distance[near] / OFFSET_SIGMA_M) ** 2 + (error / HEADING_SIGMA_RAD) ** 2
    lane = segments.owner[segment]
    changes = (np.diff(pose, prepend=-1) != 0) | (np.diff(lane, prepend=-1) != 0)
    best = least_of(np.cumsum(changes) - 1, cost)
    pose, lane, segment = pose[best], lane[best], segment[best]
    # A likelihood of zero could not be normalised.
    score = np.exp(-0.5 * np.minimum(cost[best], 600.0))
    order = np.lexsort((lane, -score, pose))
    best, pose, segment, score = best[order], pose[order], segment[order], score[order]
    total = np.bincount(pose, weights=score, minlength=len(x))
    return Matches(
        vehicle=pose,
        lane_id=segments.lane_id[lane[order]],
        s=segments.s[segment] + t[best],
        offset=offset[best],
        heading_error=error[best],
        probability=score / total[pose],
    )


def off_road(road: Road, scene: SeedScene, *, any_direction: bool = False) -> list[int]:
    """Return the indices of the vehicles that match no lane; they drive straight on.

    ``any_direction``: a lane of another direction is a lane, too.
    """
    now, within = scene.now, np.pi if any_direction else HEADING_LIMIT_RAD
    matched = set(match(road, now.x, now.y, now.heading, within_rad=within).vehicle.tolist())
    return [v for v in range(scene.vehicles) if v not in matched]
