"""Map matching: which lanes vehicles may be on, by position and heading."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.derived import derived
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

OFFSET_SIGMA_M = 0.8  # half a lane off is two sigma
HEADING_SIGMA_RAD = 0.15  # 8.6 degrees
OFFSET_MARGIN_M = 1.0  # centres this far outside the bounds still match: maps and tracks disagree that much
HEADING_LIMIT_RAD = np.deg2rad(60.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Candidate lanes of several vehicles as flat columns, sorted by vehicle, most probable first.

    Attributes:
        vehicle: (m,) index into the arguments of `match`.
        lane_id: (m,) the lane.
        s: (m,) arc length of the foot point on the lane's centreline, m.
        offset: (m,) signed distance to the centreline, m, left positive.
        heading_error: (m,) vehicle minus lane, rad.
        probability: (m,) sums to 1 over the candidates of a vehicle.
    """

    vehicle: IntArray
    lane_id: IntArray
    s: FloatArray
    offset: FloatArray
    heading_error: FloatArray
    probability: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneSegments:
    """Centreline segments of all vehicle lanes, flat; those of one lane are consecutive."""

    lane_id: IntArray  # (M,)
    first: IntArray  # (M,) index of the lane's first segment
    reach: FloatArray  # (M,) half width and margin, m
    owner: IntArray  # (S,) index into lane_id
    start: FloatArray  # (S, 2)
    direction: FloatArray  # (S, 2) unit
    length: FloatArray  # (S,)
    s: FloatArray  # (S,) arc length at the start


@derived
def lane_segments(road: Road) -> LaneSegments:
    """Centreline segments of a road's vehicle lanes, lanes in ascending order of their ids."""
    lanes = sorted(road.vehicle_lanes.values(), key=lambda lane: lane.lane_id)
    steps = [np.diff(lane.centreline, axis=0) for lane in lanes]
    lengths = [np.hypot(d[:, 0], d[:, 1]) for d in steps]
    keep = [h > 0 for h in lengths]
    counts = np.array([int(k.sum()) for k in keep])
    usable = [i for i, n in enumerate(counts) if n]
    counts = counts[usable] if usable else np.zeros(0, dtype=np.int64)

    def flat(parts: Iterable[FloatArray], empty: tuple[int, ...]) -> FloatArray:
        listed = list(parts)
        return np.concatenate(listed) if listed else np.empty(empty)

    length = flat((lengths[i][keep[i]] for i in usable), (0,))
    return LaneSegments(
        lane_id=np.array([lanes[i].lane_id for i in usable], dtype=np.int64),
        first=np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64) if usable else counts,
        reach=np.array([lanes[i].width_m / 2 + OFFSET_MARGIN_M for i in usable]),
        owner=np.repeat(np.arange(len(usable)), counts),
        start=flat((lanes[i].centreline[:-1][keep[i]] for i in usable), (0, 2)),
        direction=flat((steps[i][keep[i]] for i in usable), (0, 2)) / length[:, None],
        length=length,
        s=flat(((np.cumsum(lengths[i]) - lengths[i])[keep[i]] for i in usable), (0,)),
    )


def match(road: Road, x: FloatArray, y: FloatArray, heading: FloatArray) -> Matches:
    """Find the lanes that vehicles may be on, by position and heading.

    A lane is a candidate where the centre is at most `OFFSET_MARGIN_M` outside its bounds and the heading
    within `HEADING_LIMIT_RAD` of the lane's. Each centreline segment gets the likelihood
    exp(-(distance/0.8 m)^2/2 - (heading difference/0.15 rad)^2/2); a lane has that of its best segment, so
    that a short kink in a centreline does not throw the match off.

    Args:
        road: the map.
        x: (n,) centres, m.
        y: (n,) centres, m.
        heading: (n,) rad.

    Returns:
        Candidates of all vehicles; a vehicle off the mapped lanes has none.
    """
    segments = lane_segments(road)
    if not len(segments.lane_id) or not len(x):
        none, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
        return Matches(
            vehicle=none, lane_id=none, s=nothing, offset=nothing, heading_error=nothing, probability=nothing
        )
    parts = [_match_some(segments, x[i : i + 64], y[i : i + 64], heading[i : i + 64], i)
             for i in range(0, len(x), 64)]  # chunks bound the memory on large maps  # fmt: skip
    vehicle, lane, s, offset, error, score = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((segments.lane_id[lane], -score, vehicle))
    vehicle, lane, score = vehicle[order], lane[order], score[order]
    total = np.bincount(vehicle, weights=score, minlength=len(x))
    return Matches(
        vehicle=vehicle,
        lane_id=segments.lane_id[lane],
        s=s[order],
        offset=offset[order],
        heading_error=error[order],
        probability=score / total[vehicle],
    )


def _match_some(
    segments: LaneSegments, x: FloatArray, y: FloatArray, heading: FloatArray, first: int
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """(vehicle, lane index, s, offset, heading error, likelihood) of a chunk of vehicles."""
    dx = x[:, None] - segments.start[:, 0]
    dy = y[:, None] - segments.start[:, 1]
    ux, uy = segments.direction.T
    t = np.clip(dx * ux + dy * uy, 0.0, segments.length)
    offset = ux * dy - uy * dx
    distance = np.hypot(dx - t * ux, dy - t * uy)
    error = wrap(heading[:, None] - np.arctan2(uy, ux))
    cost = (distance / OFFSET_SIGMA_M) ** 2 + (error / HEADING_SIGMA_RAD) ** 2
    possible = (distance <= segments.reach[segments.owner]) & (np.abs(error) <= HEADING_LIMIT_RAD)
    cost = np.where(possible, cost, np.inf)
    best = np.minimum.reduceat(cost, segments.first, axis=1)
    hit, index = np.nonzero(np.isfinite(best)[:, segments.owner] & (cost == best[:, segments.owner]))
    # Of equally good segments of one lane the first one counts.
    _, unique = np.unique(hit * len(segments.first) + segments.owner[index], return_index=True)
    hit, index = hit[unique], index[unique]
    # Floored, since a likelihood that underflows to zero could not be normalised.
    score = np.exp(-0.5 * np.minimum(cost[hit, index], 600.0))
    s = segments.s[index] + t[hit, index]
    return hit + first, segments.owner[index], s, offset[hit, index], error[hit, index], score


def off_road(road: Road, scene: SeedScene) -> list[int]:
    """Indices of the vehicles of a seed scene that no mapped lane fits; they go straight on."""
    now = scene.now
    matched = set(match(road, now.x, now.y, now.heading).vehicle.tolist())
    return [v for v in range(scene.vehicles) if v not in matched]
