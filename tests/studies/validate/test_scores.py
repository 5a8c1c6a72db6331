"""Scores agree with scoringrules and scikit-learn, and with numbers done by hand."""

import numpy as np
import pytest

from scex_sumo.studies.validate.scores import brier, covered, crps, group_bootstrap, reliability

RNG = np.random.default_rng(3)
FORECAST = np.round(RNG.random(200), 1)  # with ties
HAPPENED = RNG.random(200) < FORECAST


def test_brier_score_is_that_of_scikit_learn() -> None:
    metrics = pytest.importorskip("sklearn.metrics")
    assert brier(FORECAST, HAPPENED) == pytest.approx(metrics.brier_score_loss(HAPPENED, FORECAST))


def test_reliability_counts_forecasts_by_bins() -> None:
    diagram = reliability(np.array([0.05, 0.15, 0.12, 1.0]), np.array([False, True, False, True]))
    assert diagram.count.tolist() == [1, 2, 1]
    assert diagram.observed.tolist() == [0.0, 0.5, 1.0]
    assert diagram.forecast == pytest.approx([0.05, 0.135, 1.0])


def test_crps_is_that_of_scoringrules() -> None:
    library = pytest.importorskip("scoringrules")
    for outcome in (-1.0, 0.2, 5.0):
        samples = RNG.normal(size=31)
        expected = library.crps_ensemble(np.array(outcome), samples, estimator="nrg")
        assert crps(samples, outcome) == pytest.approx(float(expected))


def test_central_share_covers_one_of_many_alike_in_just_that_share_of_cases() -> None:
    cases = np.random.default_rng(4).random((20_000, 20))
    share = np.mean([covered(case[1:], case[0]) for case in cases])
    assert share == pytest.approx(0.9, abs=0.006)  # 2.8 sigma


def test_bootstrap_draws_whole_groups() -> None:
    values, groups = np.array([0.0, 0.0, 1.0, 1.0]), np.array([0, 0, 1, 1])
    low, high = group_bootstrap(lambda index: float(values[index].mean()), groups)
    assert (low, high) == (0.0, 1.0)
