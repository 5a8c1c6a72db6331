"""Probability of a pair's events: none is rarer than a collision, which counts as each."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from scex_sumo.results import probability
from scex_sumo.results.extras import ExactProbability
from scex_sumo.results.probability import Encounter, Probability


def test_an_event_without_a_table_is_not_rarer_than_an_exact_collision(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """17 of 96 futures have a short TTC, among them 17 collisions, of which exactly 18.75 % happen."""

    def known(run: Any, sampled: Any, event: str, pair: Any) -> Probability:
        exact = ExactProbability(value=0.1875, checked="", remainder=0.0)
        return Probability(sampled=sampled, known=exact if event == "collision" else None)

    monkeypatch.setattr(probability, "probability_of", known)
    shares = {
        f"{event}{end}": share
        for event in ("collision", "ttc", "drac")
        for end, share in (("", 0.177), ("_low", 0.11), ("_high", 0.26))
    }
    shares |= {"drac": 0.25, "track_id": 1, "other_id": 2}
    run: Any = SimpleNamespace(futures=96)
    pair = Encounter(row=shares, run=run)
    ttc, drac = pair.probability("ttc").estimate, pair.probability("drac").estimate
    assert (ttc.value, ttc.low, ttc.high, ttc.count) == (0.1875, 0.1875, 0.26, 17)
    assert drac.value == 0.25
    assert pair.collision.sampled.value == 0.177
