"""Random variables of likely drivers as classes: shares of drawn numbers, and their independence."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.behaviors.models.attention import looks_away
from scex_sumo.behaviors.models.likely_draws import AWAY_S, likely_variables, share_away
from scex_sumo.behaviors.models.likely_driver import LikelyProfile

DRAW = np.random.default_rng(0).random(100_000)


@pytest.mark.parametrize("inattention", [0.0, 0.4, 1.0, 2.0])
def test_shares_of_classes_are_those_of_drawn_numbers(inattention: float) -> None:
    found = likely_variables(LikelyProfile(inattention=inattention))
    assert found.prior.sum(axis=1) == pytest.approx(1.0)
    assert (found.prior * found.score).sum(axis=1) == pytest.approx(0.0, abs=1e-9)
    for variable, prior in enumerate(found.prior):
        share = np.bincount(found.classes(DRAW, variable), minlength=len(prior)) / len(DRAW)
        error = np.sqrt(prior * (1 - prior) / len(DRAW))
        assert (np.abs(share - prior) <= 4.5 * error + 1e-6).all(), variable


def test_variables_are_independent_but_for_those_that_exclude_each_other() -> None:
    found = likely_variables(LikelyProfile())
    score = found.scores(DRAW)
    for chosen in found.inattentive:
        free = [k for k in range(len(found.prior)) if k == chosen or k not in found.inattentive]
        together = np.corrcoef(score[:, free].T) - np.eye(len(free))
        assert np.abs(together).max() < 5 / np.sqrt(len(DRAW))


@pytest.mark.parametrize("time_s", [*AWAY_S, 3.8, 4.1])
def test_the_share_of_drivers_that_look_away_follows_from_their_glances(time_s: float) -> None:
    share = looks_away(DRAW, np.full((len(DRAW), 1), time_s)).mean()
    assert share_away(time_s, 1.0) == pytest.approx(share, abs=4.5 * np.sqrt(0.16 / len(DRAW)))
    assert share_away(time_s, 0.0) == 0.0
