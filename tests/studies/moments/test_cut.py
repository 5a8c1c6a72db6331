"""Reading ahead changes when things are made, not what."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from scex_sumo.studies.moments.study import read_ahead


def test_an_error_comes_where_it_would_have_come() -> None:
    def broken() -> Iterator[int]:
        yield 1
        raise ValueError("no more")

    items = read_ahead(broken(), 5)
    assert next(items) == 1
    with pytest.raises(ValueError, match="no more"):
        next(items)


def test_no_more_are_made_ahead_than_asked_for() -> None:
    made = threading.Semaphore(0)

    def counted() -> Iterator[int]:
        for number in range(100):
            made.release()
            yield number

    items = read_ahead(counted(), 2)
    assert next(items) == 0
    # One taken, two waiting, one in the maker's hands.
    assert all(made.acquire(timeout=5) for _ in range(4))
    assert not made.acquire(timeout=0.5)
    items.close()


def test_closing_ends_the_thread() -> None:
    def endless() -> Iterator[int]:
        number = 0
        while True:
            yield number
            number += 1

    before = set(threading.enumerate())
    items = read_ahead(endless(), 2)
    assert next(items) == 0
    (thread,) = set(threading.enumerate()) - before
    items.close()
    thread.join(timeout=5)
    assert not thread.is_alive()
