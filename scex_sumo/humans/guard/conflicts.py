"""Conflicts: leaders in a corridor, and crossings that another vehicle reaches first."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows, between
from scex_sumo.behaviors.driving.leaders import Everyone, half_extents
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.humans.guard.corridors import SAMPLE_S, SAMPLES, PlannedWays, expected
from scex_sumo.humans.guard.side_clearance import box_distances
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, States, VehicleIndex

MAX_PAIRS = 1024  # at a time: bounds the memory, and fits the processor's cache
SAME_WAY = 0.5  # cosine above which one vehicle follows the other instead of waiting for it
TOWARDS = -0.5  # cosine below which two vehicles approach each other head-on
ORDER_DOUBT_M = 0.5
AT_ONCE_M = 0.5
SAFE_S, SAFE_STOP_S, SAFE_STEP_S = 1.5, 3.0, 0.25  # of others that go the same way, and of all others
SAFE_M = 0.3  # margin between two boxes
KEPT_SHARE = 0.8  # of a smaller present margin
CONTACT_M = 0.1
MIN_WAY_M = 0.5
CROSSING_M = 0.5  # the crossing is where the offset is this near to the smallest one


@dataclass(frozen=True, kw_only=True, eq=False)
class StopLines(Rows):
    """P moving stop lines of centres, sorted by row: position + speed·t - deceleration·t²/2."""

    row: IntArray  # (P,) the vehicle
    position: FloatArray  # (P,) m along its plan
    speed: FloatArray  # (P,) m/s, at least 0
    deceleration: FloatArray  # (P,) m/s², at least 0
    enter: FloatArray  # (P,) when the other enters the corridor, s; 0: is inside
    until: FloatArray  # (P,) when the line ends, s
    firm: BoolArray  # (P,) hard braking is allowed
    safe: BoolArray  # (P,) both stay apart for a while with constant velocity and heading

    @cached_property
    def stop_time(self) -> FloatArray:
        """(P,) when the line stands, s; inf: never."""
        braked = self.speed / np.maximum(self.deceleration, 1e-9)
        return np.where(self.deceleration > 0, braked, np.inf)

    def joined_by(self, rows: IntArray) -> StopLines:
        """Add lines without effect for further vehicles."""
        further = np.setdiff1d(rows, self.row)
        idle = {f.name: np.zeros(len(further), getattr(self, f.name).dtype) for f in fields(self)}
        lines = StopLines.join([self, StopLines(**{**idle, "row": further})])
        return lines.take(np.argsort(lines.row, kind="stable"))


class _View(NamedTuple):
    """Arguments of the search for stop lines of n vehicles."""

    paths: PlannedWays
    others: Everyone
    motion: States  # (C, M, K) expected of the others
    braking: FloatArray  # (C, M) of the others at present, m/s²
    history: SceneHistory
    vehicles: VehicleIndex
    human: HumanParameters


def find_stop_lines(
    paths: PlannedWays, history: SceneHistory, road: Road, vehicles: VehicleIndex, human: HumanParameters
) -> StopLines:
    """Find all stop lines of vehicles with planned ways, also where planned and expected boxes touch."""
    view = _View(paths, *expected(history, road), history, vehicles, human)
    i, j = _near_pairs(view)
    begins = range(0, max(1, len(i)), MAX_PAIRS)
    parts = [_stop_lines_of(view, i[k : k + MAX_PAIRS], j[k : k + MAX_PAIRS]) for k in begins]
    return StopLines.join([*parts, _contacts(view, i, j)])


def _contacts(view: _View, i: IntArray, j: IntArray) -> StopLines:
    """Return the places where pairs apart first touch, if the other is ahead then."""
    paths, others, scene, steps = view.paths, view.others, view.history.scene, round(SAMPLE_S / STEP_S)
    samples = int(view.human.contact_s / SAMPLE_S) + 1
    future, vehicle = view.vehicles.future[i], view.vehicles.vehicle[i]
    sizes = (scene.length[vehicle], scene.width[vehicle]), (others.length[j], others.width[j])
    reach = sum(np.hypot(*size) for size in sizes) / 2
    own = slice(0, samples * steps, steps)
    dx = view.motion.x[future, j, :samples] - paths.states.x[i, own]
    dy = view.motion.y[future, j, :samples] - paths.states.y[i, own]
    speed = paths.states.speed[i, 0] + np.maximum(others.states.speed[future, j], 0.0)
    near = np.flatnonzero((np.hypot(dx, dy) < (reach + speed * SAMPLE_S / 2)[:, None]).any(axis=1))
    i, j, future = i[near], j[near], future[near]
    own_size, size = ((length[near, None], width[near, None]) for length, width in sizes)
    time = np.arange((samples - 1) * steps + 1)
    one = paths.states[i][:, time]
    other = view.motion[future, j, :samples].map(lambda values: between(values, time / steps))
    boxes = Rectangles.of(one, *own_size), Rectangles.of(other, *size)
    distance = rectangle_distance(*boxes)
    touches = distance <= np.minimum(CONTACT_M, distance[:, :1] / 2)
    touches[:, 0] = False
    first, k = touches.argmax(axis=1), np.arange(len(i))
    ahead = one[k, first].ahead_and_left(other.x[k, first], other.y[k, first])[0] > 0
    k = np.flatnonzero(touches.any(axis=1) & ahead & (distance[:, 0] > 0))
    first, i, j, future = first[k], i[k], j[k], future[k]
    along = np.cos(other.heading[k, first] - one.heading[k, first])
    # One that crosses in front stays at the place until it has passed; one ahead leaves it at once.
    time = np.arange((SAMPLES - 1) * steps + 1)
    motion = view.motion[future, j].map(lambda values: between(values, time / steps))
    here = Rectangles.of(one[k, first][:, None], *(a[k] for a in own_size))
    held = rectangle_distance(here, Rectangles.of(motion, *(a[k] for a in size))) <= CONTACT_M
    gone = ~held & (time > first[:, None])
    leave = np.where(gone.any(axis=1), gone.argmax(axis=1), np.inf)
    follows = leave <= first + steps
    line = np.where(follows, np.maximum(others.states.speed[future, j] * along, 0.0), 0.0)
    braking = np.where(line > 0, np.minimum(view.braking[future, j], view.human.leader_braking_mps2), 0.0)
    return StopLines(
        row=i,
        position=paths.arc[i, first] - line * STEP_S * first,
        speed=line,
        deceleration=braking,
        enter=np.where(follows, 0.0, STEP_S * first),
        until=np.where(follows, np.inf, STEP_S * leave + view.human.conflict_margin_s),
        firm=np.ones(len(k), dtype=np.bool_),
        safe=np.zeros(len(k), dtype=np.bool_),
    )


def _near_pairs(view: _View) -> tuple[IntArray, IntArray]:
    """Return pairs whose motions have overlapping bounds."""
    paths, others, scene, vehicles = view.paths, view.others, view.history.scene, view.vehicles
    half = np.sqrt(scene.length**2 + scene.width**2)[vehicles.vehicle] / 2 + view.human.conflict_margin_m
    reach = half[:, None] + np.sqrt(others.length**2 + others.width**2) / 2
    near = others.present[vehicles.future] & (paths.arc[:, -1] > 0.0)[:, None]
    for planned, other in ((paths.middle.x, view.motion.x), (paths.middle.y, view.motion.y)):
        low, high = other.min(axis=2)[vehicles.future], other.max(axis=2)[vehicles.future]
        near &= low - reach <= planned.max(axis=1)[:, None]
        near &= high + reach >= planned.min(axis=1)[:, None]
    near[np.arange(len(vehicles)), vehicles.vehicle] = False
    near[:, : scene.vehicles] &= (box_distances(scene) >= view.human.touching_m)[vehicles.vehicle]
    i, j = np.nonzero(near)
    return i, j


class _Blocked(NamedTuple):
    """Others in corridors at K moments, (K, P)."""

    inside: BoolArray
    s: FloatArray  # arc length of the other's centre, m
    offset: FloatArray  # from the middle line, m, left positive
    cos: FloatArray  # of its heading against the corridor's
    low: FloatArray  # place of the vehicle's centre where its front touches the other, m
    high: FloatArray  # place where its rear leaves the other, m


def _stop_lines_of(view: _View, i: IntArray, j: IntArray) -> StopLines:
    """Return the stop lines of pairs: vehicle i of the n, other j of the M."""
    paths, others, vehicles, human = view.paths, view.others, view.vehicles, view.human
    i, j, blocked = _blocked(view, i, j)
    v, v_other = paths.states.speed[i, 0], np.maximum(others.states.speed[vehicles.future[i], j], 0.0)
    meeting = _meetings(blocked, v, v_other, human)
    yields = _yields(meeting, v, v_other, ~others.obstacle[j], j < vehicles.vehicle[i], human)
    # A vehicle that is through before the other one comes need not wait.
    before = (meeting.enter - human.conflict_margin_s) / STEP_S
    before = np.clip(before, 0, paths.arc.shape[1] - 1).astype(np.int64)
    yields &= (meeting.enter == 0) | (paths.arc[i, before] <= meeting.high)
    k = np.flatnonzero(yields)
    speed, in_front = meeting.speed[k], meeting.enter[k] == 0
    braking = np.minimum(view.braking[vehicles.future[i], j], human.leader_braking_mps2)[k]
    braking = np.where(in_front & (speed > 0), braking, 0.0)
    return StopLines(
        row=i[k],
        position=meeting.position[k],
        speed=speed,
        deceleration=braking,
        enter=meeting.enter[k],
        until=meeting.leave[k] + human.conflict_margin_s,
        firm=in_front | (speed == 0) | meeting.stops[k],
        safe=_stay_apart(view, i[k], j[k], np.where(speed > 0, SAFE_S, SAFE_STOP_S)),
    )


def _stay_apart(view: _View, i: IntArray, j: IntArray, time_s: FloatArray) -> BoolArray:
    """Return (P,) whether pairs stay apart for (P,) s with constant headings, own speed and other's braking.

    A small present margin may shrink a little.
    """
    others, vehicles, scene = view.others, view.vehicles, view.history.scene
    future, vehicle = vehicles.future[i], vehicles.vehicle[i]
    own, other = view.history.now[future, vehicle], others.states[future, j]
    braking = view.braking[future, j]
    t = np.arange(0.0, SAFE_STOP_S + 1e-9, SAFE_STEP_S)
    braked = np.minimum(t, (np.maximum(other.speed, 0.0) / np.maximum(braking, 1e-9))[:, None])
    travelled = (
        np.maximum(own.speed, 0.0)[:, None] * t,
        np.maximum(other.speed, 0.0)[:, None] * braked - braking[:, None] / 2 * braked**2,
    )
    sizes = (scene.length[vehicle], scene.width[vehicle]), (others.length[j], others.width[j])
    boxes = [
        Rectangles.of(now.ahead(travelled_m, travelled_m), length[:, None], width[:, None])
        for now, travelled_m, (length, width) in zip((own, other), travelled, sizes, strict=True)
    ]
    distance = np.where(t <= time_s[:, None], rectangle_distance(*boxes), np.inf)
    least = np.minimum(SAFE_M, KEPT_SHARE * distance[:, 0])
    return np.asarray((distance.min(axis=1) >= least) & (distance[:, 0] > 0))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Meeting:
    """Meetings of P pairs, (P,); places of the vehicle's centre, m along the plan."""

    enter: FloatArray  # when the other enters the corridor, s
    leave: FloatArray  # when it has left, s; inf after the last sample
    position: FloatArray  # of the moving stop line now
    speed: FloatArray  # of that line, m/s; 0 if the other crosses
    entry: FloatArray  # place to stop at before the other enters
    high: FloatArray  # place from which the vehicle is through
    lead: FloatArray  # way ahead of the other at the crossing, m
    stops: BoolArray  # the vehicle can stop before the entry


