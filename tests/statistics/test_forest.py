"""Regression forest: predictions of a step, of a slope, and of samples that trees did not see."""

from __future__ import annotations

import numpy as np

from scex_sumo.statistics.forest import Forest

FEATURES = np.random.default_rng(0).normal(size=(600, 5))
NEW = np.random.default_rng(1).normal(size=(400, 5))


def test_a_step_and_a_slope_between_features_are_found() -> None:
    rng = np.random.default_rng(2)
    step = Forest(FEATURES, (FEATURES[:, 3] > 0.5).astype(float), rng).predict(NEW, fitted=0)
    assert np.mean((step > 0.5) == (NEW[:, 3] > 0.5)) > 0.9
    slope = FEATURES @ [1.0, -1.0, 0.0, 0.0, 1.0]
    found = Forest(FEATURES, np.exp(slope - slope.max()), rng).predict(NEW, fitted=0)
    assert np.corrcoef(np.log(found), NEW @ [1.0, -1.0, 0.0, 0.0, 1.0])[0, 1] > 0.9


def test_trees_that_saw_a_sample_do_not_predict_it() -> None:
    noise = np.random.default_rng(3).random(600)
    forest = Forest(FEATURES, noise, np.random.default_rng(4))
    assert np.corrcoef(forest.predict(FEATURES, fitted=0), noise)[0, 1] > 0.5
    assert abs(np.corrcoef(forest.predict(FEATURES, fitted=600), noise)[0, 1]) < 0.2
    assert (forest.predict(NEW, fitted=0) >= 0).all()


def test_one_sample_is_its_own_prediction() -> None:
    forest = Forest(FEATURES[:1], np.array([0.25]), np.random.default_rng(0))
    assert (forest.predict(NEW, fitted=0) == 0.25).all()
    assert (forest.predict(FEATURES[:1], fitted=1) == 0.25).all()
