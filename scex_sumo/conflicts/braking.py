"""Needed braking: the least constant deceleration from now on with which a vehicle avoids another one.

The other one goes on as it does: a braking one brakes to rest, an accelerating one accelerates for a second,
then keeps its speed. Both keep their ways: driven, then as planned, then straight on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.geometry.polylines import Paths, wrap
from scex_sumo.geometry.rectangles import Rectangles, axis_separations, separation
from scex_sumo.scene import STEP_S, States

MOST_MPS2: Final = 20.0
"""Needed braking that stands for all beyond it, and for a contact that no braking avoids."""
HORIZON_S: Final = 8.0
"""Time for which a vehicle goes on from each step."""
NODES: Final = 64
"""Samples of a path, equally far from each other."""
_MEAN_STEPS = 5
_STEP_S = 0.2
_TIMES_S = np.arange(0.0, HORIZON_S + 1e-9, _STEP_S)[1:]
_ACCELERATES_S = 1.0
_SLACK_M = 1e-6  # of rounding, where what is out of reach is left out
_MOVED_M = 0.01  # a shorter step has no direction
_AT_ONCE = 1 << 12  # pairs of ways
_BLOCK = 8  # nodes that are looked at together first


def needed_braking(
    paths: DrivenPaths, shared: Shared, acceleration: FloatArray, steps: IntArray
) -> FloatArray:
    """Return (n, S) needed braking of the own vehicles at steps (S,) of T, m/s²; 0 where none is needed.

    ``acceleration``: (R, T) of all vehicles, m/s².
    """
    needed = np.zeros((len(shared.own), len(steps)))
    pair, look = np.nonzero(_in_reach(paths, shared, acceleration, steps))
    needed[pair, look] = _needed(paths, shared, acceleration, pair, steps[look])
    return needed


def _needed(
    paths: DrivenPaths, shared: Shared, acceleration: FloatArray, pair: IntArray, step: IntArray
) -> FloatArray:
    """Return the needed braking (m,) of the own vehicles of rows (m,) at steps (m,)."""
    own, other = (shared.own[pair], step), (shared.other[pair], step)
    speed = paths.states.speed[own][:, None]
    gone = paths.arc[other][:, None] + distance(paths.states.speed[other], acceleration[other])
    enter, leave = (values - paths.arc[own][:, None] for values in _blocked(paths, shared, pair, gone))
    unbraked = speed * _TIMES_S
    contact = (unbraked >= enter) & (unbraked <= leave)  # False where nothing is blocked
    since = np.logical_or.accumulate(contact, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        moving = 2 * (unbraked - enter) / _TIMES_S**2
        stopped = speed**2 / (2 * enter)
    needed = np.where(enter >= unbraked / 2, moving, stopped)
    needed = np.where(enter <= 0, MOST_MPS2, np.clip(needed, 0.0, MOST_MPS2))
    needed = np.where(since & np.isfinite(enter), needed, 0.0).max(axis=-1)
    # One that the other comes up to from behind cannot let it pass.
    led = ((unbraked > leave) & ~since).any(axis=-1)
    return np.asarray(np.where(led & since[..., -1], MOST_MPS2, needed))


def _in_reach(paths: DrivenPaths, shared: Shared, acceleration: FloatArray, steps: IntArray) -> BoolArray:
    """Return whether (n, S) both may reach the shared stretch in time; one that reverses may always."""
    own, other = (shared.own[:, None], steps), (shared.other[:, None], steps)
    reverses = np.minimum(paths.states.speed[own], paths.states.speed[other]) < 0
    known = ~np.isnan(shared.enter)
    first, last = np.argmax(known, axis=1), NODES - 1 - np.argmax(known[:, ::-1], axis=1)
    spacing = paths.spacing[shared.other][:, None]
    after = paths.arc[other] + distance(paths.states.speed[other], acceleration[other], _TIMES_S[-1:])[..., 0]
    begin, end = (first[:, None] - 1) * spacing - _SLACK_M, (last[:, None] + 1) * spacing + _SLACK_M
    meets = (after >= begin) & (paths.arc[other] <= end)
    enter = np.fmin.reduce(shared.enter, axis=1)[:, None] - _SLACK_M
    leave = np.fmax.reduce(shared.leave, axis=1)[:, None] + _SLACK_M
    reached = paths.arc[own] + paths.states.speed[own] * HORIZON_S
    return np.asarray(reverses | (meets & (reached >= enter) & (paths.arc[own] <= leave)))


def both_braking(paths: DrivenPaths, shared: Shared, steps: IntArray) -> FloatArray:
    """Return (n, S) deceleration of both vehicles with which two that face each other stop in time, m/s².

    0 where the other one is not on the way ahead, `MOST_MPS2` where they touch already.
    """
    own, other = (shared.own[:, None], steps), (shared.other[:, None], steps)
    enter = _blocked(paths, shared, np.arange(len(shared.own)), paths.arc[other])[0] - paths.arc[own]
    speed = paths.states.speed
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = (speed[own] ** 2 + speed[other] ** 2) / (2 * enter)
    needed = np.where(enter > 0, np.minimum(needed, MOST_MPS2), MOST_MPS2)
    return np.asarray(np.where(np.isnan(enter), 0.0, needed))


def recent_acceleration(speed: FloatArray) -> FloatArray:
    """Return (R, T) mean acceleration over the last half second, m/s², by speeds; 0 at first."""
    acceleration = np.zeros_like(speed)
    acceleration[:, _MEAN_STEPS:] = (speed[:, _MEAN_STEPS:] - speed[:, :-_MEAN_STEPS]) / (
        _MEAN_STEPS * STEP_S
    )
    return acceleration


def distance(speed: FloatArray, acceleration: FloatArray, times_s: FloatArray = _TIMES_S) -> FloatArray:
    """Return the (..., K) way of vehicles that go on as they do, by times (K,), m."""
    speed, acceleration = speed[..., None], acceleration[..., None]
    rest = np.where(acceleration < 0, speed / np.maximum(-acceleration, 1e-9), np.inf)
    braked = np.minimum(times_s, rest)
    faster = np.minimum(times_s, _ACCELERATES_S)
    slowing = speed * braked + acceleration * braked**2 / 2
    growing = speed * times_s + acceleration * (faster * times_s - faster**2 / 2)
    return np.asarray(np.where(acceleration < 0, slowing, growing))


def _blocked(
    paths: DrivenPaths, shared: Shared, pair: IntArray, arc: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the stretches (m, K) of rows (m,) that are blocked while the others are at an arc length, m."""
    node = np.clip(arc / paths.spacing[shared.other[pair]][:, None], 0, NODES - 1)
    below = np.minimum(node.astype(np.int64), NODES - 2)
    share, flat = node - below, NODES * pair[:, None] + below
    ends = []
    for values, widest in ((shared.enter, np.fmin), (shared.leave, np.fmax)):
        a, b = values.take(flat), values.take(flat + 1)
        between = (1 - share) * a + share * b
        ends.append(np.where(np.isnan(between), widest(a, b), between))
    return ends[0], ends[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenPaths(Paths):
    """Paths of R vehicles of futures, driven in T steps, with `NODES` samples."""

    states: States  # (R, T) as driven
    length: FloatArray  # (R,) m; so ``width``
    width: FloatArray
    arc: FloatArray  # (R, T) arc length at each step, m

    @classmethod
    def of(
        cls, states: States, length: FloatArray, width: FloatArray, planned: FloatArray | None
    ) -> DrivenPaths:
        """Build the paths of vehicles, by states (R, T) as driven.

        ``planned``: (2, R, H) x and y of the centres after the last step, m; None: straight on.
        """
        x, y, heading = _lines(states, planned)
        step = np.hypot(np.diff(x), np.diff(y))
        line = np.concatenate([np.zeros((len(x), 1)), step.cumsum(axis=1)], axis=1)
        arc = line[:, : states.shape[1]]
        reach = np.maximum((arc + HORIZON_S * states.speed).max(axis=1), 1.0)
        line[:, -1] = np.maximum(line[:, -1], line[:, -2] + 1e-3)  # the straight end
        spacing = reach / (NODES - 1)
        even = spacing[:, None] * np.arange(NODES)
        # A row at a time: its values are the same in any batch. Standing vehicles have equal arc lengths, of
        # which np.interp takes the last one.
        x, y, heading = (
            np.array([np.interp(*of_vehicle) for of_vehicle in zip(even, line, v, strict=True)]).reshape(
                even.shape
            )
            for v in (x, y, heading)
        )
        size = {"length": length, "width": width}
        return cls(states=states, arc=arc, spacing=spacing, x=x, y=y, heading=heading, **size)

    @cached_property
    def box(self) -> FloatArray:
        """(4, R) least x, least y, largest x, largest y of the outlines along the path, m."""
        reach = np.hypot(self.length, self.width) / 2
        low = [self.x.min(axis=1) - reach, self.y.min(axis=1) - reach]
        return np.stack([*low, self.x.max(axis=1) + reach, self.y.max(axis=1) + reach])

    def outlines(self, path: IntArray, node: IntArray) -> Rectangles:
        """Return outlines of vehicles at samples of their paths."""
        x, y, heading = (values[path, node] for values in (self.x, self.y, self.heading))
        size = {"half_length": self.length[path] / 2, "half_width": self.width[path] / 2}
        return Rectangles(x=x, y=y, heading=heading, **size)


def _lines(states: States, planned: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y and heading (R, T + H + 1) of the points of each way; the last point is far ahead."""
    x, y = states.x, states.y
    if planned is not None:
        x, y = np.concatenate([x, planned[0]], axis=1), np.concatenate([y, planned[1]], axis=1)
    dx, dy = np.diff(x[:, states.shape[1] - 1 :]), np.diff(y[:, states.shape[1] - 1 :])
    turn = np.where(np.hypot(dx, dy) > _MOVED_M, np.arctan2(dy, dx), np.nan)
    heading = np.concatenate([states.heading, turn], axis=1)
    for column in range(1, heading.shape[1]):  # a short step keeps the heading
        heading[:, column] = np.where(
            np.isnan(heading[:, column]), heading[:, column - 1], heading[:, column]
        )
    heading = np.unwrap(heading, axis=1)
    far = HORIZON_S * np.maximum(states.speed.max(axis=1), 1.0)
    x = np.concatenate([x, (x[:, -1] + far * np.cos(heading[:, -1]))[:, None]], axis=1)
    y = np.concatenate([y, (y[:, -1] + far * np.sin(heading[:, -1]))[:, None]], axis=1)
    return x, y, np.concatenate([heading, heading[:, -1:]], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shared(Rows):
    """Stretches (n, N) of n vehicles' ways that others block, by the node at which the other one is."""

    own: IntArray  # (n,) row of the way
    other: IntArray  # (n,) of the other vehicle's
    # arc length of the first contact on the own way, m; NaN where the other one blocks nothing
    enter: FloatArray
    leave: FloatArray  # that of the last contact, m

    def least_angle(self, paths: DrivenPaths) -> FloatArray:
        """Return the least angle (n,) of both headings where the ways touch, rad."""
        node = np.nan_to_num(np.rint(self.enter / paths.spacing[self.own][:, None])).astype(np.int64)
        own = paths.heading[self.own[:, None], np.clip(node, 0, NODES - 1)]
        angle = np.abs(wrap(own - paths.heading[self.other]))
        return np.asarray(np.where(np.isnan(self.enter), np.inf, angle).min(axis=1, initial=np.inf))


def shared_stretches(paths: DrivenPaths, first: IntArray, second: IntArray) -> tuple[Shared, Shared]:
    """Return the shared stretches of pairs of ways (rows, (P,) each): of the first and the second ones.

    Pairs that share nothing are left out.
    """
    low, high = paths.box[:2], paths.box[2:]
    meet = ((low[:, first] <= high[:, second]) & (low[:, second] <= high[:, first])).all(axis=0)
    first, second = first[meet], second[meet]
    parts: tuple[list[Shared], list[Shared]] = ([], [])
    for start in range(0, max(len(first), 1), _AT_ONCE):
        batch = slice(start, start + _AT_ONCE)
        for shared, some in zip(_of_some(paths, first[batch], second[batch]), parts, strict=True):
            some.append(shared)
    return Shared.join(parts[0]), Shared.join(parts[1])


def _of_some(paths: DrivenPaths, first: IntArray, second: IntArray) -> tuple[Shared, Shared]:
    pair, node, other = _near_nodes(paths, first, second)
    gaps = separation(paths.outlines(first[pair], node), paths.outlines(second[pair], other))
    touch = np.unique(pair[gaps <= 0])
    kept = np.isin(pair, touch)
    hit = np.zeros((len(touch), NODES, NODES), dtype=np.bool_)
    hit[np.searchsorted(touch, pair[kept]), node[kept], other[kept]] = gaps[kept] <= 0
    first, second = first[touch], second[touch]
    return _stretches(paths, first, second, hit.swapaxes(1, 2)), _stretches(paths, second, first, hit)


def _near_nodes(paths: DrivenPaths, one: IntArray, two: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return pair and both nodes where outlines may touch, and the nodes next to these."""
    half = np.hypot(paths.length, paths.width) / 2
    reach = half[one] + half[two] + np.maximum(paths.spacing[one], paths.spacing[two])
    coarse = _BLOCK // 2 + _BLOCK * np.arange(NODES // _BLOCK)
    wide = reach + (paths.spacing[one] + paths.spacing[two]) * _BLOCK / 2
    x, y = paths.x, paths.y
    dx = x[one][:, coarse, None] - x[two][:, None, coarse]
    dy = y[one][:, coarse, None] - y[two][:, None, coarse]
    pair, i, j = np.nonzero(dx * dx + dy * dy < (wide * wide)[:, None, None])
    inner = np.arange(_BLOCK)
    first, second = (_BLOCK * i)[:, None] + inner, (_BLOCK * j)[:, None] + inner
    dx = x[one[pair][:, None], first][:, :, None] - x[two[pair][:, None], second][:, None]
    dy = y[one[pair][:, None], first][:, :, None] - y[two[pair][:, None], second][:, None]
    row, a, b = np.nonzero(dx * dx + dy * dy < (reach * reach)[pair][:, None, None])
    return pair[row], first[row, a], second[row, b]


def _stretches(paths: DrivenPaths, own: IntArray, other: IntArray, hit: BoolArray) -> Shared:
    """Return where ways are blocked, by whether outlines touch (n, other's node, own node)."""
    pair, node = np.nonzero(hit.any(axis=2))
    inside = hit[pair, node]
    first, last = np.argmax(inside, axis=1), NODES - 1 - np.argmax(inside[:, ::-1], axis=1)

    def edge(touching: IntArray, step: int) -> FloatArray:
        """Return arc lengths (n, N) between a node with contact and the next one, where contact ends."""
        beyond = np.clip(touching + step, 0, NODES - 1)
        share = shares_of_contact(
            paths.outlines(own[pair], touching),
            paths.outlines(own[pair], beyond),
            paths.outlines(other[pair], node),
        )
        arc = np.full((len(own), NODES), np.nan)
        arc[pair, node] = paths.spacing[own[pair]] * (
            touching + step * np.where(beyond == touching, 0.0, share)
        )
        return arc

    return Shared(own=own, other=other, enter=edge(first, -1), leave=edge(last, 1))


def shares_of_contact(box: Rectangles, moved: Rectangles, other: Rectangles) -> FloatArray:
    """Return the share (n,) of a move, of outlines to ``moved``, at which contact ends; 0: never."""
    touching, apart = axis_separations(box, other), axis_separations(moved, other)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(apart > 0, touching / (touching - apart), np.inf).min(axis=0)
    return np.where(np.isfinite(share), share, 0.0)