def _meetings(blocked: _Blocked, v: FloatArray, v_other: FloatArray, human: HumanParameters) -> _Meeting:
    """Find where and when pairs meet."""
    inside, pair = blocked.inside, np.arange(len(v))
    enter = inside.argmax(axis=0)
    leave = SAMPLES - inside[::-1].argmax(axis=0)
    distance = np.where(inside, np.abs(blocked.offset), np.inf)
    crossing = (distance <= distance.min(axis=0) + CROSSING_M).argmax(axis=0)
    crossing = np.where(enter == 0, 0, crossing)
    cos = blocked.cos[crossing, pair]
    speed = np.where(cos > SAME_WAY, v_other * cos, 0.0)
    # The line below all places where the other is in the way.
    line = np.where(inside, blocked.low - speed * (SAMPLE_S * np.arange(SAMPLES))[:, None], np.inf)
    position = line.min(axis=0)
    entry = np.where(speed > 0, blocked.low[enter, pair], position)
    return _Meeting(
        enter=SAMPLE_S * enter,
        leave=np.where(leave == SAMPLES, np.inf, SAMPLE_S * leave),
        position=position,
        speed=speed,
        entry=entry,
        high=np.where(inside, blocked.high, -np.inf).max(axis=0),
        lead=v * (SAMPLE_S * crossing) - blocked.s[crossing, pair],
        # Behind one that goes the same way, it is enough to reach its speed.
        stops=np.maximum(entry, AT_ONCE_M) >= np.maximum(v - speed, 0.0) ** 2 / (2 * human.yielding_mps2),
    )


