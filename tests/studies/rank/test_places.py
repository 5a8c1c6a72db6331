"""The composite rank, by hand where that can be done, and who gets more futures for it."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.rank.places import (
    Tally,
    distinct_moments,
    mean_score,
    nearby,
    place,
    rounds,
    undecided,
)
from scex_sumo.studies.rank.scores import RankSettings


def test_close_cases_have_ranks_that_could_be_each_others() -> None:
    found = place(np.array([0.50, 0.47, 0.0]), np.full(3, 0.08), seed=0)
    assert found.rank.tolist() == [1, 2, 3]
    assert found.low.tolist() == [1, 1, 3]
    assert found.high.tolist() == [2, 2, 3]


def test_smaller_errors_make_a_rank_surer() -> None:
    score = np.linspace(0.1, 0.9, 20)
    widths = []
    for futures in (10, 100, 1000):
        found = place(score, np.sqrt(score * (1 - score) / futures), seed=0)
        widths.append(int((found.high - found.low).sum()))
    assert widths[0] > widths[1] > widths[2]


def test_the_interval_of_ranks_holds_the_true_rank_as_often_as_it_says() -> None:
    """The true shares are known here: 30 seeds, 20 repetitions, 48 independent futures each."""
    rng = np.random.default_rng(1)
    held = 0
    for repetition in range(20):
        truth = rng.random(30)
        rank = (-truth).argsort().argsort() + 1
        hits = [(rng.random(48) < p).astype(float) for p in truth]
        levels = np.zeros((48, 0), dtype=np.int64)
        means = [mean_score(hit, DesignIntervals(levels, design="random")) for hit in hits]
        found = place(*np.array(means).T, seed=repetition)
        held += int(((found.low <= rank) & (rank <= found.high)).sum())
    # 600 ranks at 95 %; 0.02 is two standard deviations of that share, and wider intervals are no harm.
    assert held / 600 >= 0.93


def test_futures_that_are_all_alike_leave_some_doubt() -> None:
    intervals = DesignIntervals(np.zeros((32, 0), dtype=np.int64), design="random")
    assert mean_score(np.zeros(32), intervals) == (0.0, pytest.approx(0.5 / 33))


def test_the_same_seed_draws_the_same_intervals() -> None:
    score = np.random.default_rng(2).normal(0.5, 0.05, size=40)
    one, same, other = (place(score, np.full(40, 0.05), seed=seed) for seed in (0, 0, 1))
    assert np.array_equal(one.low, same.low)
    assert np.array_equal(one.high, same.high)
    assert not (np.array_equal(one.low, other.low) and np.array_equal(one.high, other.high))


def ref(time_s: float, *, recording: str = "r", case: str = "") -> MomentRef:
    name = f"{recording}_{case}_{time_s}"
    return MomentRef(moment=name, location="l", recording=recording, case=case, time_s=time_s, vehicles=5)


def tallies(refs: list[MomentRef], critical: list[int], futures: int = 32) -> dict[str, list[Tally]]:
    return {r.moment: [tally(k, futures)] for r, k in zip(refs, critical, strict=True)}


def tally(critical: int, futures: int = 32) -> Tally:
    """Of independent futures, so many of which have one critical encounter."""
    share = critical / futures
    return Tally(futures=futures, score=share, error=float(np.sqrt(share * (1 - share) / futures)) + 0.01)


@pytest.mark.parametrize(
    ("futures", "first", "ends"),
    [
        (96, 32, [32, 64, 96]),
        (385, 32, [32, 64, 128, 256, 385]),
        (32, 32, [32]),
        (10, 32, [10]),
        (64, 32, [32, 64]),
    ],
)
def test_rounds_double_up_to_the_most_futures(futures: int, first: int, ends: list[int]) -> None:
    run = RunSettings(models="standard_driver,risky_driver", futures=futures)
    settings = RankSettings(run=run, first=first, exact=False)
    assert [span.stop for span in rounds(settings)] == ends


@pytest.mark.parametrize(
    ("models", "futures", "stop"),
    [("rules", 385, 64), ("rules", 128, 64), ("rules", 96, None), ("likely", 385, None)],
    ids=["room for tables", "just", "fewer than their futures are left", "models that draw at random"],
)
def test_tables_are_searched_where_they_may_save_futures(models: str, futures: int, stop: int | None) -> None:
    spans = rounds(RankSettings(run=RunSettings(models=models, futures=futures), first=32))
    assert [span.stop for span in spans if not span] == ([] if stop is None else [stop])


def test_without_first_futures_some_moments_get_all_at_once() -> None:
    assert rounds(RankSettings(run=RunSettings(futures=96))) == [range(96)]


REFS = [ref(10.0 * i) for i in range(4)]


def test_seeds_that_may_trade_places_at_the_top_go_on() -> None:
    found = undecided(REFS, tallies(REFS, [31, 16, 15, 0]), 1, top=2, seed=0)
    assert found == [REFS[1], REFS[2]]


def test_what_cannot_reach_the_page_gets_no_more_futures() -> None:
    """The last two trade places, but not with the first two, and only those are shown."""
    found = undecided(REFS, tallies(REFS, [950, 600, 16, 15], 960), 1, top=2, seed=0)
    assert found == []


def test_a_round_is_decided_from_the_rounds_before_it_alone() -> None:
    """What later rounds have found, as after an interruption, changes nothing."""
    known = tallies(REFS, [31, 16, 15, 0])
    before = undecided(REFS, known, 1, top=2, seed=0)
    known[REFS[3].moment].append(tally(32))
    assert undecided(REFS, known, 1, top=2, seed=0) == before


def test_moments_of_the_same_seconds_are_one_situation() -> None:
    assert nearby(ref(10.0), ref(12.9))
    assert not nearby(ref(10.0), ref(13.0))
    assert not nearby(ref(10.0), ref(10.0, recording="other"))
    assert not nearby(ref(1.0, case="1"), ref(1.0, case="2"))
    assert nearby(ref(1.0, case="1"), ref(1.0, case="1"))


def test_the_page_shows_the_best_of_each_situation() -> None:
    refs = [ref(10.0), ref(11.0), ref(20.0), ref(9.0), ref(21.0)]
    assert distinct_moments(refs, [1, 0, 4, 2, 3], 5) == [1, 4]
    assert distinct_moments(refs, [1, 0, 4, 2, 3], 1) == [1]
