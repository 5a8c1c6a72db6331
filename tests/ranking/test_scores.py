"""The composite rank, by hand where that can be done."""

from __future__ import annotations

import numpy as np

from scex_sumo.ranking.scores import beaten, place, scores


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
