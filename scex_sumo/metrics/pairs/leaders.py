"""Leaders: by heading as in the paper, and along planned paths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, least_of
from scex_sumo.geometry.crossings import Segments, meeting_segments, octagon
from scex_sumo.metrics.base import EXTENSION_M, EXTENSION_S, FOLLOWING_RAD
from scex_sumo.metrics.pairs.paths_ahead import PathsAhead, meeting_pairs, paths_ahead
from scex_sumo.metrics.pairs.scenes import Following, PairRows, Scenes

COSINE_ROUNDING = 1e-12  # a heading difference equal to the limit must not depend on the scene's rotation
MIN_PATH_M = 0.1  # a shorter path has no direction of its own; the heading counts
Straight: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Straight piece of each path (V, C, T): start x and y, step x and y, arc length at its start, m."""
Places: TypeAlias = tuple[IntArray, FloatArray, FloatArray, FloatArray]
"""Index of a pair, distance of the other one from the path, arc length there, m, cosine of the headings."""


def leaders_by_heading(scenes: Scenes) -> Following:
    """Find leaders as in the paper: headings within `FOLLOWING_RAD`, the leader ahead, no lane test.

    The gap is the distance of the centres. Two vehicles can each be the other's leader.
    """
    return scenes.of_ordered_pairs(_similar_and_ahead)


