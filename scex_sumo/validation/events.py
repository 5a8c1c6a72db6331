"""Events that are forecast: the paper's thresholds, collision, and graded ones on paths that do occur."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.metrics.registry import THRESHOLDS, metric_of, side_of

COLLISION: Final = "collision"


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happens in a child, or in what was recorded, or not.

    Attributes:
        name: for tables.
        column: metric column, or ``collision``.
        threshold: from which value on it has happened; of ``collision`` none.
        paper: one of the four that the paper suggests.
    """

    name: str
    column: str
    threshold: float = 0.5
    paper: bool = False

    def happened(self, value: FloatArray) -> BoolArray:
        """Whether it happened, of values of its column; undefined (NaN) is no event."""
        if self.column == COLLISION:
            return np.asarray(value > 0, dtype=bool)
        with np.errstate(invalid="ignore"):
            beyond = value <= self.threshold if side_of(self.column) == "left" else value >= self.threshold
        return np.asarray(beyond, dtype=bool)


def _paper(column: str, threshold: float) -> Event:
    metric = metric_of(column)
    sign = "≤" if side_of(column) == "left" else "≥"
    return Event(
        name=f"{metric.label or column} {sign} {threshold:.3g}",
        column=column,
        threshold=threshold,
        paper=True,
    )


EVENTS: Final = (
    *(_paper(column, threshold) for column, threshold in THRESHOLDS.items()),
    Event(name="collision", column=COLLISION),
    Event(name="THW < 1 s", column="thw", threshold=1.0),
    Event(name="TTC on path < 4 s", column="ttc_path", threshold=0.25),
    Event(name="PET < 2 s", column="pet", threshold=2.0),
    Event(name="body gap < 1 m", column="gap", threshold=1.0),
)
"""All events, those of the paper first."""
