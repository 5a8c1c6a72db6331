"""Conflicts of pairs in futures: how hard one has to brake for the other, and how closely they pass."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows, least_of
from scex_sumo.conflicts.braking import (
    MOST_MPS2,
    DrivenPaths,
    Shared,
    both_braking,
    needed_braking,
    recent_acceleration,
    shared_stretches,
    shares_of_contact,
)
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance, separation
from scex_sumo.scene import STEP_S, States

NEAR_M: Final = 35.0
"""Distance of the centres at the moment up to which a pair has a row whatever it does."""
LASTS: Final = 4
"""Intervals of `EVERY` steps for which braking has to be needed: 0.8 s. One that is gone sooner is the
noise of a driver's acceleration: with 0.4 s futures need 2 m/s² twice as often as recordings."""
BEFORE: Final = 2
"""The same for what is needed at the moment itself: it has been needed for 0.4 s."""
FACES_RAD: Final = float(np.deg2rad(150.0))
"""Angle of both headings from which two vehicles face each other: one that brakes alone avoids nothing."""
EVERY: Final = 2
"""Steps between two looks at the needed braking."""
CROSSES_RAD: Final = float(np.deg2rad(30.0))
"""Angle of both headings from which vehicles cross; below it one follows or merges."""
_AT_ONCE = 1 << 9  # pairs


@dataclass(frozen=True, kw_only=True, eq=False)
class Conflicts(Rows):
    """Rows of pairs in futures, (N,) each; vehicles by index, ``one`` below ``two``."""

    future: IntArray  # index into the futures
    one: IntArray
    two: IntArray
    # least constant deceleration of either vehicle that avoids contact, lasting for 0.8 s, m/s²; of both
    # where they face each other; 0 where none is needed, `MOST_MPS2` where none helps
    braking: FloatArray
    braking_step: IntArray  # steps from the moment until it is needed
    brakes_one: BoolArray  # whether it is the first vehicle's
    margin: FloatArray  # time margin of vehicles that cross, s; inf without a common place
    margin_step: IntArray  # steps from the moment until the later one enters
    later_one: BoolArray  # whether that is the first vehicle
    # least distance of the outlines, m, at the steps when the centres are nearest; 0: contact
    gap: FloatArray
    gap_step: IntArray  # steps from the moment until then
    meets_rad: FloatArray  # least angle of both headings where the ways touch, rad; inf where they do not

    def __len__(self) -> int:
        return len(self.future)

    def before(self, left: IntArray) -> Conflicts:
        """Return the rows without what comes after a vehicle has left, by the steps (C, V) until then."""
        last = np.minimum(left[self.future, self.one], left[self.future, self.two])
        return replace(
            self,
            braking=np.where(self.braking_step > last, 0.0, self.braking),
            margin=np.where(self.margin_step > last, np.inf, self.margin),
            gap=np.where(self.gap_step > last, NEAR_M, self.gap),
        )


def find_conflicts(
    states: States,
    length: FloatArray,
    width: FloatArray,
    planned: FloatArray | None = None,
    *,
    now: int,
    people: BoolArray | None = None,
    vehicle: int | None = None,
) -> Conflicts:
    """Find the conflicts of all pairs of vehicles in futures.

    Args:
        states: (C, T, V) as driven, with the last second before the moment.
        length: (V,) m; so ``width``.
        planned: (2, C, V, H) x and y of the centres after the last step, m; None: straight on.
        now: index of the moment in T.
        people: (V,) whether it is a pedestrian or cyclist: two of them have no conflict.
        vehicle: only pairs with this one; None: all.

    Returns:
        Rows by future and pair: of pairs within `NEAR_M` at the moment, and where their ways touch.
    """
    futures, _, vehicles = states.shape
    paths = ways_of(states, np.tile(length, futures), np.tile(width, futures), planned)
    one, two = np.triu_indices(vehicles, 1)
    if people is not None:
        both = people[one] & people[two]
        one, two = one[~both], two[~both]
    if vehicle is not None:
        has_it = (one == vehicle) | (two == vehicle)
        one, two = one[has_it], two[has_it]
    first = vehicles * np.arange(futures)
    own, other = shared_stretches(paths, (first + one[:, None]).ravel(), (first + two[:, None]).ravel())
    apart = np.hypot(*(v[0, now, one] - v[0, now, two] for v in (states.x, states.y)))
    number = np.full((vehicles, vehicles), -1)
    number[one, two] = np.arange(len(one))
    touch = own.own // vehicles * len(one) + number[own.own % vehicles, own.other % vehicles]
    rows = np.tile(apart < NEAR_M, futures)
    rows[touch] = True
    kept = np.flatnonzero(rows)
    future, pair = np.divmod(kept, max(len(one), 1))
    place = np.searchsorted(kept, touch)
    return _filled(paths, (own, other), place, (future, one[pair], two[pair]), vehicles, now)


