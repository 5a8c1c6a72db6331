"""Ribbon: the reference line of a group of lanes, and the offsets of their borders."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.exporters.opendrive.reference import Curve, Group, borders, curve_through, edge_direction
from scex_sumo.geometry.polylines import distances, samples
from scex_sumo.road import Lane

MAX_ERROR_M = 0.12
_GOOD_ERROR_M = 0.03
_STATION_M = 0.25
_MAX_OFFSET_M = 0.004  # of straight lines between stations
_EXTENSION_M = 5.0  # of borders at both ends
_MIN_COSINE = math.cos(math.radians(15.0))
_ZERO_M = 1e-6
_TIP_M = 0.01  # of a border's end before or behind the end of the road
_SAME_M = 0.06  # extended borders snap to a border's end
_TRIALS = (
    *((3.0, True), (1.5, True), (6.0, True), (12.0, True), (3.0, False), (8.0, False)),
    *((20.0, True), (40.0, True), (2.0, True)),
)
"""Spacing of the reference line in m, and whether it ends at right angles to the edges."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RoadEnd:
    """Line across a road at which its lanes end.

    Attributes:
        point: (2,) on the line, m.
        direction: (2,) unit driving direction, at right angles to the line.
        tips: (N, 2) ends of the borders on the line, m.
    """

    point: FloatArray
    direction: FloatArray
    tips: FloatArray

    def fits(self, lines: Sequence[FloatArray], *, end: bool) -> bool:
        """Return whether borders end (begin) near enough to be moved onto the line."""
        tips = np.array([line[-1 if end else 0] for line in lines]) - self.point
        cosine = float(edge_direction(lines, end=end) @ self.direction)
        return bool(np.abs(tips @ self.direction).max() < MAX_ERROR_M and cosine > _MIN_COSINE)

    def moved_onto(self, line: FloatArray, *, end: bool) -> FloatArray:
        """Return a border, extended or cut to end (begin) on this line."""
        line, onward = (line, self.direction) if end else (line[::-1], -self.direction)
        ahead = (line - self.point) @ onward
        inside = int(np.flatnonzero(ahead < -_ZERO_M)[-1]) if (ahead < -_ZERO_M).any() else 0
        first = min(inside, len(line) - 2)
        step = line[first + 1] - line[first]
        rise = float(step @ onward)
        tip = line[inside] - step * (ahead[inside] / rise) if rise > 0 else line[-1]
        away = np.hypot(*(self.tips - tip).T)
        tip = self.tips[away.argmin()] if away.min() < _SAME_M else tip
        moved = np.vstack([line[: inside + 1], tip[None]])
        return moved if end else moved[::-1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Ribbon:
    """Shape of a road: its reference line, and where the borders of its lanes are.

    Attributes:
        s: (N,) stations, m along the reference line.
        offsets: (N, lanes + 1) of the borders from it, leftmost first, positive left, m.
        error: largest distance between the lanes' borders and the ribbon's, m.
    """

    curve: Curve
    group: Group
    s: FloatArray
    offsets: FloatArray
    error: float

    @property
    def length(self) -> float:
        """Length of the reference line, m."""
        return float(self.curve.s[-1])

    def edge(self, *, end: bool) -> RoadEnd:
        """Return the line across its end (beginning)."""
        index = -1 if end else 0
        place, tangent = self.curve.points[index], self.curve.tangents[index]
        across = np.array([-tangent[1], tangent[0]])
        return RoadEnd(point=place, direction=tangent, tips=place + self.offsets[index][:, None] * across)

    def split(self, *shares: float) -> list[Ribbon]:
        """Cut the ribbon at the knots nearest to ascending shares of its length."""
        knots = [0]
        for k, share in enumerate(shares):
            nearest = int(np.argmin(np.abs(self.curve.s - share * self.length)))
            knots.append(min(max(nearest, knots[-1] + 1), len(self.curve.s) - len(shares) + k - 1))
        knots.append(len(self.curve.s) - 1)
        return [self._part(a, b) for a, b in pairwise(knots)]

    def _part(self, first: int, last: int) -> Ribbon:
        start, end = self.curve.s[[first, last]]
        inner = self.s[(self.s > start + 1e-6) & (self.s < end - 1e-6)]
        s = np.concatenate([[start], inner, [end]])
        offsets = np.stack([np.interp(s, self.s, column) for column in self.offsets.T], axis=1)
        return replace(self, curve=self.curve.part(first, last), s=s - start, offsets=offsets)


def fitting_groups(lanes: Mapping[int, Lane], group: Group) -> list[Group]:
    """Return a group, or its parts if its lanes end too unevenly for one road."""
    if len(group) == 1 or ribbon_of(lanes, group).error < MAX_ERROR_M:
        return [group]
    parts = [group[:1]]
    for lane in group[1:]:
        wider = (*parts[-1], lane)
        if ribbon_of(lanes, wider).error < MAX_ERROR_M:
            parts[-1] = wider
        else:
            parts.append((lane,))
    return parts


def ribbon_of(
    lanes: Mapping[int, Lane], group: Group, ends: tuple[RoadEnd | None, RoadEnd | None] = (None, None)
) -> Ribbon:
    """Return the ribbon of a group with the first good reference line, else the best.

    ``ends`` are lines across, shared with other roads, on which it begins and ends.
    """
    lines = borders(lanes, group)
    square = [edge_direction(lines, end=end) for end in (False, True)]
    for k, edge in enumerate(ends):
        if edge is not None:
            lines = [edge.moved_onto(line, end=k == 1) for line in lines]
            square[k] = edge.direction
    free = [None if edge is None else edge.direction for edge in ends]
    best: Ribbon | None = None
    for spacing_m, is_square in _TRIALS:
        curve = curve_through(lines, square if is_square else free, spacing_m=spacing_m)
        s, offsets = _thinned(*_stations(lines, curve))
        error = _error(curve, s, offsets, lines)
        if best is None or error < best.error:
            best = Ribbon(curve=curve, group=group, s=s, offsets=offsets, error=error)
        if best.error < _GOOD_ERROR_M:
            break
    assert best is not None
    return best


def _stations(lines: Sequence[FloatArray], curve: Curve) -> tuple[FloatArray, FloatArray]:
    """Return (N,) stations along a curve, and (N, lanes + 1) offsets of borders there."""
    steps = [
        np.linspace(a, b, max(2, math.ceil((b - a) / _STATION_M)), endpoint=False)
        for a, b in pairwise(curve.s)
    ]
    s = np.concatenate([*steps, curve.s[-1:]])
    offsets = np.stack([_offsets(*curve.at(s), line) for line in lines], axis=1)
    return s, np.minimum.accumulate(offsets, axis=1)  # no lane has a negative width


def _offsets(place: FloatArray, tangent: FloatArray, line: FloatArray) -> FloatArray:
    first, last = line[0] - line[1], line[-1] - line[-2]
    first, last = (_EXTENSION_M * v / max(float(np.hypot(*v)), 1e-9) for v in (first, last))
    line = np.vstack([line[0] + first, line, line[-1] + last])
    to = line[None] - place[:, None]
    ahead = to[..., 0] * tangent[:, None, 0] + to[..., 1] * tangent[:, None, 1]
    aside = to[..., 1] * tangent[:, None, 0] - to[..., 0] * tangent[:, None, 1]
    a, b = ahead[:, :-1], ahead[:, 1:]
    crossed = (a <= 0) & (b > 0)
    share = np.where(crossed, -a / np.where(crossed, b - a, 1.0), 0.0)
    crossings = np.where(crossed, aside[:, :-1] + share * np.diff(aside, axis=1), np.inf)
    best = np.abs(crossings).argmin(axis=1)
    rows = np.arange(len(place))
    nearest = aside[rows, np.abs(ahead).argmin(axis=1)]
    offsets = np.where(crossed.any(axis=1), crossings[rows, best], nearest)
    # A border may cross the end of the road several times; it ends at its own tip.
    for station, tip in ((0, 1), (-1, -2)):
        if abs(ahead[station, tip]) < _TIP_M:
            offsets[station] = aside[station, tip]
    return np.asarray(offsets)


def _thinned(s: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    keep, stack = {0, len(s) - 1}, [(0, len(s) - 1)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        share = ((s[a + 1 : b] - s[a]) / (s[b] - s[a]))[:, None]
        straight = (1 - share) * offsets[a] + share * offsets[b]
        off = np.abs(offsets[a + 1 : b] - straight).max(axis=1)
        worst = int(off.argmax())
        if off[worst] > _MAX_OFFSET_M:
            keep.add(a + 1 + worst)
            stack += [(a, a + 1 + worst), (a + 1 + worst, b)]
    kept = sorted(keep)
    return s[kept], offsets[kept]


def _error(curve: Curve, s: FloatArray, offsets: FloatArray, lines: Sequence[FloatArray]) -> float:
    worst, stations = 0.0, np.linspace(s[0], s[-1], max(9, math.ceil(np.ptp(s) / _STATION_M)))
    stations = np.unique(np.concatenate([stations, s]))
    place, tangent = curve.at(stations)
    left = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    for column, line in zip(offsets.T, lines, strict=True):
        border = place + np.interp(stations, s, column)[:, None] * left
        there = samples(line, 2 * _STATION_M)[1]
        worst = max(worst, float(distances(border, line).max()), float(distances(there, border).max()))
    return worst
