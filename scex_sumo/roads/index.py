"""Map matching of many poses at once, and how the lanes of a road relate: what the scene graph looks up.

The same candidates as `scex_sumo.roads.matching.match`, but a pose is only compared with the centreline
segments near its cell of a grid laid over the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.derived import derived
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
from scex_sumo.roads.relations import LaneRelations, lane_relations

CELL_M = 2.0  # a lane is wider: smaller cells would hold the same segments
MOST_CELLS = 2**20  # of a grid; very large maps get larger cells


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
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
class RoadIndex:
    """The vehicle lanes of a road, ready for batches of poses; make it with `road_index`.

    Attributes:
        lane_id: (L,) ascending; the other tables count lanes in this order.
        length: (L,) of the centreline, m.
        speed_limit: (L,) m/s.
        relations: how each lane relates to each other one.
    """

    lane_id: IntArray
    length: FloatArray
    speed_limit: FloatArray
    relations: LaneRelations
    _segments: LaneSegments
    _angle: FloatArray  # (S,) of the segments, rad
    _grid: _Grid

    @property
    def nbytes(self) -> int:
        """Memory that the tables take."""
        grid = self._grid.first.nbytes + self._grid.segment.nbytes
        return grid + self.relations.nbytes + self._angle.nbytes * 8

    def match(self, x: FloatArray, y: FloatArray, heading: FloatArray) -> Matches:
        """Find the lanes that vehicles may be on, as `scex_sumo.roads.matching.match` does.

        Args:
            x: (n,) centres, m.
            y: (n,) centres, m.
            heading: (n,) rad.

        Returns:
            Candidates of all vehicles; a vehicle off the mapped lanes has none.
        """
        pose, segment, cost, t, offset, error = self._possible(x, y, heading)
        lane = self._segments.owner[segment]
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
            lane_id=self._segments.lane_id[lane[order]],
            s=self._segments.s[segment] + t[best],
            offset=offset[best],
            heading_error=error[best],
            probability=score / total[pose],
        )

    def _possible(
        self, x: FloatArray, y: FloatArray, heading: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """(pose, segment, cost, arc length on the segment, offset, heading error) of what may match."""
        some = self._segments
        pose, segment = self._grid.near(x, y)
        error = wrap(heading[pose] - self._angle[segment])
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
def road_index(road: Road) -> RoadIndex:
    """The index of a road; remembered for the last 16 roads."""
    segments = lane_segments(road)
    lanes = sorted(road.vehicle_lanes.values(), key=lambda lane: lane.lane_id)
    relations = lane_relations(lanes)
    return RoadIndex(
        lane_id=np.array([lane.lane_id for lane in lanes], dtype=np.int64),
        length=relations.length,
        speed_limit=np.array([lane.speed_limit_mps for lane in lanes], dtype=np.float64),
        relations=relations,
        _segments=segments,
        _angle=np.arctan2(segments.direction[:, 1], segments.direction[:, 0]),
        _grid=_grid(segments),
    )


def _grid(segments: LaneSegments) -> _Grid:
    """Enter each segment in the cells that have a point within its lane's reach (or a little more)."""
    if not len(segments.owner):
        nothing = np.zeros(1, dtype=np.int64)
        return _Grid(low=np.zeros(2), size=CELL_M, shape=(0, 0), first=nothing, segment=nothing[:0])
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
    return _Grid(low=low, size=size, shape=(columns, rows), first=first, segment=segment[order])
