"""Map matching: which lanes vehicles may be on, by position and heading.

A pose is only compared with the centreline segments near its cell of a grid laid over the map.
"""

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
CELL_M = 2.0  # a lane is wider: smaller cells would hold the same segments
MOST_CELLS = 2**20  # of a grid; very large maps get larger cells


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Which centreline segments a pose in a cell may match.

    Attributes:
        low: (2,) lower left corner of the map, m.
        size: of a cell, m.
        shape: cells along x and y.
        first: (cells + 1,) where the segments of a cell begin in `segment`.
        segment: (K,) indices of segments, ascending within a cell.
    """

    low: FloatArray
    size: float
    shape: tuple[int, int]
    first: IntArray
    segment: IntArray

    def near(self, x: FloatArray, y: FloatArray) -> tuple[IntArray, IntArray]:
        """Pairs of pose and segment that may match, by pose, then by segment."""
        column, row = np.floor((x - self.low[0]) / self.size), np.floor((y - self.low[1]) / self.size)
        # Written so that a pose that is not a number is outside.
        inside = (column >= 0) & (column < self.shape[0]) & (row >= 0) & (row < self.shape[1])
        pose = np.flatnonzero(inside)
        cell = column[pose].astype(np.int64) * self.shape[1] + row[pose].astype(np.int64)
        begin = self.first[cell]
        count = self.first[cell + 1] - begin
        shift = begin - (np.cumsum(count) - count)
        return np.repeat(pose, count), self.segment[np.arange(count.sum()) + np.repeat(shift, count)]


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneMatcher:
    """The vehicle lanes of a road, ready for batches of poses; make it with `lane_matcher`.

    Attributes:
        segments: of the centrelines.
        angle: (S,) of the segments, rad.
        grid: which of them are near.
    """

    segments: LaneSegments
    angle: FloatArray
    grid: Grid

    def match(self, x: FloatArray, y: FloatArray, heading: FloatArray) -> Matches:
        """The lanes that vehicles may be on, see `match`."""
        pose, segment, cost, t, offset, error = self._possible(x, y, heading)
        lane = self.segments.owner[segment]
        # Rows come by pose and segment, and the segments of a lane follow each other.
        changes = np.flatnonzero((np.diff(pose) != 0) | (np.diff(lane) != 0)) + 1
        starts = np.concatenate([np.zeros(min(1, len(pose)), dtype=np.int64), changes])
        best = _first_of_the_cheapest(cost, starts)
        pose, lane, segment = pose[best], lane[best], segment[best]
        # Floored, since a likelihood that underflows to zero could not be normalised.
        score = np.exp(-0.5 * np.minimum(cost[best], 600.0))
        order = np.lexsort((lane, -score, pose))
        best, pose, segment, score = best[order], pose[order], segment[order], score[order]
        total = np.bincount(pose, weights=score, minlength=len(x))
        return Matches(
            vehicle=pose,
            lane_id=self.segments.lane_id[lane[order]],
            s=self.segments.s[segment] + t[best],
            offset=offset[best],
            heading_error=error[best],
            probability=score / total[pose],
        )

    def _possible(
        self, x: FloatArray, y: FloatArray, heading: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """(pose, segment, cost, arc length on the segment, offset, heading error) of what may match."""
        some = self.segments
        pose, segment = self.grid.near(x, y)
        error = wrap(heading[pose] - self.angle[segment])
        aligned = np.abs(error) <= HEADING_LIMIT_RAD
        pose, segment, error = pose[aligned], segment[aligned], error[aligned]
        dx, dy = x[pose] - some.start[segment, 0], y[pose] - some.start[segment, 1]
        ux, uy = some.direction[segment, 0], some.direction[segment, 1]
        t = np.clip(dx * ux + dy * uy, 0.0, some.length[segment])
        distance = np.hypot(dx - t * ux, dy - t * uy)
        near = distance <= some.reach[some.owner[segment]]
        offset = (ux * dy - uy * dx)[near]
        error = error[near]
        cost = (distance[near] / OFFSET_SIGMA_M) ** 2 + (error / HEADING_SIGMA_RAD) ** 2
        return pose[near], segment[near], cost, t[near], offset, error


def _first_of_the_cheapest(cost: FloatArray, starts: IntArray) -> IntArray:
    """Row of the smallest cost of each group, the first of equals; groups begin at `starts`."""
    if not len(starts):
        return starts
    count = np.diff(np.append(starts, len(cost)))
    smallest = np.flatnonzero(cost == np.repeat(np.minimum.reduceat(cost, starts), count))
    return smallest[np.searchsorted(smallest, starts)]


@derived
def lane_matcher(road: Road) -> LaneMatcher:
    """The matcher of a road's vehicle lanes."""
    segments = lane_segments(road)
    angle = np.arctan2(segments.direction[:, 1], segments.direction[:, 0])
    return LaneMatcher(segments=segments, angle=angle, grid=_grid(segments))


def _grid(segments: LaneSegments) -> Grid:
    """Enter each segment in the cells that have a point within its lane's reach (or a little more)."""
    if not len(segments.owner):
        nothing = np.zeros(1, dtype=np.int64)
        return Grid(low=np.zeros(2), size=CELL_M, shape=(0, 0), first=nothing, segment=nothing[:0])
    reach = segments.reach[segments.owner][:, None]
    end = segments.start + segments.length[:, None] * segments.direction
    lows, highs = np.minimum(segments.start, end) - reach, np.maximum(segments.start, end) + reach
    low, extent = lows.min(axis=0), highs.max(axis=0) - lows.min(axis=0)
    size = max(CELL_M, float(np.sqrt(extent.prod() / MOST_CELLS)))
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
    return lane_matcher(road).match(x, y, heading)


def off_road(road: Road, scene: SeedScene) -> list[int]:
    """Indices of the vehicles of a seed scene that no mapped lane fits; they go straight on."""
    now = scene.now
    matched = set(match(road, now.x, now.y, now.heading).vehicle.tolist())
    return [v for v in range(scene.vehicles) if v not in matched]
