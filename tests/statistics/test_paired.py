"""Paired tests: against scipy, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from scex_sumo.statistics.paired import holm, mcnemar, signed_rank


def test_the_signed_rank_test_is_scipys_with_ties_and_zeros() -> None:
    rng = np.random.default_rng(0)
    one = rng.integers(0, 6, 60).astype(float)
    two = one + rng.integers(-2, 4, 60)
    expected = stats.wilcoxon(one, two, zero_method="pratt", correction=False, method="approx").pvalue
    assert signed_rank(one, two) == pytest.approx(expected, rel=1e-9)


def test_mcnemar_is_the_binomial_test_of_the_futures_that_changed() -> None:
    assert mcnemar(1, 9) == pytest.approx(stats.binomtest(1, 10).pvalue)
    assert mcnemar(4, 4) == 1.0
    assert mcnemar(0, 0) == 1.0


def test_holm_multiplies_the_smallest_most_and_keeps_the_order() -> None:
    assert holm([0.01, 0.04, float("nan"), 0.03])[:2] == pytest.approx([0.03, 0.06])
    assert holm([0.01, 0.04, float("nan"), 0.03])[3] == pytest.approx(0.06)
    assert np.isnan(holm([float("nan")])[0])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
