"""Conflicts that hold a vehicle back: leaders in its corridor, crossings that another one reaches first."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.guard.boxes import box_distances
from scex_sumo.behaviors.guard.profile import GuardProfile
from scex_sumo.behaviors.guard.ways import SAMPLE_S, SAMPLES, Expected, PlannedWays, expected, onto_ways
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, Who

MOST_PAIRS = 1024  # at a time: bounds the memory, and stays near the processor
SAME_WAY = 0.5  # cosine above which two go the same way: one follows the other instead of waiting for it
TOWARDS = -0.5  # cosine below which one comes towards the other
ORDER_DOUBT_M = 0.5
AT_ONCE_M = 0.5
CROSSING_M = 0.5  # two are at their crossing where the offset is this near to the least one


@dataclass(frozen=True, kw_only=True, eq=False)
class Holds:
    """Moving stop lines of vehicles, sorted by row.

    At time t the vehicle's centre stays behind position + speed·t - deceleration·t²/2, as long as the
    leader moves.

    Attributes:
        row: (P,) which of the n vehicles is held.
        position: (P,) m along its plan.
        speed: (P,) of the line, m/s, at least 0.
        deceleration: (P,) of the line, m/s², at least 0.
        stop_time: (P,) when the line stands still, s; inf where it does not.
        enter: (P,) when the other one gets into the corridor, s; 0 for one who is in it.
        until: (P,) when the hold ends, s.
        firm: (P,) True where harder braking than comfortable is worth it.
    """

    row: IntArray
    position: FloatArray
    speed: FloatArray
    deceleration: FloatArray
    stop_time: FloatArray
    enter: FloatArray
    until: FloatArray
    firm: BoolArray

    def joined_by(self, rows: IntArray) -> Holds:
        """The same holds, and one without effect for each of some further vehicles."""
        further = np.setdiff1d(rows, self.row)
        if not len(further):
            return self
        order = np.argsort(np.concatenate([self.row, further]), kind="stable")
        idle = np.zeros(len(further))
        values = {f.name: np.concatenate([getattr(self, f.name), idle])[order] for f in fields(self)}
        values["row"] = np.concatenate([self.row, further])[order]
        values["firm"] = values["firm"].astype(np.bool_)
        return Holds(**values)


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """What is looked at to find the holds of n vehicles, as in `find_holds`."""

    paths: PlannedWays
    around: Expected
    history: SceneHistory
    who: Who
    profile: GuardProfile


def find_holds(
    paths: PlannedWays, history: SceneHistory, road: Road, who: Who, profile: GuardProfile
) -> Holds:
    """Everything that the n vehicles have to stay behind.

    Args:
        paths: (n,) planned ways.
    """
    view = _View(paths=paths, around=expected(history, road), history=history, who=who, profile=profile)
    i, j = _near_pairs(view)
    parts = [
        _holds_of(view, i[k : k + MOST_PAIRS], j[k : k + MOST_PAIRS])
        for k in range(0, max(1, len(i)), MOST_PAIRS)
    ]
    return Holds(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Holds)})


def _near_pairs(view: _View) -> tuple[IntArray, IntArray]:
    """Who moves and can meet whom, by boxes around what both will cover."""
    paths, around, scene, who = view.paths, view.around, view.history.scene, view.who
    others = around.others
    own_reach = np.sqrt(scene.length**2 + scene.width**2)[who.vehicle] / 2 + view.profile.margin
    reach = own_reach[:, None] + np.sqrt(others.length**2 + others.width**2) / 2
    near = others.present[who.child] & (paths.arc[:, -1] > 0.0)[:, None]
    for mine, theirs in ((paths.corner_x, around.x), (paths.corner_y, around.y)):
        low, high = theirs.min(axis=2)[who.child], theirs.max(axis=2)[who.child]
        near &= low - reach <= mine.max(axis=1)[:, None]
        near &= high + reach >= mine.min(axis=1)[:, None]
    near[np.arange(len(who)), who.vehicle] = False
    if view.profile.touching > 0:
        near[:, : scene.vehicles] &= (box_distances(scene) >= view.profile.touching)[who.vehicle]
    i, j = np.nonzero(near)
    return i, j


@dataclass(frozen=True, kw_only=True, eq=False)
class _Blocked:
    """How others cover a corridor, (K, P): places are of the own centre, m along the plan.

    Attributes:
        inside: the other's body is in the corridor.
        s: the other's centre.
        offset: its distance from the middle line, left positive.
        cos: of its heading against the corridor's.
        low: where the own front bumper touches it.
        high: where the own rear bumper leaves it.
    """

    inside: BoolArray
    s: FloatArray
    offset: FloatArray
    cos: FloatArray
    low: FloatArray
    high: FloatArray


def _holds_of(view: _View, i: IntArray, j: IntArray) -> Holds:
    """Holds of pairs: vehicle i of the n, other j of the M."""
    paths, around, who, profile = view.paths, view.around, view.who, view.profile
    blocked = _blocked(view, i, j)
    some = blocked.inside.any(axis=0)
    i, j = i[some], j[some]
    blocked = _Blocked(**{f.name: getattr(blocked, f.name)[:, some] for f in fields(_Blocked)})
    v, v_other = paths.start_speed[i], np.maximum(around.others.states.speed[who.child[i], j], 0.0)
    meeting = _meetings(blocked, v, v_other, profile)
    obstacle = around.others.obstacle[j]
    yields = _yields(meeting, v, v_other, ~obstacle, j < who.vehicle[i], profile)
    # Who is through before the other one comes need not wait.
    before = (meeting.enter - profile.time_margin) / STEP_S
    before = np.clip(before, 0, paths.arc.shape[1] - 1).astype(np.int64)
    yields &= (meeting.enter == 0) | (paths.arc[i, before] <= meeting.high)
    k = np.flatnonzero(yields)
    speed, in_front = meeting.speed[k], meeting.enter[k] == 0
    braking = np.minimum(around.braking[who.child[i], j], profile.comfort_deceleration)[k]
    braking = np.where(in_front & (speed > 0), braking, 0.0)
    return Holds(
        row=i[k],
        position=meeting.position[k],
        speed=speed,
        deceleration=braking,
        stop_time=np.where(braking > 0, speed / np.maximum(braking, 1e-9), np.inf),
        enter=meeting.enter[k],
        until=meeting.leave[k] + profile.time_margin,
        firm=in_front | (speed == 0) | meeting.stops[k],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Meeting:
    """How P pairs meet; places are of the own centre, m along the plan.

    Attributes:
        enter: (P,) when the other one is in the corridor first, s; 0 for now.
        leave: (P,) when it has left, s; inf where it has not within the time looked ahead.
        position: (P,) where the moving stop line behind the other is now.
        speed: (P,) of that line, m/s; 0 for one that crosses.
        entry: (P,) the place to stop at, for one that is not there yet.
        high: (P,) the place from which the own vehicle is through.
        lead: (P,) how far the own vehicle is ahead of the other when that one gets to the crossing, m.
        stops: (P,) the own vehicle can stop before the entry.
    """

    enter: FloatArray
    leave: FloatArray
    position: FloatArray
    speed: FloatArray
    entry: FloatArray
    high: FloatArray
    lead: FloatArray
    stops: BoolArray


def _meetings(blocked: _Blocked, v: FloatArray, v_other: FloatArray, profile: GuardProfile) -> _Meeting:
    """Where and when pairs meet, whose other one gets into the corridor at least once."""
    inside, pair = blocked.inside, np.arange(len(v))
    enter = inside.argmax(axis=0)
    leave = SAMPLES - inside[::-1].argmax(axis=0)
    distance = np.where(inside, np.abs(blocked.offset), np.inf)
    crossing = (distance <= distance.min(axis=0) + CROSSING_M).argmax(axis=0)
    crossing = np.where(enter == 0, 0, crossing)
    cos = blocked.cos[crossing, pair]
    speed = np.where(cos > SAME_WAY, v_other * cos, 0.0)
    # The line that lies under all places where the other is in the way.
    line = np.where(inside, blocked.low - speed * (SAMPLE_S * np.arange(SAMPLES))[:, None], np.inf)
    position = line.min(axis=0)
    entry = np.where(speed > 0, blocked.low[enter, pair], position)
    # Two who come towards each other share the way between them.
    share = blocked.low[0] * v / np.maximum(v + v_other, 0.1)
    towards = (enter == 0) & (cos < TOWARDS)
    return _Meeting(
        enter=SAMPLE_S * enter,
        leave=np.where(leave == SAMPLES, np.inf, SAMPLE_S * leave),
        position=np.where(towards, np.maximum(position, share), position),
        speed=speed,
        entry=entry,
        high=np.where(inside, blocked.high, -np.inf).max(axis=0),
        lead=v * (SAMPLE_S * crossing) - blocked.s[crossing, pair],
        # One who is slow stops where it is: better beside the other's way than in it. Behind one who goes
        # the same way, to get down to its speed is enough.
        stops=np.maximum(entry, AT_ONCE_M)
        >= np.maximum(v - speed, 0.0) ** 2 / (2 * profile.yield_deceleration),
    )


def _yields(
    meeting: _Meeting,
    v: FloatArray,
    v_other: FloatArray,
    gives_way: BoolArray,
    other_first: BoolArray,
    profile: GuardProfile,
) -> BoolArray:
    """(P,) whether the own vehicle gives way.

    To one who is in the corridor already, unless that one is behind. Else, who alone can still stop gives
    way; where both can, or neither, the one that gets to the crossing later; by number where that is close.

    Args:
        v: (P,) own speed, m/s.
        v_other: (P,) the other one's, m/s.
        gives_way: (P,) False for an other one that never does.
        other_first: (P,) the other one's number is the smaller one.
    """
    faster = np.where(meeting.speed > 0, np.maximum(v_other - v, 0.0), v_other)
    other_stops = gives_way & (meeting.enter >= faster / (2 * profile.yield_deceleration))
    # One of the two goes first unless clearly later, the other one only if clearly earlier still: so that
    # they never both go, though each sees the other's way a little differently.
    margin = profile.order_margin
    later = np.where(other_first, meeting.lead < margin + ORDER_DOUBT_M, meeting.lead < -margin)
    yields = np.where(meeting.stops == other_stops, later, meeting.stops)
    result: BoolArray = np.where(meeting.enter == 0, meeting.lead < 0, yields)
    return result


def _blocked(view: _View, i: IntArray, j: IntArray) -> _Blocked:
    """How the others j cover the corridors of the vehicles i."""
    paths, around, profile = view.paths, view.around, view.profile
    child, vehicle = view.who.child[i], view.who.vehicle[i]
    # Pairs last: what is done with all of them at once is a long row in memory.
    x, y, heading = (np.ascontiguousarray(a[child, j].T) for a in (around.x, around.y, around.heading))
    s, offset, line_cos, line_sin, swing = onto_ways(paths, i, x, y)
    ahead, left = np.cos(heading), np.sin(heading)
    cos, sin = ahead * line_cos + left * line_sin, left * line_cos - ahead * line_sin
    half_length, half_width = around.others.length[j] / 2, around.others.width[j] / 2
    own_length, own_width = view.history.scene.length[vehicle], view.history.scene.width[vehicle]
    extent = np.abs(cos) * half_length + np.abs(sin) * half_width + own_length / 2
    body = np.abs(offset) - np.abs(sin) * half_length - np.abs(cos) * half_width - own_width / 2
    low, high = s - extent, s + extent
    # Beside each other, or face to face: a margin would stop who passes within his lane.
    beside = (low[0] < 0) & (high[0] > 0)
    margin = np.where(beside | (cos < TOWARDS), profile.alongside_margin, profile.margin)
    inside = (body <= margin + swing) & (low <= paths.corner_arc[i, -1])
    return _Blocked(inside=inside, s=s, offset=offset, cos=cos, low=low, high=high)
