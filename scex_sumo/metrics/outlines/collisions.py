"""Collisions of vehicles: who, when, how, how hard; exact between steps.

Two vehicles have collided where their rectangles overlap by more than 0.1 m² at some time after the seed
moment, and did not at the seed moment. Between steps positions go in straight lines, headings along the
shorter arc.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import axis_separations, relative_pose
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.outlines.motion import Moves, near_moves

OVERLAP_M2: Final = 0.1
"""Overlap above which two vehicles have collided."""

KINDS: Final = ("rear-end", "side", "head-on")
SIDES: Final = ("front", "rear", "left", "right")

_SPLITS = 10  # halvings of a step: what exceeds the overlap for less than 0.1 ms may be overlooked
_BISECTIONS = 40
_REAR_END, _HEAD_ON = np.pi / 6, np.pi * 5 / 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Collisions:
    """The first collision of every pair of vehicles of every child, sorted by child, time and pair.

    Attributes:
        child: (N,).
        step: (N,) first step at or after the impact, on the step axis of the tracks, history included.
        time_s: (N,) impact after the seed moment: the beginning of the contact that grew to a collision.
        first: (N,) vehicle; in a rear-end collision the one that hits with its front, else the lower index.
        second: (N,) vehicle.
        kind: (N,) index into ``KINDS``.
        first_side: (N,) side of the first vehicle that is touched first, index into ``SIDES``.
        second_side: (N,) the same of the second.
        relative_speed: (N,) ‖v₁ − v₂‖ at impact, m/s.
        overlap: (N,) largest overlap afterwards less that of the seed moment, m².
        x: (N,) middle between both centres at impact, m.
        y: (N,) m.
    """

    child: IntArray
    step: IntArray
    time_s: FloatArray
    first: IntArray
    second: IntArray
    kind: IntArray
    first_side: IntArray
    second_side: IntArray
    relative_speed: FloatArray
    overlap: FloatArray
    x: FloatArray
    y: FloatArray

    def __len__(self) -> int:
        return len(self.child)

    def take(self, index: IntArray) -> Collisions:
        """Some of them."""
        return Collisions(**{field.name: getattr(self, field.name)[index] for field in fields(self)})

    def kinds(self) -> NDArray[np.str_]:
        """(N,) kinds in words."""
        return np.array(KINDS)[self.kind]

    def any_of(self, children: int) -> BoolArray:
        """(C,) whether a child has a collision."""
        hit = np.zeros(children, dtype=bool)
        hit[self.child] = True
        return hit


def find_collisions(tracks: SceneTracks) -> Collisions:
    """The first collision of every pair in every child.

    Args:
        tracks: what the vehicles did; the seed moment is the last step of the history, or the first step
            where there is none. A pair is judged from the first step on at which it is near and present.
    """
    start = max(tracks.first - 1, 0)
    moves = _contacts(near_moves(tracks, start))
    at, found = _first_of_pair(moves, *_exceeding(moves))
    if not len(found):
        return _no_collisions()
    hits = moves.take(found)
    return _described(*_impact(hits, at), hits, at, start)


def _no_collisions() -> Collisions:
    number, value = np.empty(0, dtype=np.int64), np.empty(0)
    return Collisions(
        child=number,
        step=number,
        time_s=value,
        first=number,
        second=number,
        kind=number,
        first_side=number,
        second_side=number,
        relative_speed=value,
        overlap=value,
        x=value,
        y=value,
    )


def _contacts(moves: Moves) -> Moves:
    """Those in which the outlines may touch: gaps at both ends smaller than the way between them."""
    gap_way, _ = moves.way()
    zero = np.zeros(moves.child.shape)
    ends = moves.separation(zero) + moves.separation(zero + 1)
    return moves.take(np.flatnonzero(ends <= gap_way))


def _exceeding(moves: Moves) -> tuple[FloatArray, IntArray]:
    """A share of the step at which the overlap exceeds `OVERLAP_M2`, for the moves that have one.

    Branch and bound: a part of a step is halved as long as what the overlaps at its ends and the way between
    leave open may exceed the limit.

    Returns:
        (F,) shares and (F,) indices of the moves, ascending.
    """
    count = moves.child.size
    share = np.full(count, np.inf)
    start, end = moves.overlap(np.zeros(count)), moves.overlap(np.ones(count))
    share[end > OVERLAP_M2] = 1.0
    share[start > OVERLAP_M2] = 0.0
    gap_way, corner_way = moves.way()
    small = np.minimum(*(np.hypot(*moves.half_sizes(v)) for v in (moves.first, moves.second)))
    growth = 2 * np.pi * small * corner_way  # no outline within the smaller one is longer
    move = np.flatnonzero((share > 0) & (start + end + growth > 2 * OVERLAP_M2))
    low, width = np.zeros(move.size), 1.0
    ends = start[move], end[move]
    for _ in range(_SPLITS):
        width /= 2
        part, middle = moves.take(move), low + width
        area, gap = part.overlap(middle), part.separation(middle)
        np.minimum.at(share, move[area > OVERLAP_M2], middle[area > OVERLAP_M2])
        # Whoever is apart in the middle by more than half the way touches nowhere in this part.
        close = gap <= gap_way[move] * width
        rise = growth[move] * width
        left, right = (close & (e + area + rise > 2 * OVERLAP_M2) for e in ends)
        move, low, ends = (
            np.concatenate([move[left], move[right]]),
            np.concatenate([low[left], middle[right]]),
            (
                np.concatenate([ends[0][left], area[right]]),
                np.concatenate([area[left], ends[1][right]]),
            ),
        )
        keep = low < share[move]
        move, low, ends = move[keep], low[keep], (ends[0][keep], ends[1][keep])
        if move.size == 0:
            break
    found = np.flatnonzero(np.isfinite(share))
    return share[found], found


def _first_of_pair(moves: Moves, share: FloatArray, found: IntArray) -> tuple[FloatArray, IntArray]:
    """Of every pair the share and index of the first such move, unless the pair began so."""
    vehicles = moves.tracks.states.shape[2]
    key = (moves.child[found] * vehicles + moves.first[found]) * vehicles + moves.second[found]
    order = np.lexsort((moves.step[found], key))
    first = np.ones(order.size, dtype=bool)
    first[1:] = np.diff(key[order]) != 0
    chosen = order[first]
    began = (share[chosen] == 0) & _is_seen_first(moves.take(found[chosen]))
    chosen = chosen[~began]
    return share[chosen], found[chosen]


def _is_seen_first(moves: Moves) -> BoolArray:
    """(N,) whether the earlier step is the pair's first one: the seed moment, or when both are first seen."""
    before = moves.step - 1
    seen = before >= max(moves.tracks.first - 1, 0)
    present = moves.tracks.present
    if present is not None:
        at = np.maximum(before, 0)
        seen &= present[moves.child, at, moves.first] & present[moves.child, at, moves.second]
    return np.asarray(~seen)


