"""Actions of an initiator: brakes, goes on where it has to wait, cuts in, drifts over the line, steps out.

Each action has one parameter with ten values. It begins at the seed moment. It shows from its onset on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.certainty.response.motion.blocked import Blocked, blocked_stretches
from scex_sumo.certainty.response.motion.expected import STEPS, Expected
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.roads.matching import match
from scex_sumo.scene import STEP_S, SeedScene


@dataclass(frozen=True, kw_only=True)
class Action:
    """Kind of action.

    Attributes:
        values: of its parameter, ascending.
        words: of the action with at least a value of the parameter.
    """

    name: str
    unit: str
    values: tuple[float, ...]
    words: str


BRAKES, GOES_ON, CUTS_IN, DRIFTS, STEPS_OUT = range(5)
ACTIONS: Final = (
    Action(
        name="brakes",
        unit="m/s²",
        values=(0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
        words="brakes with {} m/s² or more",
    ),
    Action(
        name="goes on",
        unit="m/s²",
        values=tuple(np.linspace(0.0, 3.0, 10).round(2).tolist()),
        words="goes on where it has to wait, accelerating by {} m/s² or more",
    ),
    Action(
        name="cuts in",
        unit="m/s",
        values=tuple(np.linspace(0.3, 2.5, 10).round(2).tolist()),
        words="cuts in with {} m/s to the side or more",
    ),
    Action(
        name="drifts",
        unit="m/s",
        values=tuple(np.linspace(0.1, 1.0, 10).round(2).tolist()),
        words="drifts over with {} m/s to the side or more",
    ),
    Action(
        name="steps out",
        unit="m/s",
        values=tuple(np.linspace(1.0, 2.5, 10).round(2).tolist()),
        words="steps out within 2 s, with {} m/s or more",
    ),
)
LEVELS: Final = 10

STEPS_AT_S: Final = (0.2, 1.2, 0.7, 1.7, 0.45, 1.45, 0.95, 1.95, 0.08, 1.08)
"""Times at which people step out with each of the ten speeds: both fill their ranges evenly."""
SHOWN_M: Final = 0.375
"""Way to the side after which a cut-in shows (UN Regulation 157)."""
GRAZE_M: Final = 0.3
"""Overlap of the widths that is no contact: lines are not better known, and one moves aside so far."""
COMFORT_MPS2: Final = 3.0
"""A vehicle goes on from where it can no longer stop with this deceleration."""

TIME_S: Final = STEP_S * np.arange(STEPS + 1)
_HORIZON = 30  # steps within which ways have to come near
_MOVING_MPS, _MOVES_M = 0.5, 1.0
_WAITS_M = 1.5  # less than at kept speed, in 3 s
_GOING_MPS = 10.0  # most that one reaches that goes on from a slower speed
_ASIDE_M = (1.8, 5.5)  # from the responder's line, of a vehicle that can come over
_BESIDE_M = -6.0  # along it, least place of its centre
_PARALLEL_RAD, _OPPOSED_RAD = np.deg2rad(20.0), np.deg2rad(150.0)
_MEDIAN_M = 1.0  # off the lanes between two opposing ones: nobody drifts across
_FOLLOWS = (8.0, 2.0)  # a leader within 8 m + 2 s is followed
_NEAR_M = 6.0  # between lines
_OUTSIDE_M = 0.3  # least free way between a person and the responder's lane of motion
_COARSE = 3  # every such sample of a line
_PAIRS_AT_ONCE = 64  # fits the processor's cache


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Ordered pairs of vehicles whose lines come near, with their expected motion.

    Attributes:
        initiator: (n,) index into the seed scene; so ``responder``.
        blocked: (n, T) of the responder's line, if both move as expected.
    """

    expected: Expected
    initiator: IntArray
    responder: IntArray
    blocked: Blocked

    def __len__(self) -> int:
        return len(self.initiator)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cases:
    """Actions of initiators: m rows, one for each pair, action and value of its parameter.

    The ten values of an action of a pair are consecutive.

    Attributes:
        pair: (m,) index into the pairs; ``action`` into `ACTIONS`.
        value: (m,) of the parameter.
        outlines: (m, T) of the initiator.
        velocity: (m, T, 2) of the initiator, m/s.
        onset_s: (m,) time from which the action shows; inf for never.
        blocked: (m, T) stretch of the responder's line.
    """

    pairs: Pairs
    pair: IntArray
    action: IntArray
    value: FloatArray
    outlines: Rectangles
    velocity: FloatArray
    onset_s: FloatArray
    blocked: Blocked

    def __len__(self) -> int:
        return len(self.pair)

    def take(self, index: IntArray) -> Cases:
        """Select rows by index."""
        names = ("pair", "action", "value", "velocity", "onset_s")
        return Cases(
            pairs=self.pairs,
            outlines=self.outlines.part(index),
            blocked=self.blocked.take(index),
            **{name: getattr(self, name)[index] for name in names},
        )


