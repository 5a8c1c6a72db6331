"""Which rows are equal to the bit, and which entries are least."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from scex_sumo.base import arrays
from scex_sumo.base.arrays import distinct, least_of, numbers_in

ROWS = np.array([[1.0, 2.0], [0.0, np.nan], [1.0, 2.0], [-0.0, np.nan], [0.0, np.nan]])


@pytest.mark.parametrize("factor", [arrays._FACTOR, np.uint64(0)], ids=["sums differ", "sums are all equal"])
def test_rows_are_told_apart_by_their_bits_in_the_order_of_their_first(
    factor: np.uint64, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrays, "_FACTOR", factor)
    first, kind = distinct(ROWS)
    assert first.tolist() == [0, 1, 3]
    assert kind.tolist() == [0, 1, 0, 2, 1]


def test_the_least_of_a_group_goes_by_its_keys_in_turn_and_of_equals_it_is_the_first() -> None:
    group = np.array([4, 1, 4, 1, 1, 4])
    first = np.array([2.0, 7.0, 2.0, np.inf, 7.0, 3.0])
    second = np.array([5, 6, 4, 0, 6, 0])
    assert least_of(group, first, second).tolist() == [1, 2]
    assert least_of(group, first).tolist() == [1, 0]
    assert least_of(group[:0], first[:0]).tolist() == []


def test_a_column_of_arrow_is_numbers_with_nan_where_it_is_null() -> None:
    pieces = [[1.5, None], [], [None, 2.5]]
    column = pa.chunked_array([pa.array(piece, pa.float64()) for piece in pieces])
    assert np.array_equal(numbers_in(column), [1.5, np.nan, np.nan, 2.5], equal_nan=True)
    assert numbers_in(pa.chunked_array([[1, 2]])).tolist() == [1.0, 2.0]
    assert np.isnan(numbers_in(pa.chunked_array([pa.nulls(2)]))).all()
