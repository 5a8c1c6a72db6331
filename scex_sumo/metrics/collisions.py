"""Collisions of vehicles: pair, time, kind, speed; exact between steps.

Two vehicles collide if their rectangles overlap after the seed moment, but not at it. Simulated boxes are
exact: any overlap counts. In recordings, and between vehicles that touch at the seed moment, more than 0.1 m²
counts. Between steps, positions and headings change linearly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import (
    Rectangles,
    axis_separations,
    overlap_area,
    relative_pose,
    separation,
)
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.scene import States

OVERLAP_M2: Final = 0.1
"""Overlap above which two recorded vehicles, or two that touch at the seed moment, have collided."""

CONTACT_M2: Final = 1e-6
"""Overlap above which two simulated vehicles have collided: any but rounding."""

KINDS: Final = ("rear-end", "side", "head-on")
SIDES: Final = ("front", "rear", "left", "right")

_SPLITS = 10  # halvings of a step: an overlap above the limit for less than 0.1 ms may be missed
_BISECTIONS = 40
_REAR_END, _HEAD_ON = np.pi / 6, np.pi * 5 / 6
_PAIRS_AT_ONCE = 1 << 12
_SAME_TIME_S = 1e-9
# outlines at the start of moves, way in x and y, m, and turn, rad
_Ends: TypeAlias = tuple[Rectangles, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Collisions(Rows):
    """The first collision of every pair in every future, sorted by future, time and pair."""

    future: IntArray
    step: IntArray  # first step at or after the impact, history included
    time_s: FloatArray  # impact after the seed moment: the start of the contact that grew to a collision
    first: IntArray  # in a rear-end collision the vehicle that hits with its front, else the lower index
    second: IntArray
    kind: IntArray  # index into ``KINDS``
    first_side: IntArray  # side that is touched first, index into ``SIDES``
    second_side: IntArray
    relative_speed: FloatArray  # ‖v₁ − v₂‖ at impact, m/s
    overlap: FloatArray  # largest overlap after the impact less that of the seed moment, m²
    x: FloatArray  # midpoint of both centres at impact, m
    y: FloatArray
    consequence: BoolArray  # a vehicle of the pair had collided before; see `with_consequences`

    def __len__(self) -> int:
        return len(self.future)

    def with_consequences(self) -> Collisions:
        """Mark collisions of vehicles that have collided before in their future."""
        both = np.stack([self.first, self.second])
        began = np.full((self.future.max(initial=-1) + 1, both.max(initial=-1) + 1), np.inf)
        for vehicle in both:
            np.minimum.at(began, (self.future, vehicle), self.time_s)
        is_later = self.time_s > began[self.future, both].min(axis=0) + _SAME_TIME_S
        return replace(self, consequence=np.asarray(is_later))

    def kinds(self) -> NDArray[np.str_]:
        """Return (N,) kinds in words."""
        return np.array(KINDS)[self.kind]


def find_collisions(tracks: SceneTracks, *, limit_m2: float = OVERLAP_M2) -> Collisions:
    """Find the first collision of every pair in every future.

    Args:
        limit_m2: overlap above which vehicles collide that do not touch at the seed moment; `CONTACT_M2` for
            simulated tracks.
    """
    start = max(tracks.first - 1, 0)
    moves = near_moves(tracks, start)
    moves = moves.take(_touching(moves))
    at_seed = moves.at_step(np.full(moves.step.size, start)).overlap(np.zeros(moves.step.size))
    limit = np.where(at_seed > limit_m2, max(limit_m2, OVERLAP_M2), limit_m2)
    share, which = _first_of_pair(moves, *_exceeding(moves, limit))
    hits = moves.take(which)
    return _described(*_impact(hits, share, limit[which]), hits, share, start)


class Contacts:
    """Contacts of pairs in futures simulated step by step; the first are those of `find_collisions`."""

    def __init__(
        self, start: States, length: FloatArray, width: FloatArray, uncounted: BoolArray | None = None
    ) -> None:
        """Begin at the seed moment with states (V,); pairs in ``uncounted`` (V, V) never collide."""
        self._length, self._width = length, width
        one, two = np.triu_indices(len(length), 1)
        boxes = (Rectangles.of(start[side], length[side], width[side]) for side in (one, two))
        overlap = overlap_area(*boxes)
        self._limit = np.full((len(length), len(length)), np.inf)
        limit = np.where(overlap > CONTACT_M2, OVERLAP_M2, CONTACT_M2)
        self._limit[one, two] = np.where(overlap > OVERLAP_M2, np.inf, limit)
        if uncounted is not None:
            self._limit[uncounted] = np.inf

    def in_step(self, before: States, after: States) -> tuple[IntArray, IntArray, IntArray]:
        """Return future and both vehicles of the pairs in contact between two states (C, V)."""
        states = States.stack([before, after], axis=1)
        moves = near_moves(SceneTracks(states=states, length=self._length, width=self._width, first=1), 0)
        moves = moves.take(_touching(moves))
        limit = self._limit[moves.first, moves.second]
        _, hit = _exceeding(moves, limit, only_whether=True)
        return moves.future[hit], moves.first[hit], moves.second[hit]


@dataclass(frozen=True, eq=False)
class Moves:
    """Motion of N pairs during one step each; a share of 0 is the earlier step, 1 the later one."""

    tracks: SceneTracks
    future: IntArray
    step: IntArray  # (N,) the earlier step, history included
    first: IntArray
    second: IntArray

    def take(self, index: IntArray) -> Moves:
        """Select rows by index."""
        columns = (getattr(self, name)[index] for name in ("future", "step", "first", "second"))
        return Moves(self.tracks, *columns)

    def at_step(self, step: IntArray) -> Moves:
        """Return the same pairs during other steps."""
        return replace(self, step=step)

    @cached_property
    def ends(self) -> tuple[_Ends, _Ends]:
        """Outlines of either vehicle at the start of the moves, and how far it goes and turns."""
        return self._ends(self.first), self._ends(self.second)

    def _ends(self, vehicle: IntArray) -> _Ends:
        states, last = self.tracks.states, self.tracks.states.shape[1] - 1
        now = states[self.future, self.step, vehicle]
        then = states[self.future, np.minimum(self.step + 1, last), vehicle]
        length, width = (
            size[vehicle] if size.ndim == 1 else size[self.future, vehicle]
            for size in (self.tracks.length, self.tracks.width)
        )
        start, turn = Rectangles.of(now, length, width), wrap(then.heading - now.heading)
        return start, then.x - now.x, then.y - now.y, turn

    def poses(self, share: FloatArray) -> tuple[Rectangles, Rectangles]:
        """Return (N,) outlines of both vehicles."""
        one, two = (
            replace(
                start, x=start.x + share * dx, y=start.y + share * dy, heading=start.heading + share * turn
            )
            for start, dx, dy, turn in self.ends
        )
        return one, two

    def speed(self, vehicle: IntArray, share: FloatArray) -> FloatArray:
        """Return (N,) speeds of one vehicle of each pair, m/s."""
        speed, last = self.tracks.states.speed, self.tracks.states.shape[1] - 1
        now = speed[self.future, self.step, vehicle]
        return now + share * (speed[self.future, np.minimum(self.step + 1, last), vehicle] - now)

    def separation(self, share: FloatArray) -> FloatArray:
        """Return (N,) m; at most 0 where the outlines touch."""
        return separation(*self.poses(share))

    def overlap(self, share: FloatArray) -> FloatArray:
        """Return (N,) m²."""
        return overlap_area(*self.poses(share))

    def radii(self) -> tuple[FloatArray, FloatArray]:
        """Return (N,) radii of the circles around either vehicle, m."""
        one, two = (np.hypot(start.half_length, start.half_width) for start, *_ in self.ends)
        return one, two

    def way(self) -> tuple[FloatArray, FloatArray]:
        """Bound (N,) the change of a touching pair's gap, and the way of any corner, m."""
        (_, dx, dy, _), (_, other_dx, other_dy, _) = self.ends
        radii, turns = self.radii(), [np.abs(turn) for *_, turn in self.ends]
        shift = np.hypot(other_dx - dx, other_dy - dy)
        # If the circles around both meet, the centres are no farther apart than both radii and the way.
        arm = radii[0] + radii[1] + shift
        gap_way = shift + (arm + radii[1]) * turns[0] + (arm + radii[0]) * turns[1]
        return gap_way, shift + radii[0] * turns[0] + radii[1] * turns[1]