def pairs_of(expected: Expected, responders: IntArray | None = None) -> Pairs:
    """Return the ordered pairs of vehicles whose lines come near within the time of `STEPS`.

    Args:
        responders: indices of those that count; None for all.
    """
    x, y = expected.lines.x[:, ::_COARSE], expected.lines.y[:, ::_COARSE]
    step = expected.lines.spacing_m * _COARSE
    ahead = expected.lines.start[0] + step * np.arange(x.shape[1])
    reach = np.maximum(expected.s[:, -1], STEPS * STEP_S * expected.scene.now.speed) + _FOLLOWS[0]
    inside = ahead <= reach[:, None]
    size = (np.hypot(expected.scene.length, expected.scene.width) / 2).max(initial=0.0)
    near = _boxes_meet(x, y, inside, _NEAR_M + size)
    near[:, expected.vehicles :] = False
    if responders is not None:
        near[:, np.setdiff1d(np.arange(len(x)), responders)] = False
    i, j = np.nonzero(near & ~np.eye(len(x), dtype=np.bool_))
    points = np.stack([x - x.mean(), y - y.mean()], axis=-1)
    square = np.where(inside, (points**2).sum(axis=-1), np.inf)
    close = np.zeros(len(i), dtype=np.bool_)
    for begin in range(0, len(i), _PAIRS_AT_ONCE):
        one, other = i[begin : begin + _PAIRS_AT_ONCE], j[begin : begin + _PAIRS_AT_ONCE]
        apart = square[other][:, None] - 2 * points[one] @ points[other].swapaxes(1, 2)
        least = (apart.min(axis=2) + square[one]).min(axis=1)
        close[begin : begin + len(one)] = least < _NEAR_M**2
    moves = (expected.s[j, -1] > _MOVES_M) & close
    initiator, responder = i[moves].astype(np.int64), j[moves].astype(np.int64)
    outlines = _outlines(expected, initiator, expected.s[initiator])
    return Pairs(
        expected=expected,
        initiator=initiator,
        responder=responder,
        blocked=_blocked(expected, responder, outlines),
    )


def cases_of(pairs: Pairs, only: BoolArray | None = None) -> Cases:
    """Return all actions that can happen in pairs, or in (n,) some of them."""
    scene, i = pairs.expected.scene, pairs.initiator
    possible = _possible(pairs)
    chosen = [np.flatnonzero(mask if only is None else mask & only) for mask in possible]
    pair = np.concatenate([np.repeat(index, LEVELS) for index in chosen])
    action = np.repeat(np.arange(len(ACTIONS)), [LEVELS * len(index) for index in chosen])
    value = np.concatenate(
        [np.tile(kind.values, len(index)) for kind, index in zip(ACTIONS, chosen, strict=True)]
    )
    who, v0 = i[pair], scene.now.speed[i[pair]][:, None]
    expected, strength = pairs.expected.s[who], value[:, None]
    braking = np.minimum(TIME_S, v0 / strength.clip(1e-9))
    limit = np.maximum(v0, _GOING_MPS)
    speeding = np.minimum(TIME_S, (limit - v0) / strength.clip(1e-9))
    gone = v0 * TIME_S + strength * speeding * (TIME_S - speeding / 2)
    kind = action[:, None]
    s = np.where(kind == BRAKES, np.minimum(v0 * braking - strength * braking**2 / 2, expected), expected)
    s = np.where(kind == GOES_ON, np.maximum(gone, expected), s)
    off, _, turn = (values[pair][:, None] for values in _offset(pairs))
    left = -np.sign(off) * np.where(np.abs(turn) < np.pi / 2, 1.0, -1.0)  # of the initiator, towards the line
    beside = (kind == CUTS_IN) | (kind == DRIFTS)
    aside = np.where(beside, left * np.minimum(strength * TIME_S, np.abs(off)), 0.0)
    outlines = _outlines(pairs.expected, who, s, aside)
    _step_out(outlines, pairs, pair, value, np.flatnonzero(action == STEPS_OUT))
    blocked = _blocked(pairs.expected, pairs.responder[pair], outlines)
    return Cases(
        pairs=pairs,
        pair=pair,
        action=action,
        value=value,
        outlines=outlines,
        velocity=np.stack([np.gradient(v, STEP_S, axis=1) for v in (outlines.x, outlines.y)], axis=-1),
        onset_s=_onset(action, value, s, blocked),
        blocked=blocked,
    )


