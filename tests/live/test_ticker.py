"""Moments in turn: what is skipped, waited for, told and kept, in processes that obey the test."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest

from scex_sumo.live import ticker as ticker_module
from scex_sumo.live.moment import Focus, road_of
from scex_sumo.live.risk import Question, Risk
from scex_sumo.live.ticker import Ticker


class Pool:
    """Pool whose tasks are done when asked for, or at once."""

    made: list[Pool]
    at_once = False

    def __init__(self, processes: int) -> None:
        self.futures: list[Future[Any]] = []
        self.made.append(self)
        self.closed = False

    def submit(self, work: Any, *, where: str) -> Future[Any]:
        future: Future[Any] = Future()
        if work.func is road_of:  # the first one
            return future
        self.futures.append(future)
        if self.at_once:
            self.done()
        return future

    def done(self, result: Any = None) -> None:
        time_s = len(self.futures) - 1.0
        if isinstance(result, Exception):
            self.futures[-1].set_exception(result)
        else:
            self.futures[-1].set_result(Risk(time_s=time_s, pairs=(), vehicles=()))

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def pools(monkeypatch: pytest.MonkeyPatch) -> list[Pool]:
    monkeypatch.setattr(ticker_module, "Pool", Pool)
    monkeypatch.setattr(Pool, "made", [], raising=False)
    return Pool.made


def made(callback: Callable[[Risk], object] | None = None, **options: Any) -> Ticker:
    own = {"net": Path("g.net.xml"), "wait": False, "workers": 1, **options}
    return Ticker(1.0, callback, question=Question(), focus=Focus(), **own)


def steps(ticker: Ticker, *times: float) -> None:
    for time_s in times:
        ticker.step(time_s, lambda focus: object())  # type: ignore[arg-type, return-value]


def test_a_moment_is_skipped_while_all_processes_work_and_no_queue_grows(pools: list[Pool]) -> None:
    ticker = made(workers=2)
    steps(ticker, 0.0, 1.0, 2.0, 3.0)
    assert [len(pool.futures) for pool in pools] == [1, 1] and ticker.skipped == 2
    pools[0].done()
    steps(ticker, 4.0)
    assert [len(pool.futures) for pool in pools] == [2, 1] and ticker.skipped == 2


def test_results_come_in_their_order(pools: list[Pool]) -> None:
    told: list[float] = []
    ticker = made(lambda risk: told.append(risk.time_s), workers=2)
    steps(ticker, 0.0, 1.0)
    pools[1].done()
    steps(ticker, 1.5)
    assert told == []
    pools[0].done()
    steps(ticker, 1.75)
    assert told == [0.0, 0.0] and ticker.risk is not None


def test_a_closed_ticker_ends_its_processes_and_keeps_the_last_risk(pools: list[Pool]) -> None:
    ticker = made()
    steps(ticker, 0.0)
    pools[0].done()
    steps(ticker, 0.5)
    ticker.close()
    steps(ticker, 1.0, 2.0)
    assert pools[0].closed and len(pools[0].futures) == 1 and ticker.risk is not None
