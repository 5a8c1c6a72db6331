"""Map matching without a grid: every pose with every segment, slow and plain."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.roads.matching import (
    HEADING_LIMIT_RAD,
    HEADING_SIGMA_RAD,
    OFFSET_SIGMA_M,
    LaneSegments,
    Matches,
    lane_segments,
)


def plain_match(road: Road, x: FloatArray, y: FloatArray, heading: FloatArray) -> Matches:
    """Find the lanes that vehicles may be on, as `match` does."""
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
    lane_first = np.searchsorted(segments.owner, np.arange(len(segments.lane_id)))
    best = np.minimum.reduceat(cost, lane_first, axis=1)
    hit, index = np.nonzero(np.isfinite(best)[:, segments.owner] & (cost == best[:, segments.owner]))
    # Of equally good segments of one lane the first one counts.
    _, unique = np.unique(hit * len(lane_first) + segments.owner[index], return_index=True)
    hit, index = hit[unique], index[unique]
    # Floored, since a likelihood that underflows to zero could not be normalised.
    score = np.exp(-0.5 * np.minimum(cost[hit, index], 600.0))
    s = segments.s[index] + t[hit, index]
    return hit + first, segments.owner[index], s, offset[hit, index], error[hit, index], score