def ways_of(states: States, length: FloatArray, width: FloatArray, planned: FloatArray | None) -> DrivenPaths:
    """Return the ways of all vehicles (C * V rows) of futures, by states (C, T, V) and sizes (C * V,)."""
    rows = states.map(lambda values: values.swapaxes(1, 2).reshape(len(length), -1))
    return DrivenPaths.of(
        rows, length, width, None if planned is None else planned.reshape(2, len(length), -1)
    )


def _filled(
    paths: DrivenPaths,
    shared: tuple[Shared, Shared],
    place: IntArray,
    rows: tuple[IntArray, IntArray, IntArray],
    vehicles: int,
    now: int,
) -> Conflicts:
    """Return the conflicts of rows: future and both vehicles; ``place`` (n,) is the row of each stretch."""
    future, one, two = rows
    braking, braking_step, brakes_one = needed_by_pairs(paths, *shared, now=now)
    margins = time_margins(paths, shared[0].own, shared[0].other, now=now)
    gap, gap_step = _gaps(paths, future * vehicles + one, future * vehicles + two, now)

    def spread(values: FloatArray | IntArray | BoolArray, empty: float) -> np.ndarray[tuple[int], np.dtype]:
        whole = np.full(len(future), empty, dtype=values.dtype)
        whole[place] = values
        return whole

    return Conflicts(
        future=future,
        one=one,
        two=two,
        braking=spread(braking, 0.0),
        braking_step=spread(braking_step, 0),
        brakes_one=spread(brakes_one, False),
        margin=spread(margins.margin, np.inf),
        margin_step=spread(np.maximum(margins.step - now, 0), 0),
        later_one=spread(margins.own_is_later, False),
        gap=gap,
        gap_step=gap_step,
        meets_rad=spread(shared[0].least_angle(paths), np.inf),
    )