def _yields(
    meeting: _Meeting,
    v: FloatArray,
    v_other: FloatArray,
    gives_way: BoolArray,
    other_first: BoolArray,
    human: HumanParameters,
) -> BoolArray:
    """Return (P,) whether the vehicle gives way.

    ``gives_way``: (P,) whether the other one ever does; ``other_first``: whether its number is smaller.

    It does to one inside the corridor and not behind. Else the only one that can stop gives way; if both or
    neither can, the one that needs less braking, behind one that goes the same way the later one; close cases
    go by number.
    """
    faster = np.where(meeting.speed > 0, np.maximum(v_other - v, 0.0), v_other)
    other_stops = gives_way & (meeting.enter >= faster / (2 * human.yielding_mps2))
    # So they never both go, although each sees the other's way a little differently.
    margin = human.order_margin_m
    is_later = np.where(other_first, meeting.lead < margin + ORDER_DOUBT_M, meeting.lead < -margin)
    needs = v**2 / np.maximum(meeting.entry, MIN_WAY_M) / 2
    other_needs = v_other / np.maximum(meeting.enter, STEP_S) / 2
    less = needs < other_needs + np.where(other_first, 1, -1) * human.order_margin_mps2
    is_later = np.where((meeting.speed == 0) & gives_way, less, is_later)
    yields = np.where(meeting.stops == other_stops, is_later, meeting.stops)
    return np.asarray(np.where(meeting.enter == 0, meeting.lead < 0, yields))


