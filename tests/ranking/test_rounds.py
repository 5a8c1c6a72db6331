"""How many children a seed gets."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.ranking.rounds import Tally, distinct, nearby, round_ends, undecided
from scex_sumo.ranking.seeds import SeedRef


def ref(time_s: float, *, recording: str = "r", case: str = "") -> SeedRef:
    name = f"{recording}_{case}_{time_s}"
    return SeedRef(seed=name, location="l", recording=recording, case=case, time_s=time_s, vehicles=5)


def tallies(refs: list[SeedRef], critical: list[int], children: int = 32) -> dict[str, list[Tally]]:
    return {
        r.seed: [Tally(children=children, critical=np.array([k]))]
        for r, k in zip(refs, critical, strict=True)
    }


@pytest.mark.parametrize(
    ("children", "first", "ends"),
    [
        (96, 32, [32, 64, 96]),
        (385, 32, [32, 64, 128, 256, 385]),
        (32, 32, [32]),
        (10, 32, [10]),
        (64, 32, [32, 64]),
    ],
)
def test_rounds_double_up_to_the_most_children(children: int, first: int, ends: list[int]) -> None:
    assert round_ends(children, first) == ends


REFS = [ref(10.0 * i) for i in range(4)]


def test_seeds_that_may_trade_places_at_the_top_go_on() -> None:
    found = undecided(REFS, tallies(REFS, [31, 16, 15, 0]), 1, top=2, seed=0)
    assert found == [REFS[1], REFS[2]]


def test_what_is_certain_gets_no_more_children() -> None:
    assert undecided(REFS, tallies(REFS, [960, 600, 300, 10], 960), 1, top=2, seed=0) == []


def test_what_cannot_reach_the_page_gets_no_more_children() -> None:
    """The last two trade places, but not with the first two, and only those are shown."""
    found = undecided(REFS, tallies(REFS, [950, 600, 16, 15], 960), 1, top=2, seed=0)
    assert found == []


def test_only_seeds_of_the_round_before_go_on() -> None:
    known = tallies(REFS, [31, 16, 15, 0])
    known[REFS[1].seed].append(Tally(children=32, critical=np.array([16])))
    found = undecided(REFS, known, 2, top=2, seed=0)
    assert REFS[2] not in found


def test_a_round_is_decided_from_the_rounds_before_it_alone() -> None:
    """What later rounds have found, as after an interruption, changes nothing."""
    known = tallies(REFS, [31, 16, 15, 0])
    before = undecided(REFS, known, 1, top=2, seed=0)
    known[REFS[3].seed].append(Tally(children=32, critical=np.array([32])))
    assert undecided(REFS, known, 1, top=2, seed=0) == before


def test_seeds_without_results_are_left_out() -> None:
    known = tallies(REFS, [31, 16, 15, 0])
    del known[REFS[0].seed]
    assert REFS[0] not in undecided(REFS, known, 1, top=4, seed=0)
    assert undecided(REFS, {}, 1, top=4, seed=0) == []


def test_moments_of_the_same_seconds_are_one_situation() -> None:
    assert nearby(ref(10.0), ref(12.9))
    assert not nearby(ref(10.0), ref(13.0))
    assert not nearby(ref(10.0), ref(10.0, recording="other"))
    assert not nearby(ref(1.0, case="1"), ref(1.0, case="2"))
    assert nearby(ref(1.0, case="1"), ref(1.0, case="1"))


def test_the_page_shows_the_best_of_each_situation() -> None:
    refs = [ref(10.0), ref(11.0), ref(20.0), ref(9.0), ref(21.0)]
    assert distinct(refs, [1, 0, 4, 2, 3], 5) == [1, 4]
    assert distinct(refs, [1, 0, 4, 2, 3], 1) == [1]
