"""Time margin: the time between one vehicle leaving a place and another one entering it (PET, Allen 1978)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.conflicts.driven import DrivenPaths
from scex_sumo.conflicts.shared import shares_of_contact
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.scene import STEP_S

CROSSES_RAD: Final = float(np.deg2rad(30.0))
"""Angle of both headings from which vehicles cross; below it one follows or merges."""

_AT_ONCE = 1 << 9  # pairs


@dataclass(frozen=True, kw_only=True, eq=False)
class Margins(Rows):
    """Least time margins of n pairs of vehicles that cross.

    Attributes:
        margin: (n,) s; inf where not both reach a common place, or where they do not cross there.
        step: (n,) at which the later one enters; 0 where there is no margin.
        own_is_later: (n,) whether that is the first vehicle.
    """

    margin: FloatArray
    step: IntArray
    own_is_later: BoolArray


def time_margins(ways: DrivenPaths, own: IntArray, other: IntArray, *, now: int) -> Margins:
    """Return the least time margins of pairs of vehicles on driven ways.

    Args:
        own: (n,) row of the first vehicle; ``other`` (n,) of the second.
        now: step from which on the later vehicle has to enter; the earlier one may have left before.
    """
    parts = [
        _of_some(ways, own[start : start + _AT_ONCE], other[start : start + _AT_ONCE], now)
        for start in range(0, max(len(own), 1), _AT_ONCE)
    ]
    return Margins.join(parts)


def _of_some(ways: DrivenPaths, own: IntArray, other: IntArray, now: int) -> Margins:
    states, steps = ways.states, ways.states.shape[1]
    one, two = states[own][:, :, None], states[other][:, None]
    reach = (np.hypot(ways.length, ways.width) / 2)[own] + (np.hypot(ways.length, ways.width) / 2)[other]
    dx, dy = one.x - two.x, one.y - two.y
    near = dx * dx + dy * dy < (reach * reach)[:, None, None]
    step = np.arange(steps)
    near &= np.maximum(step[:, None], step) >= now
    row, first, second = np.nonzero(near)
    crosses = np.cos(states.heading[own[row], first] - states.heading[other[row], second]) <= np.cos(
        CROSSES_RAD
    )
    row, first, second = row[crosses], first[crosses], second[crosses]
    touch = separation(_box(ways, own[row], first), _box(ways, other[row], second)) <= 0
    row, first, second = row[touch], first[touch], second[touch]
    margin = np.full(len(own), np.inf)
    order = np.lexsort((np.maximum(first, second), np.abs(first - second), row))
    rows, begins = np.unique(row[order], return_index=True)
    a, b = first[order][begins], second[order][begins]
    margin[rows] = STEP_S * np.maximum(np.abs(a - b) - _between(ways, own[rows], other[rows], a, b), 0.0)
    later, is_own = np.zeros(len(own), dtype=np.int64), np.zeros(len(own), dtype=np.bool_)
    later[rows], is_own[rows] = np.maximum(a, b), a > b
    return Margins(margin=margin, step=later, own_is_later=is_own)


def _between(
    ways: DrivenPaths, own: IntArray, other: IntArray, first: IntArray, second: IntArray
) -> FloatArray:
    """Return the steps (n,), with a fraction, by which margins of whole steps are too large.

    The earlier vehicle leaves after its step, the later one has entered before its step.
    """
    towards, last = np.sign(second - first), ways.states.shape[1] - 1
    one, two = _box(ways, own, first), _box(ways, other, second)
    leaves = shares_of_contact(one, _box(ways, own, np.clip(first + towards, 0, last)), two)
    enters = shares_of_contact(two, _box(ways, other, np.clip(second - towards, 0, last)), one)
    return np.where(towards == 0, 0.0, leaves + enters)


def _box(ways: DrivenPaths, row: IntArray, step: IntArray) -> Rectangles:
    return Rectangles.of(ways.states[row, step], ways.length[row], ways.width[row])