def _blocked(view: _View, i: IntArray, j: IntArray) -> tuple[IntArray, IntArray, _Blocked]:
    """Project the others j onto the corridors of the vehicles i; return the pairs that ever meet, and how."""
    paths, others, human = view.paths, view.others, view.human
    future, vehicle = view.vehicles.future[i], view.vehicles.vehicle[i]
    # Pairs are the last axis, so that operations run along memory.
    motion = view.motion[future, j].map(lambda values: np.ascontiguousarray(values.T))
    s, offset, line_cos, line_sin = paths.middle.project(i, motion.x, motion.y)
    ahead, left = np.cos(motion.heading), np.sin(motion.heading)
    cos, sin = ahead * line_cos + left * line_sin, left * line_cos - ahead * line_sin
    along, across = half_extents(cos, sin, others.length[j], others.width[j])
    reach = along + view.history.scene.length[vehicle] / 2
    body = np.abs(offset) - across - view.history.scene.width[vehicle] / 2
    low, high = s - reach, s + reach
    # Alongside or head-on, the full margin would stop vehicles that pass within their lanes.
    beside = (low[0] < 0) & (high[0] > 0)
    margin = np.where(beside | (cos < TOWARDS), human.alongside_margin_m, human.conflict_margin_m)
    inside = (body <= margin) & (low <= paths.middle.arc[i, -1])
    k = np.flatnonzero(inside.any(axis=0))
    some = _Blocked(inside[:, k], s[:, k], offset[:, k], cos[:, k], low[:, k], high[:, k])
    return i[k], j[k], some