def _step_out(outlines: Rectangles, pairs: Pairs, pair: IntArray, value: FloatArray, when: IntArray) -> None:
    """Let people cross the responders' lines in rows ``when``, from `STEPS_AT_S` on, in place."""
    now, i = pairs.expected.scene.now, pairs.initiator[pair[when]]
    off, _, turn = (values[pair[when]] for values in _offset(pairs))
    across = (now.heading[i] - turn - np.sign(off) * np.pi / 2)[:, None]
    begin = np.resize(STEPS_AT_S, len(when))[:, None]
    before, after = np.minimum(TIME_S, begin), np.maximum(TIME_S - begin, 0.0) * value[when, None]
    heading, walked = now.heading[i, None], now.speed[i, None] * before
    outlines.x[when] = now.x[i, None] + walked * np.cos(heading) + after * np.cos(across)
    outlines.y[when] = now.y[i, None] + walked * np.sin(heading) + after * np.sin(across)
    outlines.heading[when] = np.where(after > 0, across, heading)


def contexts(pairs: Pairs) -> BoolArray:
    """Return whether (n,) initiators follow a leader; of people, whether they approach with 0.5 m/s."""
    off, _, turn = _offset(pairs)
    i, scene = pairs.initiator, pairs.expected.scene
    approaches = -np.sign(off) * np.sin(turn) * scene.now.speed[i] > _MOVING_MPS
    return np.asarray(np.where(i < pairs.expected.vehicles, leads_and_follows(pairs)[1][i], approaches))


def _possible(pairs: Pairs) -> list[BoolArray]:
    """Return for each action the (n,) pairs in which it can happen."""
    expected, i, j = pairs.expected, pairs.initiator, pairs.responder
    walks = i >= expected.vehicles
    speed, soon = expected.scene.now.speed, slice(0, _HORIZON + 1)
    enter, own = pairs.blocked.enter, expected.s[j]
    ahead = np.isfinite(enter) & (enter + pairs.blocked.leave.clip(-1e9) > 2 * own)
    leads, follows = leads_and_follows(pairs)
    brakes = (speed[i] > _MOVING_MPS) & ahead[:, soon].any(axis=1) & ~(ahead[:, 0] & ~leads)
    waits = expected.s[i, _HORIZON] < np.maximum(speed[i] * TIME_S[_HORIZON], 2 * _WAITS_M) - _WAITS_M
    off, along, turn = _offset(pairs)
    turn = np.abs(turn)
    behind = _near(off, turn) & (along < 0)  # comes up to a queue
    to_side, before, turned = _offset(pairs, reverse=True)  # lines begin a few metres behind vehicles
    behind |= _near(to_side, turned) & (before > 0)
    goes_on = waits & ~follows[i] & ~ahead[:, 0] & ~behind
    aside = (np.abs(off) >= _ASIDE_M[0]) & (np.abs(off) <= _ASIDE_M[1]) & (speed[i] > _MOVING_MPS)
    aside &= ~np.isfinite(enter[:, soon]).any(axis=1) & (along > _BESIDE_M)
    opposed = aside & (turn > _OPPOSED_RAD)
    width = _lane_widths(expected.scene, np.union1d(i[opposed], j[opposed]))
    opposed &= np.abs(off) - (width[i] + width[j]) / 2 <= _MEDIAN_M
    sides = [aside & (turn < _PARALLEL_RAD), opposed]
    size = (expected.scene.width[j] + np.hypot(expected.scene.length[i], expected.scene.width[i])) / 2
    outside = (np.abs(off) > size + _OUTSIDE_M) & (np.abs(off) < _NEAR_M) & (along > 0)
    return [*(mask & ~walks for mask in (brakes, goes_on, *sides)), outside & walks]


def _near(off: FloatArray, turn: FloatArray) -> BoolArray:
    return np.asarray((np.abs(off) < _ASIDE_M[0]) & (np.abs(turn) < np.pi / 4))


