"""Map matching: the lanes that vehicles may be on, by position and heading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

OFFSET_SIGMA_M = 0.8  # half a lane off is two sigma
HEADING_SIGMA_RAD = 0.15  # 8.6 degrees
OFFSET_MARGIN_M = 1.0  # maps and tracks disagree that much
HEADING_LIMIT_RAD = np.deg2rad(60.0)
CELL_M = 2.0  # a lane is wider
MAX_CELLS = 2**20


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Candidate lanes of several vehicles, flat (m,), sorted by vehicle, most probable first.

    Attributes:
        vehicle: index into the arguments of `match`.
        s: arc length of the foot point on the centreline, m.
        offset: signed distance to the centreline, m, left positive.
        heading_error: vehicle minus lane, rad.
        probability: sums to 1 over the candidates of a vehicle.
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
    lengths = [np.hypot(step[:, 0], step[:, 1]) for step in steps]
    step, length = np.concatenate([np.empty((0, 2)), *steps]), np.concatenate([np.empty(0), *lengths])
    s = np.concatenate([np.empty(0), *(np.cumsum(part) - part for part in lengths)])
    start = np.concatenate([np.empty((0, 2)), *(lane.centreline[:-1] for lane in lanes)])
    keep = length > 0
    direction = step[keep] / length[keep, None]
    counts = np.array([len(part) for part in lengths], dtype=np.int64)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Centreline segments that a pose in a cell may match.

    Attributes:
        low: (2,) lower left corner of the map, m.
        shape: cells along x and y, each ``size`` m wide.
        first: (cells + 1,) begin of each cell in `segment`, whose indices ascend within a cell.
    """

    low: FloatArray
    size: float
    shape: tuple[int, int]
    first: IntArray
    segment: IntArray

    def near(self, x: FloatArray, y: FloatArray) -> tuple[IntArray, IntArray]:
        """Return pairs of pose and segment that may match, by pose, then by segment."""
        column, row = np.floor((x - self.low[0]) / self.size), np.floor((y - self.low[1]) / self.size)
        inside = (column >= 0) & (column < self.shape[0]) & (row >= 0) & (row < self.shape[1])
        pose = np.flatnonzero(inside)
        cell = column[pose].astype(np.int64) * self.shape[1] + row[pose].astype(np.int64)
        begin = self.first[cell]
        count = self.first[cell + 1] - begin
        shift = begin - (np.cumsum(count) - count)
        return np.repeat(pose, count), self.segment[np.arange(count.sum()) + np.repeat(shift, count)]


@owner_cache
def _grid(road: Road) -> Grid:
    segments = lane_segments(road)
    if not len(segments.owner):
        nothing = np.zeros(1, dtype=np.int64)
        return Grid(low=np.zeros(2), size=CELL_M, shape=(0, 0), first=nothing, segment=nothing[:0])
    reach = segments.reach[segments.owner][:, None]
    end = segments.start + segments.length[:, None] * segments.direction
    lows, highs = np.minimum(segments.start, end) - reach, np.maximum(segments.start, end) + reach
    low, extent = lows.min(axis=0), highs.max(axis=0) - lows.min(axis=0)
    size = max(CELL_M, float(np.sqrt(extent.prod() / MAX_CELLS)))
    columns, rows = (int(n) for n in np.floor(extent / size).astype(np.int64) + 1)
    from_cell = np.floor((lows - low) / size).astype(np.int64)
    spans = np.floor((highs - low) / size).astype(np.int64) - from_cell + 1
    counts = spans.prod(axis=1)
    segment = np.repeat(np.arange(len(counts)), counts)
    nth = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    column = from_cell[segment, 0] + nth // spans[segment, 1]
    row = from_cell[segment, 1] + nth % spans[segment, 1]
    middle = low + size * (np.column_stack([column, row]) + 0.5) - segments.start[segment]
    along = np.clip((middle * segments.direction[segment]).sum(axis=1), 0.0, segments.length[segment])
    distance = np.hypot(*(middle - along[:, None] * segments.direction[segment]).T)
    close = distance <= reach[segment, 0] + size * np.sqrt(0.5) + 1e-6
    cell, segment = (column * rows + row)[close], segment[close]
    order = np.lexsort((segment, cell))
    first = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=columns * rows))])
    return Grid(low=low, size=size, shape=(columns, rows), first=first, segment=segment[order])


def match(road: Road, x: FloatArray, y: FloatArray, heading: FloatArray) -> Matches:
    """Find the lanes that vehicles (n,) may be on; a vehicle off the mapped lanes has none.

    A lane is a candidate if the centre is at most `OFFSET_MARGIN_M` outside its bounds and the heading within
    `HEADING_LIMIT_RAD` of the lane's. Its likelihood is that of its best centreline segment:
    exp(-(distance/0.8 m)^2/2 - (heading difference/0.15 rad)^2/2).
    """
    segments = lane_segments(road)
    pose, segment = _grid(road).near(x, y)
    error = wrap(heading[pose] - segments.angle[segment])
    aligned = np.abs(error) <= HEADING_LIMIT_RAD
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
    changes = np.flatnonzero((np.diff(pose) != 0) | (np.diff(lane) != 0)) + 1
    starts = np.concatenate([np.zeros(min(1, len(pose)), dtype=np.int64), changes])
    best = _first_of_the_cheapest(cost, starts)
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


def _first_of_the_cheapest(cost: FloatArray, starts: IntArray) -> IntArray:
    if not len(starts):
        return starts
    count = np.diff(np.append(starts, len(cost)))
    smallest = np.flatnonzero(cost == np.repeat(np.minimum.reduceat(cost, starts), count))
    return smallest[np.searchsorted(smallest, starts)]


def off_road(road: Road, scene: SeedScene) -> list[int]:
    """Return the indices of the vehicles that match no lane; they drive straight on."""
    now = scene.now
    matched = set(match(road, now.x, now.y, now.heading).vehicle.tolist())
    return [v for v in range(scene.vehicles) if v not in matched]
