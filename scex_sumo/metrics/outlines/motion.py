"""Motion of pairs of vehicles between steps: poses in straight lines, headings along the shorter arc."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles, overlap_area, separation
from scex_sumo.metrics.base import SceneTracks

_PAIRS_AT_ONCE = 1 << 12


@dataclass(frozen=True, kw_only=True, eq=False)
class Moves:
    """N pairs from one step to the next; a share of 0 is the earlier step, 1 the later one.

    Attributes:
        tracks: what the vehicles did.
        child: (N,).
        step: (N,) the earlier step, history included.
        first: (N,) vehicle.
        second: (N,) vehicle.
    """

    tracks: SceneTracks
    child: IntArray
    step: IntArray
    first: IntArray
    second: IntArray

    def take(self, index: IntArray) -> Moves:
        """Some of them."""
        return Moves(
            tracks=self.tracks,
            child=self.child[index],
            step=self.step[index],
            first=self.first[index],
            second=self.second[index],
        )

    def pose(self, vehicle: IntArray, share: FloatArray) -> Rectangles:
        """(N,) outlines of one vehicle of each pair."""
        now, then = self._ends(vehicle)
        states = self.tracks.states
        turn = wrap(states.heading[then] - states.heading[now])
        half_length, half_width = self.half_sizes(vehicle)
        return Rectangles(
            x=states.x[now] + share * (states.x[then] - states.x[now]),
            y=states.y[now] + share * (states.y[then] - states.y[now]),
            heading=states.heading[now] + share * turn,
            half_length=half_length,
            half_width=half_width,
        )

    def speed(self, vehicle: IntArray, share: FloatArray) -> FloatArray:
        """(N,) m/s."""
        now, then = self._ends(vehicle)
        speed = self.tracks.states.speed
        return speed[now] + share * (speed[then] - speed[now])

    def poses(self, share: FloatArray) -> tuple[Rectangles, Rectangles]:
        """(N,) outlines of both."""
        return self.pose(self.first, share), self.pose(self.second, share)

    def separation(self, share: FloatArray) -> FloatArray:
        """(N,) m, 0 or less where the outlines touch."""
        return separation(*self.poses(share))

    def overlap(self, share: FloatArray) -> FloatArray:
        """(N,) m²."""
        return overlap_area(*self.poses(share))

    def half_sizes(self, vehicle: IntArray) -> tuple[FloatArray, FloatArray]:
        """(N,) half the length and half the width, m."""
        both = []
        for size in (self.tracks.length, self.tracks.width):
            both.append((size[vehicle] if size.ndim == 1 else size[self.child, vehicle]) / 2)
        return both[0], both[1]

    def way(self) -> tuple[FloatArray, FloatArray]:
        """(N,) most that a gap along an axis of a touching pair changes, and that any corner moves, m."""
        states = self.tracks.states
        ends = self._ends(self.first), self._ends(self.second)
        (now_1, then_1), (now_2, then_2) = ends
        dx = (states.x[then_2] - states.x[now_2]) - (states.x[then_1] - states.x[now_1])
        dy = (states.y[then_2] - states.y[now_2]) - (states.y[then_1] - states.y[now_1])
        radii = [np.hypot(*self.half_sizes(v)) for v in (self.first, self.second)]
        turns = [np.abs(wrap(states.heading[then] - states.heading[now])) for now, then in ends]
        shift = np.hypot(dx, dy)
        # Where circles about both meet, the centres are no farther apart than both radii and the way.
        arm = radii[0] + radii[1] + shift
        gap_way = shift + (arm + radii[1]) * turns[0] + (arm + radii[0]) * turns[1]
        return gap_way, shift + radii[0] * turns[0] + radii[1] * turns[1]

    def _ends(self, vehicle: IntArray) -> tuple[tuple[IntArray, ...], tuple[IntArray, ...]]:
        last = self.tracks.states.shape[1] - 1
        return (self.child, self.step, vehicle), (self.child, np.minimum(self.step + 1, last), vehicle)


def near_moves(tracks: SceneTracks, start: int) -> Moves:
    """All moves from a step on in which the circles around two present vehicles meet.

    Pairs whose whole ways stay apart are left out first, so that many vehicles cost little.
    """
    x, y = tracks.states.x[:, start:], tracks.states.y[:, start:]
    radius = np.hypot(tracks.length, tracks.width) / 2
    radius = np.broadcast_to(radius, (x.shape[0], x.shape[2]))
    present = None if tracks.present is None else tracks.present[:, start:]
    boxes = []
    for values in (x, y):
        low = values if present is None else np.where(present, values, np.inf)
        high = values if present is None else np.where(present, values, -np.inf)
        boxes += [low.min(axis=1) - radius, high.max(axis=1) + radius]
    one, two = np.triu_indices(x.shape[2], 1)
    meet = np.ones((x.shape[0], one.size), dtype=bool)
    for low, high in ((boxes[0], boxes[1]), (boxes[2], boxes[3])):
        meet &= (low[:, one] <= high[:, two]) & (low[:, two] <= high[:, one])
    child, pair = np.nonzero(meet)
    first, second = one[pair].astype(np.int64), two[pair].astype(np.int64)
    # Time last and contiguous: (pairs, steps).
    tx, ty = np.ascontiguousarray(x.transpose(0, 2, 1)), np.ascontiguousarray(y.transpose(0, 2, 1))
    found = []
    for begin in range(0, child.size, _PAIRS_AT_ONCE):
        part = slice(begin, begin + _PAIRS_AT_ONCE)
        c, f, s = child[part], first[part], second[part]
        near = _way_near(tx[c, s] - tx[c, f], ty[c, s] - ty[c, f], (radius[c, f] + radius[c, s])[:, None])
        if present is not None:
            there = present[c, :, f] & present[c, :, s]
            near &= there[:, 1:] & there[:, :-1]
        row, step = np.nonzero(near)
        found.append(np.stack([c[row], step + start, f[row], s[row]]))
    rows = np.concatenate(found, axis=1) if found else np.empty((4, 0), dtype=np.int64)
    return Moves(tracks=tracks, child=rows[0], step=rows[1], first=rows[2], second=rows[3])


def _way_near(dx: FloatArray, dy: FloatArray, reach: FloatArray) -> BoolArray:
    """(N, T - 1) whether a point moving in straight lines comes within reach of the origin in each step."""
    px, py = dx[:, :-1], dy[:, :-1]
    vx, vy = dx[:, 1:] - px, dy[:, 1:] - py
    square = vx * vx + vy * vy
    with np.errstate(invalid="ignore"):
        share = np.clip(-(px * vx + py * vy) / np.where(square > 0, square, 1.0), 0.0, 1.0)
        apart = np.square(px + share * vx) + np.square(py + share * vy)
        near: BoolArray = apart <= reach * reach
    return near