def near_moves(tracks: SceneTracks, start: int) -> Moves:
    """Find all moves from a step on in which the circles around two present vehicles meet."""
    x, y = tracks.states.x[:, start:], tracks.states.y[:, start:]
    radius = np.hypot(tracks.length, tracks.width) / 2
    radius = np.broadcast_to(radius, (x.shape[0], x.shape[2]))
    present = None if tracks.present is None else tracks.present[:, start:]
    meet = np.triu(np.ones((1, x.shape[2], x.shape[2]), dtype=bool), 1)  # (C, V, V)
    for values in (x, y):  # boxes around all that vehicles drive
        low = values if present is None else np.where(present, values, np.inf)
        high = values if present is None else np.where(present, values, -np.inf)
        low, high = low.min(axis=1) - radius, high.max(axis=1) + radius
        meet = meet & (low[:, :, None] <= high[:, None]) & (low[:, None] <= high[:, :, None])
    # np.nonzero takes twice as long.
    future, first, second = np.unravel_index(np.flatnonzero(meet), meet.shape)
    # time last and contiguous: (pairs, steps)
    tx, ty = np.ascontiguousarray(x.transpose(0, 2, 1)), np.ascontiguousarray(y.transpose(0, 2, 1))
    parts = []
    for begin in range(0, future.size, _PAIRS_AT_ONCE):
        chunk = slice(begin, begin + _PAIRS_AT_ONCE)
        c, f, s = future[chunk], first[chunk], second[chunk]
        near = _way_near(tx[c, s] - tx[c, f], ty[c, s] - ty[c, f], (radius[c, f] + radius[c, s])[:, None])
        if present is not None:
            there = present[c, :, f] & present[c, :, s]
            near &= there[:, 1:] & there[:, :-1]
        near_pair, step = np.nonzero(near)
        parts.append(np.stack([c[near_pair], step + start, f[near_pair], s[near_pair]]))
    rows = np.concatenate(parts, axis=1) if parts else np.empty((4, 0), dtype=np.int64)
    return Moves(tracks, *rows)