def _similar_and_ahead(scenes: Scenes) -> Following:
    first, second = scenes.pairs
    cos, sin = scenes.cos, scenes.sin
    alignment = cos[first] * cos[second]
    alignment += sin[first] * sin[second]
    similar = alignment >= np.cos(FOLLOWING_RAD) - COSINE_ROUNDING
    similar &= scenes.both_present
    pair = np.flatnonzero(similar)
    ahead = []
    for own, sign in ((first, 1.0), (second, -1.0)):
        # flat index of the follower in (V, C, T)
        vehicle = own[pair // scenes.count] * scenes.count + pair % scenes.count
        longitudinal = scenes.dx.reshape(-1)[pair] * cos.reshape(-1)[vehicle]
        longitudinal += scenes.dy.reshape(-1)[pair] * sin.reshape(-1)[vehicle]
        ahead.append(pair[sign * longitudinal > 0])
    where = np.concatenate([ahead[0], ahead[1] + similar.size])
    return _following(scenes, where, scenes.distance.reshape(-1)[np.concatenate(ahead)])


def _following(scenes: Scenes, where: IntArray, gap: FloatArray) -> Following:
    follower, leader = scenes.flat_of(where)
    speed = scenes.speed.reshape(-1)
    return Following(
        where=where,
        gap=gap,
        follower_speed=speed[follower],
        leader_speed=speed[leader],
        leader_acceleration=scenes.acceleration.reshape(-1)[leader],
    )


def leaders_on_path(scenes: Scenes) -> Following:
    """Find the next vehicle on each vehicle's own planned path; the gap is bumper to bumper along it.

    A vehicle is on the path if its centre is nearer to it than half of both widths, and its heading within
    the following angle of the path's. The path continues straight beyond the planned end, because a plan to
    stop behind a leader ends before it.
    """
    if scenes.planned is None or len(scenes.pairs[0]) == 0:
        return _following(scenes, np.empty(0, dtype=np.int64), np.empty(0))
    on_paths = scenes.of_near_pairs(_on_paths)
    follower, _ = scenes.flat_of(on_paths.where)
    # the smallest arc length to its centre
    chosen = np.sort(least_of(follower, on_paths.along))
    return _following(scenes, on_paths.where[chosen], on_paths.gap[chosen])


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnPaths(PairRows):
    along: FloatArray  # (N,) arc length of the path to the vehicle's centre, m
    gap: FloatArray  # (N,) between the bumpers, m


def _on_paths(scenes: Scenes) -> _OnPaths:
    """Find the vehicles on each path: its first segment, the rest of the plan, and straight on beyond it."""
    paths = scenes.once(paths_ahead)
    first = scenes.x, scenes.y, paths.dx, paths.dy, np.zeros_like(scenes.x)
    last = _straight_on(scenes, paths)
    where = _close_pairs(scenes, paths, last)
    follower, other = scenes.flat_of(where)
    places = [_on_straight(scenes, piece, follower, other) for piece in (first, last)]
    places.append(_on_plan(scenes, paths, follower, other))
    entry, aside, along, cos = (np.concatenate(values) for values in zip(*places, strict=True))
    near = _half(scenes, scenes.width, follower, other)
    keep = np.flatnonzero(aside <= near[entry])
    entry, aside, along, cos = entry[keep], aside[keep], along[keep], cos[keep]
    # The nearest piece counts; of equals the first.
    best = least_of(entry, aside, along)
    limit = np.cos(FOLLOWING_RAD) - COSINE_ROUNDING
    best = best[(along[best] > 0) & (cos[best] >= limit)]
    entry, along = entry[best], along[best]
    half = _half(scenes, scenes.length, follower[entry], other[entry])
    return _OnPaths(where=where[entry], along=along, gap=np.maximum(along - half, 0.0))


def _half(scenes: Scenes, size: FloatArray, follower: IntArray, other: IntArray) -> FloatArray:
    """Return half of both sizes (N,) of pairs by flat index into (V, C, T), m."""
    own, theirs = (scenes.size_of(size, *np.divmod(v, scenes.count)) for v in (follower, other))
    return (own + theirs) / 2


def _straight_on(scenes: Scenes, paths: PathsAhead) -> Straight:
    reach = np.maximum(EXTENSION_M, EXTENSION_S * scenes.speed)
    end = paths.lines.end_of(paths.line)
    end_x, end_y = np.where(paths.has_path, end[0], scenes.x), np.where(paths.has_path, end[1], scenes.y)
    moves = paths.length >= MIN_PATH_M
    last = paths.lines.direction_of(paths.line)
    # A plan of one column has no segment of its own; then the first segment gives the direction.
    own = np.where(paths.first_length > 0, paths.first_length, 1.0)
    has_last = moves & (np.hypot(*last) > 0)
    along_x = np.where(has_last, last[0], np.where(moves, paths.dx / own, scenes.cos))
    along_y = np.where(has_last, last[1], np.where(moves, paths.dy / own, scenes.sin))
    return end_x, end_y, along_x * reach, along_y * reach, paths.length


def _close_pairs(scenes: Scenes, paths: PathsAhead, last: Straight) -> IntArray:
    """Return flat indices into (2P, C, T) of pairs of which the second may be on the path of the first."""
    ends = octagon(last[0] + last[2], last[1] + last[3])
    ahead = paths.boxes_ahead
    low, high = np.minimum(ahead[:, 0], ends), np.maximum(ahead[:, 1], ends)
    half = np.broadcast_to(scenes.width / 2, scenes.x.shape)
    # Twice the reach covers the octagon's diagonal directions too.
    boxes = np.stack([low - 2 * half, high + 2 * half], axis=1)
    centre = octagon(scenes.x, scenes.y)
    points = np.stack([centre - 2 * half, centre + 2 * half], axis=1)
    return meeting_pairs(scenes.ordered_pairs, boxes, points, scenes.present)


def _on_straight(scenes: Scenes, piece: Straight, follower: IntArray, other: IntArray) -> Places:
    x, y, dx, dy, arc = (array.reshape(-1)[follower] for array in piece)
    aside, share, cos = _project(scenes, (x, y, dx, dy), other)
    # Beyond the end of the last piece there is no path.
    keep = np.flatnonzero((dx != 0) | (dy != 0))
    along = arc + share * np.hypot(dx, dy)
    return keep, aside[keep], along[keep], cos[keep]


def _on_plan(scenes: Scenes, paths: PathsAhead, follower: IntArray, other: IntArray) -> Places:
    with_plan = np.flatnonzero(paths.has_path.reshape(-1)[follower])
    follower, other = follower[with_plan], other[with_plan]
    line = paths.line.reshape(-1)[follower]
    centre = octagon(scenes.x.reshape(-1)[other], scenes.y.reshape(-1)[other])
    wide = 2 * _half(scenes, scenes.width, follower, other)
    which, segment = meeting_segments(np.stack([centre - wide, centre + wide], axis=1), paths.lines, line)
    column = paths.column[(follower[which] % scenes.count) % scenes.shape[1]]
    # Polylines are padded with segments of no length.
    keep = (segment >= column) & (np.abs(paths.lines.delta[:, line[which], segment]).max(axis=0) > 0)
    which, segment = which[keep], segment[keep]
    of_line = line[which], segment
    aside, share, cos = _project(scenes, paths.lines.segments(of_line), other[which])
    along = paths.offset.reshape(-1)[follower[which]] + paths.lines.arc_at(*of_line, share)
    return with_plan[which], aside, along, cos


def _project(
    scenes: Scenes, segments: Segments, other: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (N,) distances of vehicles from segments, m, shares of these, cosines of headings to them."""
    x, y, dx, dy = segments
    gx, gy = scenes.x.reshape(-1)[other] - x, scenes.y.reshape(-1)[other] - y
    squared = dx * dx + dy * dy
    safe = np.where(squared > 0, squared, 1.0)
    share = np.clip((gx * dx + gy * dy) / safe, 0.0, 1.0)
    aside = np.hypot(gx - share * dx, gy - share * dy)
    heading = scenes.cos.reshape(-1)[other] * dx + scenes.sin.reshape(-1)[other] * dy
    return aside, share, heading / np.sqrt(safe)
