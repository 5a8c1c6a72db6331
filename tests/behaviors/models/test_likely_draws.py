"""Random variables of likely drivers: their scores, and the share of drivers that look away."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.behaviors.models.attention import looks_away
from scex_sumo.behaviors.models.likely_draws import AWAY_S, INATTENTIVE, WORDS, likely_scores, share_away
from scex_sumo.behaviors.models.likely_driver import LikelyProfile

DRAW = np.random.default_rng(0).random(100_000)


@pytest.mark.parametrize("inattention", [0.0, 0.4, 1.0, 2.0])
def test_scores_have_mean_0_and_variance_1(inattention: float) -> None:
    scores = likely_scores(DRAW, LikelyProfile(inattention=inattention))
    assert scores.shape == (len(DRAW), len(WORDS))
    assert np.abs(scores.mean(axis=0)).max() < 4.5 / np.sqrt(len(DRAW))
    varied = np.ones(len(WORDS))
    varied[INATTENTIVE] = inattention > 0
    assert scores.var(axis=0) == pytest.approx(varied, abs=0.04)


@pytest.mark.parametrize("time_s", [*AWAY_S, 3.8, 4.1])
def test_the_share_of_drivers_that_look_away_follows_from_their_glances(time_s: float) -> None:
    share = looks_away(DRAW, np.full((len(DRAW), 1), time_s)).mean()
    assert share_away(time_s, 1.0) == pytest.approx(share, abs=4.5 * np.sqrt(0.16 / len(DRAW)))
    assert share_away(time_s, 0.0) == 0.0