def _way_near(dx: FloatArray, dy: FloatArray, reach: FloatArray) -> BoolArray:
    px, py = dx[:, :-1], dy[:, :-1]
    vx, vy = dx[:, 1:] - px, dy[:, 1:] - py
    square = vx * vx + vy * vy
    with np.errstate(invalid="ignore"):
        share = np.clip(-(px * vx + py * vy) / np.where(square > 0, square, 1.0), 0.0, 1.0)
        apart = np.square(px + share * vx) + np.square(py + share * vy)
        near: BoolArray = apart <= reach * reach
    return near


def _touching(moves: Moves) -> IntArray:
    """Return the moves (n,) in which the outlines may touch."""
    gap_way, _ = moves.way()
    zero = np.zeros(moves.future.shape)
    return np.flatnonzero(moves.separation(zero) + moves.separation(zero + 1) <= gap_way)


def _exceeding(moves: Moves, limit: FloatArray, *, only_whether: bool = False) -> tuple[FloatArray, IntArray]:
    """Return the moves (n,) with an overlap above a limit, and the share at which it is found first.

    ``only_whether``: the share may be any that is found.
    """
    count = moves.future.size
    share = np.full(count, np.inf)
    if not count:
        return share, np.empty(0, dtype=np.int64)
    start, end = moves.overlap(np.zeros(count)), moves.overlap(np.ones(count))
    share[end > limit] = 1.0
    share[start > limit] = 0.0
    gap_way, corner_way = moves.way()
    growth = 2 * np.pi * np.minimum(*moves.radii()) * corner_way  # no outline within the smaller is longer
    is_open = np.isinf(share) if only_whether else share > 0
    move = np.flatnonzero(is_open & (start + end + growth > 2 * limit))
    low, width = np.zeros(move.size), 1.0
    ends = start[move], end[move]
    for _ in range(_SPLITS):
        if move.size == 0:
            break
        width /= 2
        middle = low + width
        boxes = moves.take(move).poses(middle)
        area, gap = overlap_area(*boxes), separation(*boxes)
        over = area > limit[move]
        np.minimum.at(share, move[over], middle[over])
        # A pair apart in the middle by more than half the way does not touch in this part.
        close = gap <= gap_way[move] * width
        rise = growth[move] * width
        left, right = (close & (e + area + rise > 2 * limit[move]) for e in ends)
        move, low, ends = (
            np.concatenate([move[left], move[right]]),
            np.concatenate([low[left], middle[right]]),
            (np.concatenate([ends[0][left], area[right]]), np.concatenate([area[left], ends[1][right]])),
        )
        keep = low < share[move]
        move, low, ends = move[keep], low[keep], (ends[0][keep], ends[1][keep])
    which = np.flatnonzero(np.isfinite(share))
    return share[which], which


def _first_of_pair(moves: Moves, share: FloatArray, which: IntArray) -> tuple[FloatArray, IntArray]:
    vehicles = moves.tracks.states.shape[2]
    key = (moves.future[which] * vehicles + moves.first[which]) * vehicles + moves.second[which]
    chosen = np.unique(key, return_index=True)[1]  # moves of a pair are in the order of time
    began = (share[chosen] == 0) & _is_seen_first(moves.take(which[chosen]))
    chosen = chosen[~began]
    return share[chosen], which[chosen]


def _is_seen_first(moves: Moves) -> BoolArray:
    before = moves.step - 1
    seen = before >= max(moves.tracks.first - 1, 0)
    present = moves.tracks.present
    if present is not None:
        earlier = np.maximum(before, 0)
        seen &= present[moves.future, earlier, moves.first] & present[moves.future, earlier, moves.second]
    return np.asarray(~seen)


