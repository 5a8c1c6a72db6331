"""What a worker finds in a moment, and whose tracks it sends along."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.studies.rank.futures import choose_kept

PAIRS = [
    np.array([[1, 2, 1, 500, 20_000]]),
    np.array([[1, 2, 0, 0, 0], [1, 3, 0, 0, 0]]),
    np.zeros((0, 5), np.int64),
]


SCORE = np.array([0.1, 0.0, 1.6, 0.1, 1.2])


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
def test_kept_are_those_of_the_greatest_scores(keep: str, spare: int, kept: list[int]) -> None:
    assert np.flatnonzero(choose_kept(SCORE, keep, spare)).tolist() == kept