def _lane_widths(scene: SeedScene, who: IntArray) -> FloatArray:
    """Return (V,) width of the lane on which vehicles of some indices are, m; inf off the lanes, and else."""
    width = np.full(scene.vehicles, np.inf)
    if scene.road is not None and len(who):
        now = scene.now[who]
        matches = match(scene.road, now.x, now.y, now.heading)
        lanes = [scene.road.lanes[k].width_m for k in matches.lane_id[matches.best].tolist()]
        width[who[matches.vehicle[matches.best]]] = lanes
    return width


def leads_and_follows(pairs: Pairs) -> tuple[BoolArray, BoolArray]:
    """Return whether (n,) initiators lead their responders now, and whether (V,) vehicles follow one."""
    expected = pairs.expected
    enter, leave = pairs.blocked.enter[:, 0], pairs.blocked.leave[:, 0]
    ahead = (enter + leave.clip(-1e9) > 0) & (pairs.initiator < expected.vehicles)
    enter = np.where(ahead, enter, np.inf)
    least = np.full(expected.scene.vehicles, np.inf)
    np.minimum.at(least, pairs.responder, enter)
    leads = np.isfinite(enter) & (enter <= least[pairs.responder])
    return leads, least < _FOLLOWS[0] + _FOLLOWS[1] * expected.scene.now.speed


def _offset(pairs: Pairs, *, reverse: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (n,) offset of initiators from responders' lines, m, place along them, and turn against them.

    Args:
        reverse: of responders from initiators' lines.
    """
    lines, now = pairs.expected.lines, pairs.expected.scene.now
    x, y, (i, j) = lines.x, lines.y, (pairs.initiator, pairs.responder)[:: -1 if reverse else 1]
    nearest = np.argmin((x[j] - now.x[i, None]) ** 2 + (y[j] - now.y[i, None]) ** 2, axis=1)
    heading = lines.heading[j, nearest]
    dx, dy = now.x[i] - x[j, nearest], now.y[i] - y[j, nearest]
    off = np.cos(heading) * dy - np.sin(heading) * dx
    return off, lines.start[j] + nearest * lines.spacing_m, wrap(now.heading[i] - heading)


def _outlines(
    expected: Expected, who: IntArray, s: FloatArray, aside: FloatArray | float = 0.0
) -> Rectangles:
    """Return (m, T) outlines of vehicles at arc lengths, and so far to the left of their lines, m."""
    x, y, heading = expected.lines.at(who, s)
    return Rectangles(
        x=x - aside * np.sin(heading),
        y=y + aside * np.cos(heading),
        heading=heading,
        half_length=expected.scene.length[who][:, None] / 2,
        half_width=expected.scene.width[who][:, None] / 2,
    )


def _blocked(expected: Expected, responder: IntArray, outlines: Rectangles) -> Blocked:
    length, width = expected.scene.length[responder], expected.scene.width[responder]
    return blocked_stretches(expected.lines, responder, length, width - GRAZE_M, outlines)


def _onset(action: IntArray, value: FloatArray, s: FloatArray, blocked: Blocked) -> FloatArray:
    """Return (m,) times from which actions show, s."""
    aside = SHOWN_M / value.clip(1e-9)
    aside = aside + np.where(action == STEPS_OUT, np.resize(STEPS_AT_S, len(value)), 0.0)
    speed = np.gradient(s, STEP_S, axis=1)
    meets = np.isfinite(blocked.enter)
    first = np.argmax(meets, axis=1)
    place = s[np.arange(len(s)), first]
    past = s >= place[:, None] - speed**2 / (2 * COMFORT_MPS2)
    going = np.where(meets.any(axis=1), TIME_S[np.argmax(past, axis=1)], np.inf)
    return np.select([action == BRAKES, action == GOES_ON], [np.zeros_like(value), going], aside)


def _boxes_meet(x: FloatArray, y: FloatArray, inside: BoolArray, margin: float) -> BoolArray:
    """Return (V, V) whether the boxes around two lines (V, N) meet; only points inside count."""
    meet = np.ones((len(x), len(x)), dtype=np.bool_)
    for values in (x, y):
        low = np.where(inside, values, np.inf).min(axis=1) - margin
        high = np.where(inside, values, -np.inf).max(axis=1) + margin
        meet &= (low[:, None] <= high) & (low <= high[:, None])
    return meet
