"""Crossings of polylines and places on them, for many at once.

Each polyline has a pyramid of bounding boxes: of segments, blocks of segments, blocks of blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray

BLOCK = 6
PARALLEL = 1e-9  # sine of the smallest angle of a crossing
ARC_ROUNDING_M = 1e-9
MIN_SEGMENT_M = 1e-3  # a shorter one has no direction of its own
TOUCH = 1e-9  # share of a segment's length within which end points touch
Segments: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Start x and y, and step x and y, (N,) m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hits:
    """Crossing points of segments."""

    which: IntArray  # (X,) index into the tested pairs
    first: FloatArray  # (X,) share of the first segment before the crossing point; so ``second``
    second: FloatArray
    sine: FloatArray  # (X,) of the angle between them, without sign


def intersect(first: Segments, second: Segments) -> Hits:
    """Find crossing points of (N,) segments p + u r and q + w s; touching ones cross, parallel ones never."""
    (px, py, rx, ry), (qx, qy, sx, sy) = first, second
    area = rx * sy - ry * sx
    gx, gy = qx - px, qy - py
    sign = np.sign(area)
    u, w, size = (gx * sy - gy * sx) * sign, (gx * ry - gy * rx) * sign, np.abs(area)
    slack = size * TOUCH
    limit = size + slack
    inside = (u >= -slack) & (u <= limit) & (w >= -slack) & (w <= limit) & (size > 0)
    hit = np.flatnonzero(inside)
    if hit.size == 0:
        return Hits(which=hit, first=np.empty(0), second=np.empty(0), sine=np.empty(0))
    size = size[hit]
    lengths = np.hypot(rx[hit], ry[hit]) * np.hypot(sx[hit], sy[hit])
    crossing = size > PARALLEL * lengths
    hit, size, sine = hit[crossing], size[crossing], size[crossing] / lengths[crossing]
    return Hits(which=hit, first=np.clip(u[hit] / size, 0, 1), second=np.clip(w[hit] / size, 0, 1), sine=sine)


def boxes_meet(first: FloatArray, second: FloatArray) -> BoolArray:
    """Test whether octagons overlap: (4, 2, ...) lowest and highest x, y, x + y, x - y of each."""
    meet: BoolArray = first[0, 0] <= second[0, 1]
    for axis in range(4):
        if axis:
            meet = meet & (first[axis, 0] <= second[axis, 1])
        meet &= second[axis, 0] <= first[axis, 1]
    return meet


def octagon(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return (4, N...) coordinates along the directions of an octagon: x, y, x + y, x - y."""
    directions = np.empty((4, *x.shape))
    directions[0], directions[1] = x, y
    np.add(x, y, out=directions[2])
    np.subtract(x, y, out=directions[3])
    return directions


def segment_boxes(x: FloatArray, y: FloatArray, end_x: FloatArray, end_y: FloatArray) -> FloatArray:
    """Return (4, 2, N...) octagons around segments, slightly wider, so that touching ones meet."""
    return _around(octagon(x, y), octagon(end_x, end_y))


def _around(start: FloatArray, end: FloatArray) -> FloatArray:
    boxes = np.empty((4, 2, *start.shape[1:]))
    low, high = boxes[:, 0], boxes[:, 1]
    np.minimum(start, end, out=low)
    np.maximum(start, end, out=high)
    margin = high - low
    margin += 1.0
    margin *= TOUCH
    low -= margin
    high += margin
    return boxes


