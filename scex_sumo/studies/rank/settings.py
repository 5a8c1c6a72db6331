"""Ranking settings: the values that identify a ranking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.converters.datasets.recordings import Recording
from scex_sumo.results.design import design_intervals
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.studies.moments.settings import StudySettings, built

KEEP = ("none", "critical", "all")
MIXED = "mixed"
BY = (MIXED, "severity", "collisions", "encounters")
"""Orders of moments, see `score_of`."""


@dataclass(frozen=True, kw_only=True)
class RankSettings(StudySettings):
    """Settings of a ranking; ``run.children`` is the maximum of a moment.

    Attributes:
        first: children of every moment.
        top: moments on the page; more children settle their ranks.
        keep: whose tracks are kept: ``none``, ``critical`` (at most 5 of a moment) or ``all``.
        by: order of the moments: ``mixed``, ``severity``, ``collisions`` or ``encounters``.
    """

    first: int = 32
    top: int = 10
    keep: str = "none"
    by: str = MIXED

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_positive("first")
        self.check_positive("top")
        if self.keep not in KEEP:
            raise UsageError(f"--keep: got {self.keep!r}; known: {', '.join(KEEP)}")
        if self.by not in BY:
            raise UsageError(f"--by: got {self.by!r}; known: {', '.join(BY)}")
        object.__setattr__(self, "first", min(self.first, self.children))

    def to_json(self, recordings: Sequence[Recording]) -> dict[str, Any]:
        """Return the values that identify the ranking of some recordings."""
        by = {} if self.by == MIXED else {"by": self.by}
        return self.identity(recordings, first=self.first, top=self.top, keep=self.keep) | by

    def intervals(self, models: Sequence[Sequence[str]]) -> DesignIntervals:
        """Return the intervals of children with (C, V) models."""
        drawn = built(self.models).drawn
        index = {str(spec): number for number, spec in enumerate(drawn)}
        levels = np.array([[index[name] for name in row] for row in models], dtype=np.int64)
        fixed = np.zeros(levels.shape[1], dtype=np.bool_)
        return design_intervals(levels, [spec.weight for spec in drawn], fixed, self.run.design)
