"""Moments of a recording that can be seed scenes, and their split for training, validation and test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import UsageError
from scex_sumo.converters.registries import Window
from scex_sumo.converters.tracks.rows import STANDING_MPS, TrackTable
from scex_sumo.scene import HISTORY_STEPS, STEP_S

CASE_FRAME = 10
"""Moment of an INTERACTION v1.2 case: one second is observed before it, three are predicted after it."""

FUTURE_S = 3.0
STAMP_MS = 0.6
"""Two stamps closer than this are equal, because stamps are rounded to milliseconds."""

Part: TypeAlias = Literal["train", "validation", "test"]
PARTS: tuple[Part, ...] = ("train", "validation", "test")
ROUNDING_S = 1e-6
TARGET_S = 3.0


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
    if not len(rows):
        return []
    complete = (rows.speed > STANDING_MPS) & recorded_throughout(table)
    chosen = rows.frame_id == CASE_FRAME if table.has_cases else np.full(len(rows), True)
    for limit, sign in zip(window, (1, -1), strict=True):
        if limit is not None:
            chosen &= sign * (rows.timestamp_ms - 1000.0 * limit) > -STAMP_MS
    if not chosen.any():
        return []
    # one number per pair of case and stamp
    stamps, at = np.unique(rows.timestamp_ms[chosen], return_inverse=True)
    keys, number = np.unique(rows.case[chosen] * len(stamps) + at, return_inverse=True)
    vehicles = np.bincount(number)
    good = np.bincount(number, complete[chosen])
    moments: list[Moment] = []
    for key, count, whole in zip(keys, vehicles, good, strict=True):
        time_s = float(stamps[key % len(stamps)]) / 1000.0
        case = table.cases[key // len(stamps)]
        same_case = bool(moments) and moments[-1].case == case
        if same_case and time_s - moments[-1].time_s < every_s - STAMP_MS / 1000.0:
            continue
        moments.append(Moment(case=case, time_s=time_s, vehicles=int(count), complete=int(whole)))
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


@dataclass(frozen=True, kw_only=True)
class Split:
    """Split by time into three continuous parts: training, validation, test.

    Attributes:
        validation: share of the recording's time; ``test`` too.
        history_s: time before its moment that a sample sees.
        future_s: time after its moment that a sample uses: 3 s of target and 2 s of driving in between.
        kept_validation: names of short recordings (`whole_part`) for validation.
        kept_test: names of short recordings for test.
    """

    validation: float = 0.1
    test: float = 0.2
    history_s: float = 1.0
    future_s: float = 5.0
    kept_validation: tuple[str, ...] = ()
    kept_test: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (self.validation >= 0 and self.test >= 0 and self.validation + self.test < 1):
            raise UsageError(
                f"split: validation {self.validation:g} and test {self.test:g} must be shares that leave "
                "something for training"
            )

    def whole_part(self, name: str, span_s: float) -> Part | None:
        """Return the part of a recording that is too short to be cut; None for others."""
        if not self.test or self.test * span_s >= self.history_s + TARGET_S:
            return None
        if name in self.kept_test:
            return "test"
        return "validation" if name in self.kept_validation else "train"

    def part(self, time_s: float, first_s: float, last_s: float) -> Part | None:
        """Return the part of a moment in a recording; None in the gaps between parts."""
        span = last_s - first_s
        validation_s = first_s + (1 - self.validation - self.test) * span
        test_s = first_s + (1 - self.test) * span
        begin, end = time_s - self.history_s + ROUNDING_S, time_s + self.future_s - ROUNDING_S
        if end <= validation_s:
            return "train"
        if begin >= test_s:
            return "test"
        if begin >= validation_s and end <= test_s:
            return "validation"
        return None


def split_moments(moments: Sequence[Moment], split: Split) -> dict[Part, list[Moment]]:
    """Split the moments of one recording into parts.

    Cases are split by order, one left out between two parts, because neighbours may overlap in time.
    """
    parts: dict[Part, list[Moment]] = {part: [] for part in PARTS}
    if not moments:
        return parts
    if moments[0].case:
        count = len(moments)
        validation, test = round((1 - split.validation - split.test) * count), round((1 - split.test) * count)
        parts["train"] = list(moments[: max(0, validation - 1)])
        parts["validation"] = list(moments[validation : max(validation, test - 1)])
        parts["test"] = list(moments[test:])
        return parts
    first_s, last_s = moments[0].time_s, moments[-1].time_s
    for moment in moments:
        part = split.part(moment.time_s, first_s, last_s)
        if part is not None:
            parts[part].append(moment)
    return parts
