"""Moments of a recording that can be seed scenes, and their split for training, validation and test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.converters.registries import Window
from scex_sumo.converters.tracks.rows import STANDING_MPS, TrackTable
from scex_sumo.scene import HISTORY_STEPS, STEP_S

CASE_FRAME = 10
"""Moment of an INTERACTION v1.2 case: one second is observed before it, three are predicted after it."""

FUTURE_S = 3.0
STAMP_MS = 0.6
"""Two stamps closer than this are equal, because stamps are rounded to milliseconds."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One possible seed scene.

    Attributes:
        case: id of the case, or an empty string.
        time_s: in the recording's clock.
        vehicles: number of vehicles at the moment.
        complete: number of those that move and are recorded from 1 s before to 3 s after.
    """

    case: str
    time_s: float
    vehicles: int
    complete: int


def find_moments(
    table: TrackTable, *, every_s: float = STEP_S, window: Window = (None, None)
) -> list[Moment]:
    """List all possible seed scenes in order of time, at least ``every_s`` apart; one for each case.

    Those before or after the window, s, are left out.
    """
    rows = table.vehicles
    complete = (rows.speed > STANDING_MPS) & recorded_throughout(table)
    chosen = rows.frame_id == CASE_FRAME if table.has_cases else np.full(len(rows), True)
    for limit, sign in zip(window, (1, -1), strict=True):
        if limit is not None:
            chosen &= sign * (rows.timestamp_ms - 1000.0 * limit) > -STAMP_MS
    if not chosen.any():
        return []
    # one number per pair of case and stamp
    stamps, stamp_index = np.unique(rows.timestamp_ms[chosen], return_inverse=True)
    keys, moment_number = np.unique(rows.case[chosen] * len(stamps) + stamp_index, return_inverse=True)
    vehicle_counts = np.bincount(moment_number)
    complete_counts = np.bincount(moment_number, complete[chosen])
    moments: list[Moment] = []
    for key, count, complete_count in zip(keys, vehicle_counts, complete_counts, strict=True):
        time_s = float(stamps[key % len(stamps)]) / 1000.0
        case = table.cases[key // len(stamps)]
        same_case = bool(moments) and moments[-1].case == case
        if same_case and time_s - moments[-1].time_s < every_s - STAMP_MS / 1000.0:
            continue
        moments.append(Moment(case=case, time_s=time_s, vehicles=int(count), complete=int(complete_count)))
    return moments


def recorded_throughout(table: TrackTable) -> BoolArray:
    """(N,) rows of vehicles that are recorded from 1 s before to 3 s after."""
    rows = table.vehicles
    back_ms = 1000.0 * STEP_S * (HISTORY_STEPS - 1 if table.has_cases else HISTORY_STEPS)
    first, last = (rows.timestamp_ms[end][rows.piece] for end in rows.pieces)
    return np.asarray(
        (first <= rows.timestamp_ms - back_ms + STAMP_MS)
        & (last >= rows.timestamp_ms + 1000.0 * FUTURE_S - STAMP_MS)
    )


def busiest(moments: list[Moment]) -> Moment:
    """Return the earliest moment with most complete vehicles, then most vehicles."""
    return max(moments, key=lambda moment: (moment.complete, moment.vehicles))