def _impact(hits: Moves, share: FloatArray) -> tuple[Moves, FloatArray]:
    """Where the contact began that grew to a collision: the move and the share of it.

    A pair that touched from its first step on, by less than the limit, collides where it exceeds the limit.
    """
    step, end = hits.step.copy(), share.copy()
    going = np.flatnonzero(hits.separation(np.zeros(share.size)) <= 0)
    touching = np.zeros(share.size, dtype=bool)
    while going.size:
        part = _at_step(hits, step).take(going)
        began = _is_seen_first(part)
        touching[going[began]] = True
        going = going[~began]
        step[going] -= 1
        end[going] = 1.0
        apart = _at_step(hits, step).take(going).separation(np.zeros(going.size)) > 0
        going = going[~apart]
    step[touching], end[touching] = hits.step[touching], share[touching]
    moves = _at_step(hits, step)
    low, high = np.zeros(share.size), end
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        over = np.where(touching, moves.overlap(middle) > OVERLAP_M2, moves.separation(middle) <= 0)
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return moves, high


def _at_step(moves: Moves, step: IntArray) -> Moves:
    return Moves(tracks=moves.tracks, child=moves.child, step=step, first=moves.first, second=moves.second)


def _described(impact: Moves, share: FloatArray, hits: Moves, at: FloatArray, start: int) -> Collisions:
    """Kind, sides, speed and place of the impacts."""
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
    found = Collisions(
        child=impact.child,
        step=impact.step + 1,
        time_s=(impact.step - start + share) * impact.tracks.step_s,
        first=np.where(swap, impact.second, impact.first),
        second=np.where(swap, impact.first, impact.second),
        kind=kind,
        first_side=np.where(swap, sides[1], sides[0]),
        second_side=np.where(swap, sides[0], sides[1]),
        relative_speed=np.hypot(dvx, dvy),
        overlap=_grown(hits, at, start),
        x=(one.x + two.x) / 2,
        y=(one.y + two.y) / 2,
    )
    return found.take(np.lexsort((found.second, found.first, found.time_s, found.child)))


def _touched(impact: Moves, share: FloatArray) -> tuple[IntArray, IntArray]:
    """(N,) sides of both vehicles that touch first, indices into ``SIDES``."""
    one, two = impact.poses(share)
    gaps = axis_separations(one, two)
    # Of parallel outlines two axes agree but for rounding.
    axis = np.argmax(gaps >= gaps.max(axis=0) - 1e-6, axis=0)
    sides = []
    for index, pair in enumerate(((one, two), (two, one))):
        x, y, cos, sin = relative_pose(*pair)
        own_axis = (axis >= 2) == bool(index)
        # The contact's direction in the own frame: the own side's normal, or the other's side's turned here.
        lengthwise = axis % 2 == 0
        normal_x, normal_y = np.where(lengthwise, 1.0, 0.0), np.where(lengthwise, 0.0, 1.0)
        turned_x = np.where(lengthwise, cos, -sin)
        turned_y = np.where(lengthwise, sin, cos)
        normal_x, normal_y = np.where(own_axis, normal_x, turned_x), np.where(own_axis, normal_y, turned_y)
        sign = np.where(normal_x * x + normal_y * y < 0, -1.0, 1.0)
        normal_x, normal_y = sign * normal_x, sign * normal_y
        ends = np.abs(normal_x) >= np.abs(normal_y)
        sides.append(
            np.where(ends, np.where(normal_x > 0, 0, 1), np.where(normal_y > 0, 2, 3)).astype(np.int64)
        )
    return sides[0], sides[1]


def _grown(hits: Moves, at: FloatArray, start: int) -> FloatArray:
    """(N,) largest overlap from the impact on, at every step and where it was found, less the seed's, m²."""
    largest = hits.overlap(at)
    present = hits.tracks.present
    for step in range(start, hits.tracks.states.shape[1]):
        later = np.flatnonzero(hits.step < step)
        part = _at_step(hits, np.full(hits.step.size, step)).take(later)
        area = part.overlap(np.zeros(later.size))
        if present is not None:
            there = present[part.child, step, part.first] & present[part.child, step, part.second]
            area = np.where(there, area, 0.0)
        largest[later] = np.maximum(largest[later], area)
    seed = _at_step(hits, np.full(hits.step.size, start)).overlap(np.zeros(at.size))
    return largest - np.where(np.isfinite(seed), seed, 0.0)
