"""What a worker finds in a moment, and whose tracks it sends along."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.ranking.run_moment import choose_kept, critical_by


def values(**columns: list[float]) -> np.ndarray:
    count = len(next(iter(columns.values())))
    result = np.full((count, len(COLUMNS)), np.nan)
    for name, column in columns.items():
        result[:, COLUMNS.index(name)] = column
    return result


def test_children_are_critical_on_the_metrics_side_of_the_threshold() -> None:
    found = values(wttc=[0.2, 0.3, 0.26], ttc=[0.5, 0.7, 0.6])
    critical = critical_by(found, ~np.isnan(found), {"wttc": 0.26, "ttc": 0.6})
    assert critical.tolist() == [[True, False], [False, True], [True, True]]


def test_undefined_children_are_not_critical() -> None:
    found = values(wttc=[np.nan, 0.1])
    critical = critical_by(found, ~np.isnan(found), {"wttc": 0.26})
    assert critical.tolist() == [[False], [True]]


CRITICAL = np.array([[1, 0], [0, 0], [1, 1], [0, 1], [1, 1]], dtype=bool)


@pytest.mark.parametrize(
    ("keep", "spare", "kept"),
    [
        ("none", 5, []),
        ("all", 0, [0, 1, 2, 3, 4]),
        ("critical", 5, [0, 2, 3, 4]),
        ("critical", 3, [0, 2, 4]),
        ("critical", 0, []),
    ],
)
def test_kept_are_those_critical_by_most_metrics(keep: str, spare: int, kept: list[int]) -> None:
    assert np.flatnonzero(choose_kept(CRITICAL, keep, spare)).tolist() == kept
