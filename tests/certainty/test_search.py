"""Search for influence sets: events that are known functions of few vehicles' models."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.certainty.search import MAX_VEHICLES, Search

VEHICLES, LEVELS = 20, 4
SHARES = [np.full(LEVELS, 1 / LEVELS)] * VEHICLES
Event = Callable[[IntArray], BoolArray]


def searched(*events: Event, most: int = 385) -> Search:
    rng = np.random.default_rng(4)
    drawn = rng.integers(0, LEVELS, (385, VEHICLES))

    def happens(rows: IntArray) -> BoolArray:
        return np.stack([event(rows) for event in events], axis=1)

    search = Search(SHARES, drawn, happens(drawn), [(3, 5)] * len(events), rank=[0] * len(events), rng=rng)
    search.run(happens, most=most)
    return search


def pair(rows: IntArray) -> BoolArray:
    return np.asarray((rows[:, 3] == 1) & (rows[:, 5] == 2))


def hidden(rows: IntArray) -> BoolArray:
    """A third vehicle, which nobody suspects, decides in one cell of the pair."""
    return np.asarray(pair(rows) & (rows[:, 17] != 0))


def crowd(rows: IntArray) -> BoolArray:
    return np.asarray(rows[:, : MAX_VEHICLES + 2].sum(axis=1) > 12)


def test_a_pair_that_decides_alone_is_found() -> None:
    search = searched(pair)
    assert search.is_settled(0) and search.influence(0) == [3, 5]
    assert search.cubes(0) == [((3, 1), (5, 2))]
    assert len(search.rows) <= 100


def test_a_vehicle_outside_of_the_pair_is_found() -> None:
    search = searched(hidden)
    assert search.is_settled(0) and search.influence(0) == [3, 5, 17]
    rows = np.random.default_rng(9).integers(0, LEVELS, (20_000, VEHICLES))
    assert np.array_equal(search.predict(0, rows), hidden(rows))


def test_one_future_serves_many_events() -> None:
    events = [lambda rows, k=k: (rows[:, k] == 1) & (rows[:, k + 1] == 2) for k in range(0, 20, 2)]
    together, alone = searched(*events), searched(events[0])
    assert all(together.is_settled(event) for event in range(10))
    assert len(together.rows) < 3 * len(alone.rows)


def test_events_that_never_or_always_happen_need_no_vehicle() -> None:
    search = searched(lambda rows: np.zeros(len(rows), bool), lambda rows: np.ones(len(rows), bool))
    assert [search.cubes(event) for event in (0, 1)] == [[], [()]]
    assert search.influence(0) == search.influence(1) == []


def test_an_event_of_too_many_vehicles_is_not_settled() -> None:
    assert not searched(crowd).is_settled(0)


def test_a_drawn_future_that_differs_widens_the_set() -> None:
    """The futures that are run first happen to miss the event: it is learned from the drawn one."""

    def rare(rows: IntArray) -> BoolArray:
        return np.asarray(pair(rows) & (rows[:, 17] == 0) & (rows[:, 8] == 0))

    rng = np.random.default_rng(4)
    drawn = rng.integers(0, LEVELS, (385, VEHICLES))
    drawn[0, [3, 5, 17, 8]] = 1, 2, 0, 0
    blind = np.zeros((385, 1), dtype=bool)
    search = Search(SHARES, drawn, blind, [(3, 5)], rank=[0], rng=rng)
    search.run(lambda rows: rare(rows)[:, None], most=64)
    assert search.influence(0) == []
    search.seen = rare(drawn)[:, None]
    search.reopen(0)
    search.run(lambda rows: rare(rows)[:, None], most=385)
    assert search.is_settled(0) and search.influence(0) == [3, 5, 8, 17]
