"""The composite rank, by hand where that can be done, and who gets more children for it."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.ranking.moments import MomentRef
from scex_sumo.ranking.places import Tally, beaten, distinct, nearby, place, round_ends, scores, undecided


def test_the_score_is_the_mean_share_of_critical_children() -> None:
    share = np.array([[0.1, 0.9], [0.25, 0.25]])
    assert scores(share).tolist() == [0.5, 0.25]
    assert scores(np.empty((2, 0))).tolist() == [0.0, 0.0]


def test_a_metric_that_is_the_same_everywhere_changes_no_order() -> None:
    share = np.array([[0.1], [0.4], [0.2], [0.9]])
    saturated = np.column_stack([share, np.ones(4)])
    assert np.argsort(scores(share)).tolist() == np.argsort(scores(saturated)).tolist()


def test_a_metric_that_is_the_same_everywhere_makes_no_rank_unsure() -> None:
    """All children of all 20 seeds are close together, as in a queue; the other metric tells them apart."""
    apart = np.arange(20) * 50
    children = np.full(20, 1000)
    alone = place(apart[:, None], children, seed=0)
    saturated = place(np.column_stack([apart, children]), children, seed=0)
    assert (saturated.high - saturated.low).max() <= (alone.high - alone.low).max() + 1


def test_severity_counts_the_seeds_that_are_beaten() -> None:
    """By the first column 3 > 2 > 1, by the second 1 > 2 = 3."""
    values = np.array([[1.0, 9.0], [2.0, 5.0], [300.0, 5.0]])
    # First: 0, 1/2, 1 of the two others; second: 1, and half of one equal = 1/4 each.
    assert beaten(values).tolist() == [0.5, 0.375, 0.625]


def test_a_single_seed_has_rank_one_for_certain() -> None:
    found = place(np.array([[3, 0]]), np.array([32]), seed=0)
    assert (found.rank.tolist(), found.low.tolist(), found.high.tolist()) == ([1], [1], [1])


def test_clear_cases_have_certain_ranks() -> None:
    """2, 48 and 94 of 96: the 95 % intervals are 0.1 wide at most and lie 0.4 apart."""
    found = place(np.array([[2], [94], [48]]), np.array([96, 96, 96]), seed=0)
    assert found.rank.tolist() == [3, 1, 2]
    assert found.low.tolist() == found.high.tolist() == found.rank.tolist()


def test_close_cases_have_ranks_that_could_be_each_others() -> None:
    found = place(np.array([[16], [15], [0]]), np.array([32, 32, 32]), seed=0)
    assert found.rank.tolist() == [1, 2, 3]
    assert found.low.tolist() == [1, 1, 3]
    assert found.high.tolist() == [2, 2, 3]


def test_more_children_make_a_rank_surer() -> None:
    share = np.linspace(0.1, 0.9, 20)[:, None]
    widths = []
    for children in (10, 100, 1000):
        found = place(np.rint(share * children).astype(np.int64), np.full(20, children), seed=0)
        widths.append(int((found.high - found.low).sum()))
    assert widths[0] > widths[1] > widths[2]


def test_the_interval_of_ranks_holds_the_true_rank_as_often_as_it_says() -> None:
    """The true shares are known here: 30 seeds, 20 repetitions, 48 children each."""
    rng = np.random.default_rng(1)
    held = 0
    for repetition in range(20):
        truth = rng.random((30, 1))
        rank = (-truth[:, 0]).argsort().argsort() + 1
        critical = rng.binomial(48, truth)
        found = place(critical, np.full(30, 48), seed=repetition)
        held += int(((found.low <= rank) & (rank <= found.high)).sum())
    # 600 ranks at 95 %; 0.02 is two standard deviations of that share, and wider intervals are no harm.
    assert held / 600 >= 0.93


def test_equal_scores_are_ranked_by_severity() -> None:
    all_of_them = np.full((3, 1), 32)
    severity = np.array([[1.0], [7.0], [-np.inf]])
    found = place(all_of_them, np.full(3, 32), severity=severity, seed=0)
    assert found.rank.tolist() == [2, 1, 3]
    assert place(all_of_them, np.full(3, 32), seed=0).rank.tolist() == [1, 1, 1]


def test_severity_never_outweighs_a_score() -> None:
    found = place(np.array([[1], [2]]), np.array([32, 32]), severity=np.array([[9.0], [1.0]]), seed=0)
    assert found.rank.tolist() == [2, 1]


def test_the_same_seed_draws_the_same_intervals() -> None:
    critical = np.random.default_rng(2).binomial(32, 0.5, size=(40, 4))
    one, same, other = (place(critical, np.full(40, 32), seed=seed) for seed in (0, 0, 1))
    assert np.array_equal(one.low, same.low)
    assert np.array_equal(one.high, same.high)
    assert not (np.array_equal(one.low, other.low) and np.array_equal(one.high, other.high))


def test_the_order_keeps_equals_as_they_came() -> None:
    found = place(np.array([[5], [9], [5]]), np.full(3, 32), seed=0)
    assert found.order() == [1, 0, 2]


def ref(time_s: float, *, recording: str = "r", case: str = "") -> MomentRef:
    name = f"{recording}_{case}_{time_s}"
    return MomentRef(moment=name, location="l", recording=recording, case=case, time_s=time_s, vehicles=5)


def tallies(refs: list[MomentRef], critical: list[int], children: int = 32) -> dict[str, list[Tally]]:
    return {
        r.moment: [Tally(children=children, critical=np.array([k]))]
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
    known[REFS[1].moment].append(Tally(children=32, critical=np.array([16])))
    found = undecided(REFS, known, 2, top=2, seed=0)
    assert REFS[2] not in found


def test_a_round_is_decided_from_the_rounds_before_it_alone() -> None:
    """What later rounds have found, as after an interruption, changes nothing."""
    known = tallies(REFS, [31, 16, 15, 0])
    before = undecided(REFS, known, 1, top=2, seed=0)
    known[REFS[3].moment].append(Tally(children=32, critical=np.array([32])))
    assert undecided(REFS, known, 1, top=2, seed=0) == before


def test_seeds_without_results_are_left_out() -> None:
    known = tallies(REFS, [31, 16, 15, 0])
    del known[REFS[0].moment]
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
