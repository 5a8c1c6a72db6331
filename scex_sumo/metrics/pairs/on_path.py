"""Car-following on planned paths: the leader is the next vehicle on the follower's own path.

A vehicle is on the path where the strip that the follower sweeps meets it: its centre is nearer to the path
than half of both widths, and its heading is within the following angle of the path's direction there. The
path goes on straight beyond the planned end, because a driver who stops behind a leader plans a path that
ends before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray, least_of
from scex_sumo.geometry.crossings import meeting_segments, octagon
from scex_sumo.metrics.pairs.by_heading import ROUNDING, gather
from scex_sumo.metrics.pairs.entries import Following, Placed
from scex_sumo.metrics.pairs.paths_ahead import PathsAhead, meeting_pairs, paths_ahead
from scex_sumo.metrics.pairs.scenes import Scenes

SHORTEST_PATH_M = 0.1  # a shorter path has no direction of its own, the heading has


def following_on_path(scenes: Scenes) -> Following:
    """The next vehicle ahead of every vehicle on its own path, bumper to bumper along it."""
    if scenes.planned is None or len(scenes.pairs[0]) == 0:
        return gather(scenes, np.empty(0, dtype=np.int64), np.empty(0))
    found = scenes.of_ordered_pairs(_on_paths)
    follower, _ = scenes.flat_of(found.where)
    # The next one: the smallest arc length to its centre.
    chosen = np.sort(least_of(follower, found.along))
    return gather(scenes, found.where[chosen], found.gap[chosen])


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnPaths(Placed):
    """Vehicles on the paths of others.

    Attributes:
        along: (N,) arc length of the path to the vehicle's centre, m.
        gap: (N,) between the bumpers, m.
    """

    along: FloatArray
    gap: FloatArray


def _on_paths(scenes: Scenes) -> _OnPaths:
    where, along, gap = _Corridors(scenes, paths_ahead(scenes)).vehicles_on_paths()
    return _OnPaths(where=where, along=along, gap=gap)


class _Corridors:
    """Ordered pairs (path of the first, centre of the second) and where they are near each other."""

    def __init__(self, scenes: Scenes, paths: PathsAhead) -> None:
        self.scenes, self.paths = scenes, paths
        self.count = int(np.prod(scenes.shape))
        parameters = scenes.parameters
        reach = np.maximum(parameters.path_extension, parameters.path_extension_time * scenes.speed)
        end = paths.lines.end_of(paths.line)
        path_ends = paths.has_path
        end_x, end_y = np.where(path_ends, end[0], scenes.x), np.where(path_ends, end[1], scenes.y)
        length = paths.length
        moves = length >= SHORTEST_PATH_M
        last = paths.lines.direction_of(paths.line)
        # A plan of one column has no segment of its own; the first segment gives the direction then.
        own = np.where(paths.first_length > 0, paths.first_length, 1.0)
        has_last = moves & (np.hypot(*last) > 0)
        along_x = np.where(has_last, last[0], np.where(moves, paths.dx / own, scenes.cos))
        along_y = np.where(has_last, last[1], np.where(moves, paths.dy / own, scenes.sin))
        # (V, C, T) straight pieces at both ends of the plan: start, extent, arc length at the start.
        self.first = (scenes.x, scenes.y, paths.dx, paths.dy, np.zeros_like(scenes.x))
        self.last = (end_x, end_y, along_x * reach, along_y * reach, length)

    def vehicles_on_paths(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Ascending flat index into (2P, C, T), arc length to the other's centre, gap of the bumpers."""
        row, other, where, near = self._close_pairs()
        found = [self._on_straight(piece, row, other) for piece in (self.first, self.last)]
        found.append(self._on_plan(row, other))
        entry = np.concatenate([part[0] for part in found])
        aside, along, cos = (np.concatenate([part[i] for part in found]) for i in (1, 2, 3))
        keep = np.flatnonzero(aside <= near[entry])
        entry, aside, along, cos = entry[keep], aside[keep], along[keep], cos[keep]
        # Of the pieces near a vehicle the nearest one tells where on the path it is, of equals the first.
        best = least_of(entry, aside, along)
        limit = np.cos(self.scenes.parameters.following_angle) - ROUNDING
        best = best[(along[best] > 0) & (cos[best] >= limit)]
        entry, along = entry[best], along[best]
        half = (self._size(self.scenes.length, row[entry]) + self._size(self.scenes.length, other[entry])) / 2
        return where[entry], along, np.maximum(along - half, 0.0)

    def _size(self, array: FloatArray, vehicle: IntArray) -> FloatArray:
        """Length or width of vehicles given by flat index into (V, C, T)."""
        return self.scenes.size_of(array, *np.divmod(vehicle, self.count))

    def _close_pairs(self) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
        """Pairs whose boxes meet: flat index of path and other, index into (2P, C, T), widest offset."""
        scenes = self.scenes
        ends = octagon(self.last[0] + self.last[2], self.last[1] + self.last[3])
        ahead = self.paths.boxes_ahead
        low, high = np.minimum(ahead[:, 0], ends), np.maximum(ahead[:, 1], ends)
        half = np.broadcast_to(scenes.width / 2, scenes.x.shape)
        # Twice the reach covers the octagon's diagonal directions too.
        boxes = np.stack([low - 2 * half, high + 2 * half], axis=1)
        centre = octagon(scenes.x, scenes.y)
        points = np.stack([centre - 2 * half, centre + 2 * half], axis=1)
        where = meeting_pairs(scenes, boxes, points, scenes.present, scenes.present)
        row, other = scenes.flat_of(where)
        near = (self._size(scenes.width, row) + self._size(scenes.width, other)) / 2
        return row, other, where, near

    def _on_straight(
        self, piece: tuple[FloatArray, ...], row: IntArray, other: IntArray
    ) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        x, y, dx, dy, arc = (array.reshape(-1)[row] for array in piece)
        aside, share, cos = self._project(x, y, dx, dy, other)
        # Beyond the end of the last piece there is no path.
        keep = np.flatnonzero((dx != 0) | (dy != 0))
        along = arc + share * np.hypot(dx, dy)
        return keep, aside[keep], along[keep], cos[keep]

    def _on_plan(self, row: IntArray, other: IntArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        paths, scenes = self.paths, self.scenes
        with_plan = np.flatnonzero(paths.has_path.reshape(-1)[row])
        line = paths.line.reshape(-1)[row[with_plan]]
        centre = octagon(scenes.x.reshape(-1)[other[with_plan]], scenes.y.reshape(-1)[other[with_plan]])
        wide = self._size(scenes.width, row[with_plan]) + self._size(scenes.width, other[with_plan])
        which, segment = meeting_segments(np.stack([centre - wide, centre + wide], axis=1), paths.lines, line)
        column = paths.column[(row[with_plan[which]] % self.count) % scenes.shape[1]]
        # Beyond the last node a polyline is filled up with segments without length.
        keep = (segment >= column) & (np.abs(paths.lines.delta[:, line[which], segment]).max(axis=0) > 0)
        which, segment = which[keep], segment[keep]
        entry, at = with_plan[which], (line[which], segment)
        start, delta = paths.lines.start, paths.lines.delta
        aside, share, cos = self._project(
            start[0][at], start[1][at], delta[0][at], delta[1][at], other[entry]
        )
        along = paths.offset.reshape(-1)[row[entry]] + paths.lines.arc_at(*at, share)
        return entry, aside, along, cos

    def _project(
        self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, other: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance of centres to segments, share of the segment at the foot, cosine of heading to segment."""
        scenes = self.scenes
        gx, gy = scenes.x.reshape(-1)[other] - x, scenes.y.reshape(-1)[other] - y
        squared = dx * dx + dy * dy
        share = np.clip((gx * dx + gy * dy) / np.where(squared > 0, squared, 1.0), 0.0, 1.0)
        aside = np.hypot(gx - share * dx, gy - share * dy)
        heading = scenes.cos.reshape(-1)[other] * dx + scenes.sin.reshape(-1)[other] * dy
        return aside, share, heading / np.sqrt(np.where(squared > 0, squared, 1.0))
