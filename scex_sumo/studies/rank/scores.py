"""Settings of a ranking, and the scores of moments by their futures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.converters.registries import Recording
from scex_sumo.results.design import design_intervals
from scex_sumo.results.parts import Part
from scex_sumo.results.tables.encounters import answers_of
from scex_sumo.results.tables.outcomes import encounters_of_rows, first_contacts
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.studies.moments.run import StudySettings, built

KEEP = ("none", "critical", "all")


@dataclass(frozen=True, kw_only=True)
class RankSettings(StudySettings):
    """Settings of a ranking; ``run.futures`` is the maximum of a moment.

    Attributes:
        first: futures of every moment; 0 runs all futures of the moments of the top encounters alone.
        top: encounters and moments at the top; with ``first``, more futures settle the ranks of moments.
        keep: whose tracks are kept: ``none``, ``critical`` (at most 5 of a moment) or ``all``.
        exact: search exact tables, see `scex_sumo.studies.rank.exact`.
    """

    first: int = 0
    top: int = 10
    keep: str = "none"
    exact: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_positive("top")
        if self.first < 0:
            raise UsageError(f"--first: got {self.first}, needs at least 0")
        if self.keep not in KEEP:
            raise UsageError(f"--keep: got {self.keep!r}; known: {', '.join(KEEP)}")
        object.__setattr__(self, "first", min(self.first, self.futures))

    def to_json(self, recordings: Sequence[Recording]) -> dict[str, Any]:
        """Return the values that identify the ranking of some recordings."""
        other = {} if self.exact else {"exact": False}
        return self.identity(recordings, first=self.first, top=self.top, keep=self.keep) | other

    def intervals(self, models: Sequence[Sequence[str]]) -> DesignIntervals:
        """Return the intervals of futures with (C, V) models."""
        drawn = built(self.models).drawn
        index = {str(spec): number for number, spec in enumerate(drawn)}
        levels = np.array([[index[name] for name in row] for row in models], dtype=np.int64)
        fixed = np.zeros(levels.shape[1], dtype=np.bool_)
        return design_intervals(levels, [spec.weight for spec in drawn], fixed, self.run.design)


CRITICAL_WEIGHT = 0.1
"""Of a critical encounter beside a collision in the score of a moment."""
MICRO = 10**6
PAIR_NUMBERS = 5  # of a critical encounter
HARD_MPS = 10.0
"""Relative speed at impact that makes a collision count twice."""


def score_of(pairs: Sequence[IntArray]) -> FloatArray:
    """Return the scores (C,) of futures from their critical encounters.

    A collision counts 1 and its relative speed over 10 m/s; each critical encounter counts 0.1.
    """
    scores = [worth_of(rows).sum() + len(rows) * CRITICAL_WEIGHT for rows in pairs]
    return np.array(scores, dtype=np.float64)


def worth_of(rows: IntArray) -> FloatArray:
    """Return what the collisions (E,) of critical encounters (E, 5) add to a score."""
    return np.asarray(rows[:, 2] * (1 + rows[:, 3] / (100 * HARD_MPS)), dtype=np.float64)


def critical_pairs(part: Part, track_ids: IntArray) -> list[IntArray]:
    """Return the critical encounters (E, 5) of each future of a part, see `pairs_of`."""
    assert part.encounters is not None and part.collisions is not None
    injured = {
        (hit["future"], frozenset((hit["track_id"], hit["other_id"]))): round(
            MICRO * ((hit["p_mais3"] or 0.0) + (hit["p_mais3_other"] or 0.0))
        )
        for hit in first_contacts(part.collisions).to_pylist()
    }
    encounters = encounters_of_rows(part.encounters)
    answers = answers_of(encounters)
    some = np.flatnonzero(answers["critical"])
    speed = np.round(100 * encounters.relative_speed[some])
    hits = answers["collision"][some]
    future, one, other = (
        encounters.future[some],
        track_ids[encounters.first[some]],
        track_ids[encounters.second[some]],
    )
    pairs = zip(future.tolist(), one.tolist(), other.tolist(), strict=True)
    injuries = np.array([injured.get((c, frozenset((a, b))), 0) for c, a, b in pairs], dtype=np.int64)
    rows = np.stack([one, other, hits, speed, injuries], axis=-1)
    return [rows[future == number].astype(np.int64) for number in part.futures]


def pairs_of(table: pa.Table) -> list[IntArray]:
    """Return the critical encounters (E, 5) of each future.

    Rows are track_id, other_id, 1 in a collision, the relative speed at impact in cm/s, and the expected
    severe injuries in millionths.
    """
    return [
        np.asarray(row, dtype=np.int64).reshape(-1, PAIR_NUMBERS)
        for row in table["critical_pairs"].to_pylist()
    ]