@dataclass(frozen=True, kw_only=True, eq=False)
class Polylines:
    """N polylines of H nodes."""

    x: FloatArray  # (N, H) m
    y: FloatArray  # (N, H) m
    arc: FloatArray  # (N, H) length from the first node, m

    @classmethod
    def build(cls, x: FloatArray, y: FloatArray) -> Polylines:
        """Build from (N, H) finite nodes, m."""
        arc: FloatArray = np.zeros(x.shape)
        np.cumsum(np.hypot(np.diff(x, axis=1), np.diff(y, axis=1)), axis=1, out=arc[:, 1:])
        return cls(x=x, y=y, arc=arc)

    @cached_property
    def _nodes(self) -> FloatArray:
        """(2, N, M + 1) nodes; the last one is repeated until M is a multiple of `BLOCK`."""
        count = self.x.shape[1] - 1
        nodes = np.empty((2, len(self.x), BLOCK * -(-max(count, 1) // BLOCK) + 1))
        nodes[0, :, : count + 1], nodes[1, :, : count + 1] = self.x, self.y
        nodes[:, :, count + 1 :] = nodes[:, :, count : count + 1]
        return nodes

    @property
    def start(self) -> FloatArray:
        """(2, N, M) of each segment, m."""
        return self._nodes[:, :, :-1]

    @cached_property
    def delta(self) -> FloatArray:
        """(2, N, M) extent of each segment, m; 0 for padding."""
        return np.diff(self._nodes, axis=2)

    @cached_property
    def _octagons(self) -> FloatArray:
        return octagon(self._nodes[0], self._nodes[1])

    @property
    def octagons(self) -> FloatArray:
        """(4, N, H) coordinates of the nodes."""
        return self._octagons[:, :, : self.x.shape[1]]

    @cached_property
    def boxes(self) -> tuple[FloatArray, ...]:
        """Octagons (4, 2, N, M / block^level) by level: of segments, of blocks, of blocks of blocks."""
        boxes = [_around(self._octagons[:, :, :-1], self._octagons[:, :, 1:])]
        while len(boxes) < 2 or BLOCK ** (len(boxes) - 1) < self.x.shape[1] - 1:
            boxes.append(_merge(boxes[-1]))
        return tuple(boxes)

    @cached_property
    def directions(self) -> FloatArray:
        """(2, N, H - 1) cosine and sine of each segment; one without length has those of the last one."""
        step = np.stack([np.diff(self.x, axis=1), np.diff(self.y, axis=1)])
        length = np.sqrt(step[0] ** 2 + step[1] ** 2)
        directions = step / np.maximum(length, 1e-9)
        return np.asarray(np.where(length < MIN_SEGMENT_M, directions[..., -1:], directions))

    def project(
        self, line: IntArray, x: FloatArray, y: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Project points (K, P) onto lines (P,), which go on straight past both ends.

        Return (K, P) arc length, offset (left positive), cosine and sine of the direction.
        """
        # Lines are the last axis, so that operations run along memory.
        begin_x, begin_y, begin = (a[line].T.copy() for a in (self.x, self.y, self.arc))
        cos, sin = (a[line].T.copy() for a in self.directions)  # (H - 1, P)
        low, high = np.zeros_like(cos), np.diff(begin, axis=0)
        low[0], high[-1] = -np.inf, np.inf
        square, best = np.full(x.shape, np.inf), np.zeros(x.shape, dtype=np.int16)
        for segment in range(len(cos)):
            px, py = x - begin_x[segment], y - begin_y[segment]
            ahead = px * cos[segment] + py * sin[segment]
            side = py * cos[segment] - px * sin[segment]
            ahead -= np.minimum(np.maximum(ahead, low[segment]), high[segment])
            ahead *= ahead
            side *= side
            ahead += side
            # The first of the nearest segments; a masked copy takes ten times as long.
            np.maximum(best, (ahead < square) * np.int16(segment), out=best)
            np.minimum(square, ahead, out=square)
        at = np.multiply(best, len(line), dtype=np.int64) + np.arange(len(line))
        cos, sin = cos.take(at), sin.take(at)
        px, py = x - begin_x.take(at), y - begin_y.take(at)
        ahead, side = px * cos + py * sin, py * cos - px * sin
        foot = np.minimum(np.maximum(ahead, low.take(at)), high.take(at))
        return begin.take(at) + foot, np.copysign(np.sqrt(square), side), cos, sin

    def segments(self, at: tuple[IntArray, IntArray]) -> Segments:
        """Return segments by line and number."""
        return self.start[0][at], self.start[1][at], self.delta[0][at], self.delta[1][at]

    def arc_at(self, line: IntArray, segment: IntArray, share: FloatArray) -> FloatArray:
        """Return (N,) length from the first node to a share of a segment, m."""
        at = (line, segment)
        arc: FloatArray = self.arc[at] + share * np.hypot(self.delta[0][at], self.delta[1][at])
        return arc

    def end_of(self, line: IntArray) -> FloatArray:
        """Return (2, N...) last node, m."""
        return np.stack([self.x[line, -1], self.y[line, -1]])

    def direction_of(self, line: IntArray) -> FloatArray:
        """Return (2, N...) unit vector of the last segment with a length; 0 if there is none."""
        length = np.hypot(self.delta[0], self.delta[1])
        index = np.arange(length.shape[1])
        last = np.where(length > 0, index, -1).max(axis=1)
        rows, column = np.arange(len(last)), np.maximum(last, 0)
        own = length[rows, column]
        unit = self.delta[:, rows, column] / np.where(own > 0, own, 1.0)
        direction: FloatArray = unit[:, line]
        return direction

    def column_at(self, line: IntArray, arc: FloatArray, *, leaving: bool = False) -> FloatArray:
        """Return (N,) fractional column at an arc length; 0 if it is negative, inf beyond the last node.

        Of equal nodes it is the first one, with ``leaving`` the last one.
        """
        end = self.arc[line, -1]
        target = np.where((arc > end) & (arc <= end + ARC_ROUNDING_M), end, arc)
        low, high = np.zeros(len(line), dtype=np.int64), np.full(len(line), self.arc.shape[1])
        for _ in range(self.arc.shape[1].bit_length()):
            middle = (low + high) // 2
            value = self.arc[line, np.minimum(middle, self.arc.shape[1] - 1)]
            right = (value <= target if leaving else value < target) & (middle < high)
            low, high = np.where(right, middle + 1, low), np.where(right, high, middle)
        before = np.clip(low - 1, 0, self.arc.shape[1] - 1)
        after = np.minimum(low, self.arc.shape[1] - 1)
        step = self.arc[line, after] - self.arc[line, before]
        share = np.divide(target - self.arc[line, before], step, out=np.zeros(len(line)), where=step > 0)
        column = np.maximum(before + np.where(low == 0, 0.0, share), 0.0)
        return np.where(target > end, np.inf, column)


def _merge(boxes: FloatArray) -> FloatArray:
    missing = -boxes.shape[3] % BLOCK
    if missing:
        boxes = np.concatenate([boxes, np.repeat(boxes[..., -1:], missing, axis=3)], axis=3)
    merged = boxes[..., ::BLOCK].copy()
    # Reducing a short last axis would cost several times as much.
    for member in range(1, BLOCK):
        np.minimum(merged[:, 0], boxes[:, 0, :, member::BLOCK], out=merged[:, 0])
        np.maximum(merged[:, 1], boxes[:, 1, :, member::BLOCK], out=merged[:, 1])
    return merged


def _members(block: IntArray, count: int) -> tuple[IntArray, BoolArray]:
    member = block[:, None] * BLOCK + np.arange(BLOCK)
    return np.minimum(member, count - 1), member < count


def polyline_crossings(
    lines: Polylines, first: IntArray, second: IntArray
) -> tuple[Hits, IntArray, IntArray]:
    """Find all crossing points of (N,) pairs of polylines, and the number of the segment on both lines."""
    which = np.flatnonzero(boxes_meet(*(lines.boxes[-1][:, :, line, 0] for line in (first, second))))
    block_1 = block_2 = np.zeros(len(which), dtype=np.int64)
    for boxes in reversed(lines.boxes[:-1]):
        (block_1, real_1), (block_2, real_2) = (_members(b, boxes.shape[3]) for b in (block_1, block_2))
        one = boxes[:, :, first[which][:, None], block_1][..., :, None]
        two = boxes[:, :, second[which][:, None], block_2][..., None, :]
        meet = boxes_meet(one, two) & real_1[:, :, None] & real_2[:, None, :]
        pair, own, other = np.nonzero(meet)
        which, block_1, block_2 = which[pair], block_1[pair, own], block_2[pair, other]
    at_1, at_2 = (first[which], block_1), (second[which], block_2)
    hits = intersect(lines.segments(at_1), lines.segments(at_2))
    hit = hits.which
    return replace(hits, which=which[hit]), block_1[hit], block_2[hit]


def segment_crossings(
    x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, lines: Polylines, line: IntArray
) -> tuple[Hits, IntArray]:
    """Find all crossing points of (N,) segments with one polyline each, and its segments' numbers."""
    which, block = meeting_segments(segment_boxes(x, y, x + dx, y + dy), lines, line)
    segments = (line[which], block)
    hits = intersect((x[which], y[which], dx[which], dy[which]), lines.segments(segments))
    return replace(hits, which=which[hits.which]), block[hits.which]


def meeting_segments(own: FloatArray, lines: Polylines, line: IntArray) -> tuple[IntArray, IntArray]:
    """Find segments of (N,) polylines whose octagons meet given ones: index of the octagon, segment."""
    which = np.flatnonzero(boxes_meet(own, lines.boxes[-1][:, :, line, 0]))
    block = np.zeros(which.size, dtype=np.int64)
    for boxes in reversed(lines.boxes[:-1]):
        members, real = _members(block, boxes.shape[3])
        meet = boxes_meet(own[:, :, which, None], boxes[:, :, line[which][:, None], members]) & real
        box, member = np.nonzero(meet)
        which, block = which[box], members[box, member]
    return which, block
