"""Time margin: the time between one vehicle leaving a place and another one entering it (PET, Allen 1978)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.conflicts.shared import Shared
from scex_sumo.conflicts.ways import APART_M, NODES, Ways
from scex_sumo.scene import STEP_S

CROSSES_RAD: Final = float(np.deg2rad(30.0))
"""Angle of both headings from which vehicles cross; below it one follows or merges."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Margins:
    """Least time margins of n pairs of vehicles that cross.

    Attributes:
        margin: (n,) s; inf where not both reach a common place, or where they do not cross there.
        step: (n,) at which the later one enters; 0 where there is no margin.
        own_is_later: (n,) whether that is the vehicle whose way the stretch is of.
    """

    margin: FloatArray
    step: IntArray
    own_is_later: BoolArray


def time_margins(ways: Ways, shared: Shared, *, now: int) -> Margins:
    """Return the least time margins on driven ways.

    Args:
        now: step from which on the later vehicle has to enter; the earlier one may have left before.
    """
    steps, each = np.arange(ways.states.shape[1]), np.arange(len(shared.own))
    node = np.rint(np.clip(ways.arc / ways.spacing[:, None], 0, NODES - 1)).astype(np.int64)[shared.other]
    enter, leave = shared.enter[each[:, None], node], shared.leave[each[:, None], node]
    begins, ends = _time_at(ways, shared.own, enter), _time_at(ways, shared.own, leave)
    place = np.nan_to_num(np.rint(enter / ways.spacing[shared.own][:, None])).astype(np.int64)
    turn = (
        ways.states.heading[shared.other]
        - ways.nodes.heading[shared.own[:, None], np.minimum(place, NODES - 1)]
    )
    with np.errstate(invalid="ignore"):
        margin = np.maximum(np.maximum(begins - steps, steps - ends), 0.0)
        later = np.maximum(begins, steps)
    counts = np.isfinite(begins) & (later >= now) & (np.cos(turn) <= np.cos(CROSSES_RAD))
    margin = np.where(counts, margin, np.inf)
    best = np.argmin(margin, axis=1)
    least = STEP_S * margin[each, best]
    step = np.where(np.isfinite(least), later[each, best], 0)
    return Margins(margin=least, step=step.astype(np.int64), own_is_later=begins[each, best] > steps[best])


def _time_at(ways: Ways, own: IntArray, arc: FloatArray) -> FloatArray:
    """Return the step (n, T), with a fraction, at which vehicles are first at arc lengths; inf: never."""
    steps = ways.states.shape[1]
    first = steps * np.arange(len(own))[:, None]
    rows = APART_M * np.arange(len(own))[:, None]
    line = ways.arc[own]
    asked = np.maximum(np.nan_to_num(arc), 0.0)
    after = np.searchsorted((line + rows).ravel(), asked + rows) - first
    inside = np.clip(after, 1, steps - 1)
    each = np.arange(len(own))[:, None]
    before, behind = line[each, inside - 1], line[each, inside]
    share = np.clip((asked - before) / np.maximum(behind - before, 1e-9), 0.0, 1.0)
    time = np.where(after == 0, 0.0, inside - 1 + share)
    return np.asarray(np.where(np.isnan(arc) | (after >= steps), np.inf, time))