def needed_by_pairs(
    paths: DrivenPaths, own: Shared, other: Shared, *, now: int
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Return (n,) needed braking that lasts, m/s², the steps until then, whether it is the first one's.

    That of the moment itself counts if it has been needed for `BEFORE`.
    """
    steps = np.arange(now - BEFORE * EVERY, paths.states.shape[1], EVERY)
    least, of_first = braking_at(paths, own, other, steps)
    since = least[:, : BEFORE + 1].min(axis=1)
    window = min(LASTS + 1, least.shape[1] - BEFORE)
    lasting = sliding_window_view(least[:, BEFORE:], window, axis=1).min(axis=-1)
    rows, begins = np.arange(len(least)), np.argmax(lasting, axis=1)
    most = lasting[rows, begins]
    begins = np.where(since > most, 0, begins)
    first = of_first[rows, begins + BEFORE] == least[rows, begins + BEFORE]
    return np.maximum(most, since), EVERY * begins, np.asarray(first)


def braking_at(
    paths: DrivenPaths, own: Shared, other: Shared, steps: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n, k) needed braking of pairs at steps (k,), and that of the first vehicle alone, m/s²."""
    acceleration = recent_acceleration(paths.states.speed)
    alone = [needed_braking(paths, side, acceleration, steps) for side in (own, other)]
    least = least_braking(*alone)
    facing = np.minimum(own.least_angle(paths), other.least_angle(paths)) >= FACES_RAD
    both = np.maximum(both_braking(paths, own, steps), both_braking(paths, other, steps))
    return np.where(facing[:, None] & (least > 0), both, least), alone[0]


def least_braking(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the needed braking of pairs by that of either vehicle, m/s².

    Where both could brake, the lesser. `MOST_MPS2` of one alone means that it can do nothing, and the other
    one's counts; 0 of the other one then means that it gets away.
    """
    able = [np.where((side > 0) & (side < MOST_MPS2), side, np.inf) for side in (first, second)]
    least = np.minimum(*able)
    hopeless = (first >= MOST_MPS2) & (second >= MOST_MPS2)
    return np.asarray(np.where(np.isfinite(least), least, np.where(hopeless, MOST_MPS2, 0.0)))


def _gaps(paths: DrivenPaths, first: IntArray, second: IntArray, now: int) -> tuple[FloatArray, IntArray]:
    """Return (n,) distance of the outlines when the centres are nearest, m, and the steps until then."""
    states = paths.states[:, now:]
    apart = np.hypot(states.x[first] - states.x[second], states.y[first] - states.y[second])
    step = np.argmin(apart, axis=1)
    boxes = [
        Rectangles.of(states[side, step], paths.length[side], paths.width[side]) for side in (first, second)
    ]
    return rectangle_distance(*boxes), step


@dataclass(frozen=True, kw_only=True, eq=False)
class Margins(Rows):
    """Least time margins of n pairs of vehicles that cross."""

    margin: FloatArray  # (n,) s; inf where not both reach a common place, or where they do not cross there
    step: IntArray  # (n,) at which the later one enters; 0 where there is no margin
    own_is_later: BoolArray  # (n,) whether that is the first vehicle


def time_margins(paths: DrivenPaths, own: IntArray, other: IntArray, *, now: int) -> Margins:
    """Return the least time margins of pairs of vehicles, by their rows (n,) of driven ways.

    The later vehicle has to enter from step ``now`` on; the earlier one may have left before.
    """
    parts = [
        _of_some(paths, own[start : start + _AT_ONCE], other[start : start + _AT_ONCE], now)
        for start in range(0, max(len(own), 1), _AT_ONCE)
    ]
    return Margins.join(parts)


def _of_some(paths: DrivenPaths, own: IntArray, other: IntArray, now: int) -> Margins:
    states, steps = paths.states, paths.states.shape[1]
    one, two = states[own][:, :, None], states[other][:, None]
    reach = (np.hypot(paths.length, paths.width) / 2)[own] + (np.hypot(paths.length, paths.width) / 2)[other]
    dx, dy = one.x - two.x, one.y - two.y
    near = dx * dx + dy * dy < (reach * reach)[:, None, None]
    step = np.arange(steps)
    near &= np.maximum(step[:, None], step) >= now
    row, first, second = np.nonzero(near)
    crosses = np.cos(states.heading[own[row], first] - states.heading[other[row], second]) <= np.cos(
        CROSSES_RAD
    )
    row, first, second = row[crosses], first[crosses], second[crosses]
    touch = separation(_box(paths, own[row], first), _box(paths, other[row], second)) <= 0
    row, first, second = row[touch], first[touch], second[touch]
    # The fewest steps apart, of these the soonest; where either may be the later one, the smaller margin.
    rank = np.abs(first - second) * steps + np.maximum(first, second)
    least = np.full(len(own), steps * steps)
    np.minimum.at(least, row, rank)
    row, first, second = (values[rank == least[row]] for values in (row, first, second))
    whole = np.abs(first - second)
    margins = STEP_S * np.maximum(whole - _between(paths, own[row], other[row], first, second), 0.0)
    chosen = least_of(row, margins)
    row, first, second = row[chosen], first[chosen], second[chosen]
    margin = np.full(len(own), np.inf)
    later_step, is_own = np.zeros(len(own), dtype=np.int64), np.zeros(len(own), dtype=np.bool_)
    margin[row], later_step[row], is_own[row] = margins[chosen], np.maximum(first, second), first > second
    return Margins(margin=margin, step=later_step, own_is_later=is_own)


def _between(
    paths: DrivenPaths, own: IntArray, other: IntArray, first: IntArray, second: IntArray
) -> FloatArray:
    """Return the steps (n,), with a fraction, by which margins of whole steps are too large.

    The earlier vehicle leaves after its step, the later one has entered before its step.
    """
    towards, last = np.sign(second - first), paths.states.shape[1] - 1
    one, two = _box(paths, own, first), _box(paths, other, second)
    leaves = shares_of_contact(one, _box(paths, own, np.clip(first + towards, 0, last)), two)
    enters = shares_of_contact(two, _box(paths, other, np.clip(second - towards, 0, last)), one)
    return np.where(towards == 0, 0.0, leaves + enters)


def _box(paths: DrivenPaths, path: IntArray, step: IntArray) -> Rectangles:
    return Rectangles.of(paths.states[path, step], paths.length[path], paths.width[path])