def _impact(hits: Moves, share: FloatArray, limit: FloatArray) -> tuple[Moves, FloatArray]:
    step, end = hits.step.copy(), share.copy()
    going = np.flatnonzero(hits.separation(np.zeros(share.size)) <= 0)
    touching = np.zeros(share.size, dtype=bool)
    while going.size:
        still_touching = hits.at_step(step).take(going)
        began = _is_seen_first(still_touching)
        touching[going[began]] = True
        going = going[~began]
        step[going] -= 1
        end[going] = 1.0
        apart = hits.at_step(step).take(going).separation(np.zeros(going.size)) > 0
        going = going[~apart]
    step[touching], end[touching] = hits.step[touching], share[touching]
    moves = hits.at_step(step)
    low, high = np.zeros(share.size), end
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        over = moves.separation(middle) <= 0
        if touching.any():
            over = np.where(touching, moves.overlap(middle) > limit, over)
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return moves, high


def _described(impact: Moves, share: FloatArray, hits: Moves, found_at: FloatArray, start: int) -> Collisions:
    one, two = impact.poses(share)
    sides = _touched(impact, share)
    angle = np.abs(wrap(two.heading - one.heading))
    ends = np.sort(np.stack(sides), axis=0)
    rear_end = (angle <= _REAR_END + 1e-9) & (ends[0] == 0) & (ends[1] == 1)
    head_on = (angle >= _HEAD_ON - 1e-9) & (ends[1] == 0)
    kind = np.where(rear_end, 0, np.where(head_on, 2, 1))
    speeds = [impact.speed(v, share) for v in (impact.first, impact.second)]
    dvx = speeds[1] * np.cos(two.heading) - speeds[0] * np.cos(one.heading)
    dvy = speeds[1] * np.sin(two.heading) - speeds[0] * np.sin(one.heading)
    swap = rear_end & (sides[0] == 1)
    collisions = Collisions(
        future=impact.future,
        step=impact.step + 1,
        time_s=(impact.step - start + share) * impact.tracks.step_s,
        first=np.where(swap, impact.second, impact.first),
        second=np.where(swap, impact.first, impact.second),
        kind=kind,
        first_side=np.where(swap, sides[1], sides[0]),
        second_side=np.where(swap, sides[0], sides[1]),
        relative_speed=np.hypot(dvx, dvy),
        overlap=_grown(hits, found_at, start),
        x=(one.x + two.x) / 2,
        y=(one.y + two.y) / 2,
        consequence=np.zeros(len(found_at), dtype=np.bool_),
    )
    keys = (collisions.second, collisions.first, collisions.time_s, collisions.future)
    return collisions.take(np.lexsort(keys))


def _touched(impact: Moves, share: FloatArray) -> tuple[IntArray, IntArray]:
    one, two = impact.poses(share)
    gaps = axis_separations(one, two)
    # For parallel outlines two axes differ only by rounding.
    axis = np.argmax(gaps >= gaps.max(axis=0) - 1e-6, axis=0)
    sides = []
    for index, pair in enumerate(((one, two), (two, one))):
        x, y, cos, sin = relative_pose(*pair)
        own_axis = (axis >= 2) == bool(index)
        # direction of the contact in the own frame: the own axis, or the other's turned by (cos, sin)
        lengthwise = axis % 2 == 0
        cos, sin = np.where(own_axis, 1.0, cos), np.where(own_axis, 0.0, sin)
        normal_x, normal_y = np.where(lengthwise, cos, -sin), np.where(lengthwise, sin, cos)
        sign = np.where(normal_x * x + normal_y * y < 0, -1.0, 1.0)
        normal_x, normal_y = sign * normal_x, sign * normal_y
        ends = np.abs(normal_x) >= np.abs(normal_y)
        sides.append(
            np.where(ends, np.where(normal_x > 0, 0, 1), np.where(normal_y > 0, 2, 3)).astype(np.int64)
        )
    return sides[0], sides[1]


def _grown(hits: Moves, found_at: FloatArray, start: int) -> FloatArray:
    largest, present = hits.overlap(found_at), hits.tracks.present
    for step in range(start, hits.tracks.states.shape[1]):
        later = np.flatnonzero(hits.step < step)
        moves = hits.take(later).at_step(np.full(later.size, step))
        area = moves.overlap(np.zeros(later.size))
        if present is not None:
            there = present[moves.future, step, moves.first] & present[moves.future, step, moves.second]
            area = np.where(there, area, 0.0)
        with np.errstate(invalid="ignore"):  # of vehicles that leave in the step of the impact
            largest[later] = np.maximum(largest[later], area)
    seed = hits.at_step(np.full(hits.step.size, start)).overlap(np.zeros(found_at.size))
    return largest - np.where(np.isfinite(seed), seed, 0.0)
